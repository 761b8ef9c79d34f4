// defs: SIDE=2, WATER=0
// One invocation a cell of the photon grid: UW §3.4.
#import fathom::tracing::{trace_cell}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) cell: vec3<u32>) {
    trace_cell(cell.xy);
}
