// defs: FIRST=1
// One layer of the layered depth image: the nearest surface behind the layer before. Everitt, Interactive Order-Independent
// Transparency, 2001, as SPT §2.2 uses it. The depths that the pass tests are the layer's: no shader writes them, so hardware may
// reject fragments before they are shaded. A fragment's `position.z` is the depth that is tested and kept of it;
// `verify` would find a layer twice where it were not.
#import fathom::host::{MaterialUniforms}
#import fathom::uniforms::{frame}
#import fathom::surface_texel::{packed}

@group(1) @binding(0) var<storage, read> materials: array<MaterialUniforms>;
#if FIRST == 0
@group(1) @binding(1) var before: texture_depth_2d;
#endif

struct Varying {
    @builtin(position) @invariant clip: vec4<f32>,
    @location(0) shading_normal: vec3<f32>,
    @location(1) @interpolate(flat) geometric_normal: vec3<f32>,
    @location(2) @interpolate(flat) optics: f32,
    @location(3) from_camera_m: vec3<f32>,
}

// The first corner of a triangle has the triangle's own normal. Interpolated normals would do for none of the tests that rays make: those
// of a box with eight corners point along its diagonals.
struct Corner {
    @location(0) position_m: vec3<f32>,
    @location(1) shading_normal: vec3<f32>,
    @location(2) material: u32,
    @location(3) geometric_normal: vec3<f32>,
}

@vertex
fn vertex(in: Corner) -> Varying {
    let clip = frame.camera_view_projection * vec4(in.position_m, 1.0);
    let optics = materials[in.material].optics;
    return Varying(clip, in.shading_normal, in.geometric_normal, optics, in.position_m - frame.camera_position_m);
}

@fragment
fn fragment(in: Varying) -> @location(0) vec4<u32> {
#if FIRST == 0
    if in.clip.z <= textureLoad(before, vec2<i32>(in.clip.xy), 0) {
        discard;
    }
#endif
    return packed(in.shading_normal, in.optics, in.geometric_normal, in.from_camera_m);
}
