// Repeatable numbers from integers.
#define_import_path fathom::random

// 2³² / golden ratio: multiples of it are spread evenly over the integers.
const GOLDEN: u32 = 0x9E3779B9u;

// A well mixed integer: PCG-RXS-M-XS-32 (Jarzynski and Olano, "Hash Functions for GPU Rendering", JCGT 9(3), 2020).
fn pcg(v: u32) -> u32 {
    let state = v * 747796405u + 2891336453u;
    let word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
    return (word >> 22u) ^ word;
}

// The upper 24 bits as a number in [0, 1), exactly.
fn unit(v: u32) -> f32 {
    return f32(v >> 8u) / 16777216.0;
}
