//! Repeatable random numbers.

/// PCG-RXS-M-XS-32 as a hash (O'Neill 2014; Jarzynski and Olano, JCGT 9(3), 2020).
pub fn pcg(v: u32) -> u32 {
    let state = v.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    let word = ((state >> ((state >> 28) + 4)) ^ state).wrapping_mul(277_803_737);
    (word >> 22) ^ word
}

/// The upper 24 bits as a number in [0, 1).
pub fn unit(bits: u32) -> f64 {
    f64::from(bits >> 8) / 16_777_216.0
}
