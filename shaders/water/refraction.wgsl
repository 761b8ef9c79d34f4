// What lies beyond the water, drawn from the camera: UW §3 step 4.
#import fathom::host::{MaterialUniforms}
#import fathom::uniforms::{frame}
#import fathom::surface::{SceneVertex}
#import fathom::lit_scene::{Varying, kept, radiance}
#import fathom::shading

@group(1) @binding(0) var<storage, read> materials: array<MaterialUniforms>;

@vertex
fn vertex(in: SceneVertex) -> Varying {
    let clip = frame.camera_view_projection * vec4(in.position_m, 1.0);
    return Varying(clip, in.position_m, in.normal, in.material);
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
