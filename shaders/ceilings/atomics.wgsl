// defs: GROUP_SIZE=64, CONTENDED=0
struct Work {
    turns: u32,
}

@group(0) @binding(0) var<uniform> work: Work;
@group(0) @binding(1) var<storage, read_write> results: array<atomic<u32>>;

// Eight adds a turn, to a word of the invocation's own or to one that all share.
@compute @workgroup_size(#{GROUP_SIZE})
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
#if CONTENDED == 1
    let word = 0u;
#else
    let word = id.x;
#endif
    for (var turn = 0u; turn < work.turns; turn++) {
        atomicAdd(&results[word], 1u);
        atomicAdd(&results[word], 1u);
        atomicAdd(&results[word], 1u);
        atomicAdd(&results[word], 1u);
        atomicAdd(&results[word], 1u);
        atomicAdd(&results[word], 1u);
        atomicAdd(&results[word], 1u);
        atomicAdd(&results[word], 1u);
    }
}
