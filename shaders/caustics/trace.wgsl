// defs: SIDE=2, WATER=0
// Where the photons of the light's grid land, for the caustics: UW §3.3.
#import fathom::photon_grid::{trace_cell}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) cell: vec3<u32>) {
    trace_cell(cell.xy);
}
