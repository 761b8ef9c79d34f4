use super::kernel::{Turns, check};
use super::*;
use crate::gpu::Options;

/// Runs fewer turns than the CPU is told of.
fn skips(gpu: &Gpu, kernel: &dyn Kernel, run: u32, told: u32) -> bool {
    kernel.reset(gpu);
    kernel.prepare(gpu, run);
    if run > 0 {
        gpu.run(&[&Turns { kernel, turns: run }]).unwrap();
    }
    kernel.compare(gpu, told).unwrap().is_err()
}

/// Whether a run that does nothing leaves the same as one that works.
fn leaves_no_trace(limit: Limit) -> bool {
    use SmallPrimitive::{ClippedPoint, CulledTriangle};
    match limit {
        Limit::EmptyPass { pass } => pass != PassKind::Compute,
        Limit::Primitives { primitive } => matches!(primitive, CulledTriangle | ClippedPoint),
        _ => false,
    }
}

/// Whether the result tells the number of turns. Of the others the law of doubled work tells it.
fn counts_turns(limit: Limit) -> bool {
    match limit {
        Limit::Copy { .. } | Limit::Write { .. } => false,
        Limit::Fill { blending, .. } => blending == Blending::Additive,
        _ => !leaves_no_trace(limit),
    }
}

#[test]
fn kernels_give_the_results_of_the_cpu_and_skipped_work_is_noticed() {
    const SMALL_BYTES: u64 = 1 << 20;
    let gpu = Gpu::open(&Options::default()).expect("an adapter is there");
    let all = limits(&gpu).into_iter();
    let small = |limit: &Limit| limit.working_set_bytes().is_none_or(|bytes| bytes <= SMALL_BYTES);
    for limit in all.filter(small) {
        let kernel = kernel::of(&gpu, limit).unwrap();
        let name = limit.name();
        assert_eq!(skips(&gpu, kernel.as_ref(), 0, 4), !leaves_no_trace(limit), "{name}, not run");
        assert_eq!(check(&gpu, kernel.as_ref(), 4).unwrap(), Ok(()), "{name}");
        assert_eq!(skips(&gpu, kernel.as_ref(), 3, 4), counts_turns(limit), "{name}, clamped");
    }
}

#[test]
fn working_sets_reach_from_the_first_cache_to_beyond_the_last() {
    let gpu = Gpu::open(&Options::default()).expect("an adapter is there");
    let sets = working_sets(&gpu, MOST_SET_BYTES);
    assert_eq!(sets[0], SMALLEST_SET_BYTES);
    assert!(sets.windows(2).all(|pair| pair[1] == SET_STEP * pair[0]));
    let cache = last_cache_bytes().unwrap_or(ASSUMED_CACHE_BYTES);
    let last = *sets.last().unwrap();
    assert!(last >= (CACHES * cache).min(MOST_SET_BYTES / SET_STEP), "{last} of {cache}");
    assert!(working_sets(&gpu, SMALLEST_SET_BYTES).len() == 1);
}
