// What lies beyond the water, drawn from the camera: UW §3 step 4.
#import fathom::uniforms::{frame}
#import fathom::surface::{Material, SceneVertex, Varying, projected}
#import fathom::lit_scene::{kept, radiance}
#import fathom::shading

@group(1) @binding(0) var<storage, read> materials: array<Material>;

@vertex
fn vertex(in: SceneVertex) -> Varying {
    return projected(in, frame.camera_view_projection);
}

@fragment
fn fragment(in: Varying) -> @location(0) vec4<f32> {
    let side = select(-1.0, 1.0, frame.camera_under_water != 0u);
    if !kept(in.position_m, side) {
        discard;
    }
    let color = radiance(materials[in.material], in.position_m, normalize(in.normal));
    return vec4(shading::fog(color, shading::water_path_m(in.position_m)), 1.0);
}
