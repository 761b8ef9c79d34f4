// What the water mirrors, drawn from the camera mirrored about the resting surface: UW §3 step 4.
#import fathom::uniforms::{frame}
#import fathom::surface::{Material, SceneVertex, Varying, projected}
#import fathom::lit_scene::{kept, radiance}
#import fathom::shading

@group(1) @binding(0) var<storage, read> materials: array<Material>;

@vertex
fn vertex(in: SceneVertex) -> Varying {
    return projected(in, frame.mirror_view_projection);
}

@fragment
fn fragment(in: Varying) -> @location(0) vec4<f32> {
    // The mirrored world lies on the camera's own side of the water.
    let side = select(1.0, -1.0, frame.camera_under_water != 0u);
    if !kept(in.position_m, side) {
        discard;
    }
    let color = radiance(materials[in.material], in.position_m, normalize(in.normal));
    if side > 0.0 {
        return vec4(color, 1.0);
    }
    let mirrored = vec3(in.position_m.x, -in.position_m.y, in.position_m.z);
    return vec4(shading::fog(color, distance(mirrored, frame.camera_position_m)), 1.0);
}
