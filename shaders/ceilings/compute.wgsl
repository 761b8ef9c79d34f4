// defs: GROUP_SIZE=64
// Kernels that measure the adapter's limits in compute passes. Every invocation of a kernel writes the same whole number.
#import fathom::ceilings::{loads_2d, loads_3d, multiply_adds, work}

@group(0) @binding(1) var<storage, read_write> results: array<atomic<u32>>;
@group(1) @binding(0) var<storage, read> data: array<vec4<u32>>;

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

@compute @workgroup_size(#{GROUP_SIZE})
fn load_2d(@builtin(global_invocation_id) id: vec3<u32>) {
    atomicStore(&results[id.x], u32(loads_2d(vec2<u32>(id.x, id.x / 64u))));
}

@compute @workgroup_size(#{GROUP_SIZE})
fn load_3d(@builtin(global_invocation_id) id: vec3<u32>) {
    atomicStore(&results[id.x], u32(loads_3d(vec2<u32>(id.x, id.x / 64u))));
}

@compute @workgroup_size(#{GROUP_SIZE})
fn multiply_add(@builtin(global_invocation_id) id: vec3<u32>) {
    atomicStore(&results[id.x], u32(multiply_adds()));
}
