// Loops that count their iterations. No compiler finds a closed form of the sequence, so none can leave iterations out.
struct Work {
    outer: u32,
    inner: u32,
}

struct Made {
    turns: u32,
    state: u32,
}

@group(0) @binding(0) var<uniform> work: Work;
@group(0) @binding(1) var<storage, read_write> made: Made;

// An iteration: the state depends on the one before. The host computes the same in src/gpu/loops.rs.
fn next_state(before: Made) -> Made {
    return Made(before.turns + 1u, (before.state ^ (before.state >> 15u)) * 0x2c1b3c6du + 1u);
}

@compute @workgroup_size(1)
fn main() {
    var now = Made(0u, 0u);
    for (var i = 0u; i < work.outer; i++) {
        for (var j = 0u; j < work.inner; j++) {
            now = next_state(now);
        }
    }
    made = now;
}
