// Loops whose turns are counted. No compiler finds a closed form of the sequence, so that the turns must be made.
#import fathom::host::{LoopLengths}

struct Made {
    turns: u32,
    state: u32,
}

@group(0) @binding(0) var<uniform> work: LoopLengths;
@group(0) @binding(1) var<storage, read_write> made: Made;

// The product depends on the turn before. Host twin: src/gpu/loops.rs.
fn turned(before: Made) -> Made {
    return Made(before.turns + 1u, (before.state ^ (before.state >> 15u)) * 0x2c1b3c6du + 1u);
}

@compute @workgroup_size(1)
fn main() {
    var now = Made(0u, 0u);
    for (var i = 0u; i < work.outer; i++) {
        for (var j = 0u; j < work.inner; j++) {
            now = turned(now);
        }
    }
    made = now;
}
