// What the adapter's limits are measured with in compute and in render passes: src/gpu/ceilings.
#define_import_path fathom::ceilings
#import fathom::host::{KernelWork}

// Edge of the textures in texels, a power of two.
const EDGE: u32 = 64u;

@group(0) @binding(0) var<uniform> work: KernelWork;
@group(2) @binding(0) var image: texture_2d<f32>;
@group(3) @binding(0) var volume: texture_3d<f32>;

fn texel_2d(at: vec2<u32>) -> f32 {
    return textureLoad(image, at & vec2<u32>(EDGE - 1u), 0).x;
}

fn texel_3d(at: vec3<u32>) -> f32 {
    return textureLoad(volume, at & vec3<u32>(EDGE - 1u), 0).x;
}

// Of eight neighbours in a row four are 1: the sum is the same wherever it begins.
fn loads_2d(start: vec2<u32>) -> f32 {
    var sum = 0.0;
    let x = vec2<u32>(1u, 0u);
    for (var iteration = 0u; iteration < work.turns; iteration++) {
        let at = vec2<u32>(start.x, start.y + iteration);
        sum += texel_2d(at) + texel_2d(at + x) + texel_2d(at + 2u * x) + texel_2d(at + 3u * x);
        sum += texel_2d(at + 4u * x) + texel_2d(at + 5u * x) + texel_2d(at + 6u * x) + texel_2d(at + 7u * x);
    }
    return sum;
}

fn loads_3d(start: vec2<u32>) -> f32 {
    var sum = 0.0;
    let x = vec3<u32>(1u, 0u, 0u);
    for (var iteration = 0u; iteration < work.turns; iteration++) {
        let at = vec3<u32>(start, iteration);
        sum += texel_3d(at) + texel_3d(at + x) + texel_3d(at + 2u * x) + texel_3d(at + 3u * x);
        sum += texel_3d(at + 4u * x) + texel_3d(at + 5u * x) + texel_3d(at + 6u * x) + texel_3d(at + 7u * x);
    }
    return sum;
}

fn step(x: vec4<f32>) -> vec4<f32> {
    return fma(x, vec4<f32>(work.factor), vec4<f32>(work.addend));
}

// 64 multiply-adds an iteration, in eight independent chains: more would not stay in the registers of a CPU.
fn multiply_adds() -> f32 {
    var a = vec4<f32>(0.0);
    var b = vec4<f32>(1.0);
    for (var iteration = 0u; iteration < work.turns; iteration++) {
        a = step(a); b = step(b); a = step(a); b = step(b);
        a = step(a); b = step(b); a = step(a); b = step(b);
        a = step(a); b = step(b); a = step(a); b = step(b);
        a = step(a); b = step(b); a = step(a); b = step(b);
    }
    return dot(a, vec4<f32>(1.0)) + dot(b, vec4<f32>(1.0)) - 4.0;
}
