//! Long loops in several passes: an invocation makes at most [`MOST_LOOP_TURNS`] turns.

use crate::gpu::MOST_LOOP_TURNS;
use crate::shader_struct;

shader_struct! {
    /// `Slice` in `shaders/shared/slice.wgsl`: the turns of one pass.
    pub struct Slice {
        pub first: u32,
        /// Behind the last.
        pub end: u32,
    }
}

/// The slices of a loop of `count` turns, each of which takes so many turns with the loops within it. `beside` is what an invocation
/// makes before and after.
pub fn slices(count: u32, of_each: u64, beside: u64) -> Vec<Slice> {
    let most = (MOST_LOOP_TURNS.saturating_sub(beside + 1) / of_each.max(1)).max(1);
    let most = u32::try_from(most).unwrap_or(u32::MAX);
    let slice = |first: u32| Slice { first, end: count.min(first.saturating_add(most)) };
    (0..count.max(1)).step_by(most as usize).map(slice).collect()
}

/// Turns of an invocation in the longest of the slices.
pub fn most_turns(slices: &[Slice], of_each: u64, beside: u64) -> u64 {
    let longest = slices.iter().map(|slice| u64::from(slice.end - slice.first)).max();
    longest.unwrap_or(0).saturating_mul(of_each).saturating_add(beside + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slices_cover_the_loop_and_none_is_too_long() {
        for (count, of_each) in [(1, 1), (50, 700), (16_384, 163), (1 << 20, 1), (4, 64_000)] {
            let slices = slices(count, of_each, 100);
            let ends = slices.iter().map(|slice| slice.end);
            let firsts: Vec<u32> = slices.iter().map(|slice| slice.first).collect();
            assert_eq!(firsts[0], 0);
            assert!(ends.clone().zip(&firsts[1..]).all(|(end, first)| end == *first));
            assert_eq!(ends.last(), Some(count));
            assert!(most_turns(&slices, of_each, 100) <= MOST_LOOP_TURNS);
        }
    }

    #[test]
    fn a_turn_that_is_too_long_alone_is_told() {
        let slices = slices(3, 100_000, 0);
        assert_eq!(slices.len(), 3);
        assert!(most_turns(&slices, 100_000, 0) > MOST_LOOP_TURNS);
    }
}
