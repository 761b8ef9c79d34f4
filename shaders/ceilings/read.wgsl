// defs: GROUP_SIZE=64
struct Work {
    turns: u32,
}

@group(0) @binding(0) var<uniform> work: Work;
@group(0) @binding(1) var<storage, read_write> results: array<u32>;
@group(0) @binding(2) var<storage, read> data: array<vec4<u32>>;

// All invocations together read the whole buffer, whose length is a power of two, once a turn, each turn from another start.
@compute @workgroup_size(#{GROUP_SIZE})
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let length = arrayLength(&data);
    let invocations = arrayLength(&results);
    var sum = vec4<u32>(0u);
    for (var turn = 0u; turn < work.turns; turn++) {
        for (var at = id.x; at < length; at += invocations) {
            sum += data[(at + turn) & (length - 1u)];
        }
    }
    results[id.x] = sum.x + sum.y + sum.z + sum.w;
}
