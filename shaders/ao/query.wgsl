// Volume ambient occlusion at given points: VAO §3 step 3, §5.1.
// defs: UNIFORM=0, RANDOM=0, HARD=0, GUARD=1, SKIPPING=0, OPACITY=0, PEAK=0, JITTER=0, COUNT=0, SLICED=0
#import fathom::dispatch
#import fathom::marching

struct Point {
    position_m: vec3<f32>,
    normal: vec3<f32>,
}

@group(0) @binding(0) var<storage, read> points: array<Point>;
// Visibility 1 − A of what was marched before; the volumes of several objects multiply.
@group(0) @binding(1) var<storage, read_write> visibility: array<f32>;

@compute @workgroup_size(dispatch::GROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let index = dispatch::invocation_index(id, groups);
    if index >= arrayLength(&points) {
        return;
    }
    let p = points[index];
    visibility[index] *= 1.0 - marching::occlusion(p.position_m, p.normal, marching::seed_of(index), index);
}
