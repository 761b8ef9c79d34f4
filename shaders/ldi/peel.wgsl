// defs: FIRST=1
// One layer of the layered depth image: the nearest surface behind the layer before. Everitt, Interactive Order-Independent
// Transparency, 2001, as SPT §2.2 uses it.
#import fathom::uniforms::{frame}
#import fathom::surface::{Material, SceneVertex}
#import fathom::surface_texel::{channels, packed}

@group(1) @binding(0) var<storage, read> materials: array<Material>;
#if FIRST == 0
@group(1) @binding(1) var before: texture_2d<f32>;
#endif

struct Varying {
    @builtin(position) @invariant clip: vec4<f32>,
    @location(0) normal: vec3<f32>,
    @location(1) @interpolate(flat) material: u32,
}

struct Layer {
    // Device depth, as the depth test compares it.
    @location(0) depth: vec4<f32>,
    @location(1) surface: vec4<u32>,
    @builtin(frag_depth) tested: f32,
}

@vertex
fn vertex(in: SceneVertex) -> Varying {
    return Varying(frame.camera_view_projection * vec4(in.position_m, 1.0), in.normal, in.material);
}

@fragment
fn fragment(in: Varying) -> Layer {
    let z = in.clip.z;
#if FIRST == 0
    if z <= textureLoad(before, vec2<i32>(in.clip.xy), 0).x {
        discard;
    }
#endif
    let surface = channels(packed(in.normal, materials[in.material].optics));
    return Layer(vec4(z, 0.0, 0.0, 1.0), surface, z);
}
