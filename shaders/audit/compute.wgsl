// defs: GROUP_SIZE=64
// A compute kernel whose run time is proportional to `work.iterations`.
#import fathom::busy_work::logistic

struct Work {
    iterations: u32,
}

@group(0) @binding(0) var<uniform> work: Work;
@group(0) @binding(1) var<storage, read_write> results: array<f32>;

@compute @workgroup_size(#{GROUP_SIZE})
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < arrayLength(&results) {
        results[id.x] = logistic(f32(id.x), work.iterations);
    }
}
