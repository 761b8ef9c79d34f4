// defs: GROUP_SIZE=64
struct Work {
    turns: u32,
}

@group(0) @binding(0) var<uniform> work: Work;
@group(0) @binding(1) var<storage, read_write> results: array<u32>;
@group(0) @binding(2) var<storage, read> data: array<vec4<u32>>;

// A workgroup reads a piece of the buffer, neighbouring invocations neighbouring words. Each turn reads a piece that is an eighth of
// the buffer or more away from those of the seven turns before, so that no cache smaller than that holds it. The buffer's length is a power
// of two. A buffer that is too short for all workgroups is read by several of them.
@compute @workgroup_size(#{GROUP_SIZE})
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let length = arrayLength(&data);
    let piece = max(length / groups.x, #{GROUP_SIZE}u);
    var sum = vec4<u32>(0u);
    for (var turn = 0u; turn < work.turns; turn++) {
        let start = group.x * piece + turn * (length / 8u * 5u) + lane;
        for (var i = 0u; i < piece; i += #{GROUP_SIZE}u) {
            sum += data[(start + i) & (length - 1u)];
        }
    }
    results[group.x * #{GROUP_SIZE}u + lane] = sum.x + sum.y + sum.z + sum.w;
}
