// Volume ambient occlusion of what the camera sees: VAO §3 step 3, §5.1.
// defs: UNIFORM=0, RANDOM=0, HARD=0, GUARD=1, SKIPPING=0, OPACITY=0, PEAK=0, JITTER=0, COUNT=0, SLICED=0
#import fathom::host::{TargetUniforms}
#import fathom::uniforms::{world_at}
#import fathom::marching
#import fathom::screen

@group(2) @binding(0) var<uniform> settings: TargetUniforms;
@group(2) @binding(1) var depth: texture_depth_2d;
@group(2) @binding(2) var normals: texture_2d<f32>;
#if COUNT == 1
// A sum of 64 bits for each counter and slot: the lower word, then what was carried out of it.
@group(2) @binding(3) var<storage, read_write> counters: array<atomic<u32>>;

fn count(counter: u32, slot: u32, n: u32) {
    let place = 2u * (64u * counter + slot);
    let before = atomicAdd(&counters[place], n);
    if before + n < before {
        atomicAdd(&counters[place + 1u], 1u);
    }
}
#endif

// Visibility 1 − A, so that the volumes of several objects multiply.
@fragment
fn fragment(@builtin(position) pixel: vec4<f32>) -> @location(0) vec4<f32> {
    let view_px = vec2<f32>(textureDimensions(depth));
    let texel = screen::texel_behind(pixel.xy, vec2<f32>(settings.size_px), view_px);
    let z = textureLoad(depth, texel, 0);
    if z >= 1.0 {
        discard;
    }
    let uv = (vec2<f32>(texel) + 0.5) / view_px;
    let normal = normalize(textureLoad(normals, texel, 0).xyz);
    let place = vec2<u32>(pixel.xy);
    let index = place.y * settings.size_px.x + place.x;
    let occluded = marching::occlusion(world_at(uv, z), normal, marching::seed_of(place.x + 65536u * place.y), index);
#if COUNT == 1
    let slot = place.x & 63u;
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
