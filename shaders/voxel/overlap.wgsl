// Every voxel that a triangle touches, by separating axes. Akenine-Möller 2001; Schwarz and Seidel 2010, §3.
// defs: STEP=1, ALPHA=0
#import fathom::dispatch::{GROUP}
#import fathom::triangles::{run}

@compute @workgroup_size(GROUP)
fn main(
    @builtin(global_invocation_id) id: vec3<u32>,
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) own: u32,
) {
    run(id, group, groups, own);
}
