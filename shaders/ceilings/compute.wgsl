// defs: GROUP_SIZE=64, EDGE=64
// Kernels that measure the adapter's limits in compute passes. Every invocation of a kernel writes the same whole number.
struct Work {
    turns: u32,
    // Both 1, which the compiler cannot know.
    factor: f32,
    addend: f32,
}

@group(0) @binding(0) var<uniform> work: Work;
@group(0) @binding(1) var<storage, read_write> results: array<atomic<u32>>;
@group(0) @binding(2) var<storage, read> data: array<vec4<u32>>;
@group(0) @binding(3) var image: texture_2d<f32>;
@group(0) @binding(4) var volume: texture_3d<f32>;

// A workgroup reads a piece of the buffer, neighbouring invocations neighbouring words, four of which add up to 1. Each iteration reads a
// piece that is an eighth of the buffer or more away from those of the seven before, so that no cache smaller than that holds it. The
// buffer's length is a power of two. A buffer that is too short for all workgroups is read by several of them.
@compute @workgroup_size(#{GROUP_SIZE})
fn sum_words(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let length = arrayLength(&data);
    let piece = max(length / groups.x, #{GROUP_SIZE}u);
    var sum = vec4<u32>(0u);
    for (var iteration = 0u; iteration < work.turns; iteration++) {
        let start = group.x * piece + iteration * (length / 8u * 5u) + lane;
        for (var i = 0u; i < piece; i += #{GROUP_SIZE}u) {
            sum += data[(start + i) & (length - 1u)];
        }
    }
    atomicStore(&results[group.x * #{GROUP_SIZE}u + lane], sum.x + sum.y + sum.z + sum.w);
}

// Texels alternate between 0 and 1 along each axis: eight neighbours add up to 4.
fn texel_2d(at: vec2<u32>) -> f32 {
    return textureLoad(image, at & vec2<u32>(#{EDGE}u - 1u), 0).x;
}

@compute @workgroup_size(#{GROUP_SIZE})
fn load_2d(@builtin(global_invocation_id) id: vec3<u32>) {
    var sum = 0.0;
    let x = vec2<u32>(1u, 0u);
    for (var iteration = 0u; iteration < work.turns; iteration++) {
        let at = vec2<u32>(id.x, id.x / #{EDGE}u + iteration);
        sum += texel_2d(at) + texel_2d(at + x) + texel_2d(at + 2u * x) + texel_2d(at + 3u * x);
        sum += texel_2d(at + 4u * x) + texel_2d(at + 5u * x) + texel_2d(at + 6u * x) + texel_2d(at + 7u * x);
    }
    atomicStore(&results[id.x], u32(sum));
}

fn texel_3d(at: vec3<u32>) -> f32 {
    return textureLoad(volume, at & vec3<u32>(#{EDGE}u - 1u), 0).x;
}

@compute @workgroup_size(#{GROUP_SIZE})
fn load_3d(@builtin(global_invocation_id) id: vec3<u32>) {
    var sum = 0.0;
    let x = vec3<u32>(1u, 0u, 0u);
    for (var iteration = 0u; iteration < work.turns; iteration++) {
        let at = vec3<u32>(id.x, id.x / #{EDGE}u, iteration);
        sum += texel_3d(at) + texel_3d(at + x) + texel_3d(at + 2u * x) + texel_3d(at + 3u * x);
        sum += texel_3d(at + 4u * x) + texel_3d(at + 5u * x) + texel_3d(at + 6u * x) + texel_3d(at + 7u * x);
    }
    atomicStore(&results[id.x], u32(sum));
}

@compute @workgroup_size(#{GROUP_SIZE})
fn add(@builtin(global_invocation_id) id: vec3<u32>) {
    for (var iteration = 0u; iteration < work.turns; iteration++) {
        atomicAdd(&results[id.x], 1u); atomicAdd(&results[id.x], 1u);
        atomicAdd(&results[id.x], 1u); atomicAdd(&results[id.x], 1u);
        atomicAdd(&results[id.x], 1u); atomicAdd(&results[id.x], 1u);
        atomicAdd(&results[id.x], 1u); atomicAdd(&results[id.x], 1u);
    }
}

fn step(x: vec4<f32>) -> vec4<f32> {
    return fma(x, vec4<f32>(work.factor), vec4<f32>(work.addend));
}

// 64 multiply-adds an iteration, in eight independent chains: more would not stay in the registers of a CPU.
@compute @workgroup_size(#{GROUP_SIZE})
fn multiply_add(@builtin(global_invocation_id) id: vec3<u32>) {
    var a = vec4<f32>(0.0);
    var b = vec4<f32>(1.0);
    for (var iteration = 0u; iteration < work.turns; iteration++) {
        a = step(a); b = step(b); a = step(a); b = step(b);
        a = step(a); b = step(b); a = step(a); b = step(b);
        a = step(a); b = step(b); a = step(a); b = step(b);
        a = step(a); b = step(b); a = step(a); b = step(b);
    }
    atomicStore(&results[id.x], u32(dot(a, vec4<f32>(1.0)) + dot(b, vec4<f32>(1.0)) - 4.0));
}

// Counts its passes.
@compute @workgroup_size(1)
fn count() {
    atomicAdd(&results[0], u32(work.factor));
}
