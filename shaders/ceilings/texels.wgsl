// defs: GROUP_SIZE=64, EDGE=64
// The texel at x, y (and z) is the last three bits of the sum of its coordinates, so eight neighbours along x add up to 28.
struct Work {
    turns: u32,
}

@group(0) @binding(0) var<uniform> work: Work;
@group(0) @binding(1) var<storage, read_write> results: array<f32>;
@group(0) @binding(2) var image: texture_2d<f32>;
@group(0) @binding(3) var nearest: sampler;
@group(0) @binding(4) var volume: texture_3d<f32>;
@group(0) @binding(5) var linear: sampler;

fn loaded(at: vec2<u32>) -> f32 {
    return textureLoad(image, at & vec2<u32>(#{EDGE}u - 1u), 0).x;
}

@compute @workgroup_size(#{GROUP_SIZE})
fn load(@builtin(global_invocation_id) id: vec3<u32>) {
    var sum = 0.0;
    for (var turn = 0u; turn < work.turns; turn++) {
        let at = vec2<u32>(id.x, id.x / #{EDGE}u + turn);
        sum += loaded(at) + loaded(at + vec2<u32>(1u, 0u)) + loaded(at + vec2<u32>(2u, 0u)) + loaded(at + vec2<u32>(3u, 0u));
        sum += loaded(at + vec2<u32>(4u, 0u)) + loaded(at + vec2<u32>(5u, 0u)) + loaded(at + vec2<u32>(6u, 0u)) + loaded(at + vec2<u32>(7u, 0u));
    }
    results[id.x] = sum;
}

const TEXEL = 1.0 / #{EDGE}.0;

fn gathered(at: vec2<f32>) -> f32 {
    return dot(textureGather(0, image, nearest, at), vec4<f32>(1.0));
}

// Between four texels, whose order does not matter.
@compute @workgroup_size(#{GROUP_SIZE})
fn gather(@builtin(global_invocation_id) id: vec3<u32>) {
    var sum = 0.0;
    for (var turn = 0u; turn < work.turns; turn++) {
        let texel = vec2<u32>(id.x, id.x / #{EDGE}u + turn) & vec2<u32>(#{EDGE}u - 1u);
        let at = vec2<f32>(texel) * TEXEL;
        let x = vec2<f32>(TEXEL, 0.0);
        sum += gathered(at) + gathered(at + x) + gathered(at + 2.0 * x) + gathered(at + 3.0 * x);
        sum += gathered(at + 4.0 * x) + gathered(at + 5.0 * x) + gathered(at + 6.0 * x) + gathered(at + 7.0 * x);
    }
    results[id.x] = sum;
}

fn sampled(at: vec3<f32>) -> f32 {
    return textureSampleLevel(volume, linear, at, 0.0).x;
}

// Between eight texels: the filter has its full width.
@compute @workgroup_size(#{GROUP_SIZE})
fn sample(@builtin(global_invocation_id) id: vec3<u32>) {
    var sum = 0.0;
    for (var turn = 0u; turn < work.turns; turn++) {
        let texel = vec3<u32>(id.x, id.x / #{EDGE}u, turn) & vec3<u32>(#{EDGE}u - 1u);
        let at = vec3<f32>(texel) * TEXEL;
        let x = vec3<f32>(TEXEL, 0.0, 0.0);
        sum += sampled(at) + sampled(at + x) + sampled(at + 2.0 * x) + sampled(at + 3.0 * x);
        sum += sampled(at + 4.0 * x) + sampled(at + 5.0 * x) + sampled(at + 6.0 * x) + sampled(at + 7.0 * x);
    }
    results[id.x] = sum;
}
