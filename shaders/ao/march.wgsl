// Volume ambient occlusion of what the camera sees: VAO §3 step 3, §5.1.
// defs: UNIFORM=0, RANDOM=0, HARD=0, GUARD=1, SKIPPING=0, OPACITY=0, PEAK=0, JITTER=0, COUNT=0, COUNTERS=2, SLICED=0
#import fathom::uniforms::{world_at}
#if COUNT == 1
#import fathom::counters::{count}
#endif
#import fathom::marching
#import fathom::screen

struct Target {
    // Pixels of the occlusion buffer.
    size_px: vec2<f32>,
}

@group(2) @binding(0) var<uniform> settings: Target;
@group(2) @binding(1) var depth: texture_depth_2d;
@group(2) @binding(2) var normals: texture_2d<f32>;

// Visibility 1 − A, so that the volumes of several objects multiply.
@fragment
fn fragment(@builtin(position) pixel: vec4<f32>) -> @location(0) vec4<f32> {
    let view_px = vec2<f32>(textureDimensions(depth));
    let texel = screen::texel_behind(pixel.xy, settings.size_px, view_px);
    let z = textureLoad(depth, texel, 0);
    if z >= 1.0 {
        discard;
    }
    let uv = (vec2<f32>(texel) + 0.5) / view_px;
    let normal = normalize(textureLoad(normals, texel, 0).xyz);
    let own = vec2<u32>(pixel.xy);
    let index = own.y * u32(settings.size_px.x) + own.x;
    let occluded = marching::occlusion(world_at(uv, z), normal, marching::seed_of(own.x + 65536u * own.y), index);
#if COUNT == 1
    let slot = own.x & 63u;
    count(0u, slot, marching::taken);
    count(1u, slot, marching::looked_up);
#if SLICED == 1
    // A fragment counts once, in its first pass.
    count(2u, slot, u32(marching::slice.first == 0u));
#else
    count(2u, slot, 1u);
#endif
#endif
    return vec4(1.0 - occluded);
}
