// defs: FIRST=1
// One layer of the layered depth image: the nearest surface behind the layer before. Everitt, Interactive Order-Independent
// Transparency, 2001, as SPT §2.2 uses it. The depths that the pass tests are the layer's: no shader writes them, so hardware may
// reject fragments before they are shaded. A fragment's `position.z` is the depth that is tested and kept of it;
// `verify` would find a layer twice where it were not.
#import fathom::uniforms::{frame}
#import fathom::surface::{Material, SceneVertex}
#import fathom::surface_texel::{channels, packed}

@group(1) @binding(0) var<storage, read> materials: array<Material>;
#if FIRST == 0
@group(1) @binding(1) var before: texture_depth_2d;
#endif

struct Varying {
    @builtin(position) @invariant clip: vec4<f32>,
    @location(0) normal: vec3<f32>,
    @location(1) @interpolate(flat) optics: f32,
}

@vertex
fn vertex(in: SceneVertex) -> Varying {
    let clip = frame.camera_view_projection * vec4(in.position_m, 1.0);
    return Varying(clip, in.normal, materials[in.material].optics);
}

@fragment
fn fragment(in: Varying) -> @location(0) vec4<u32> {
#if FIRST == 0
    if in.clip.z <= textureLoad(before, vec2<i32>(in.clip.xy), 0) {
        discard;
    }
#endif
    return channels(packed(in.normal, in.optics));
}
