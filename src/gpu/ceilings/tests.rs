use super::kernel::{Turns, check};
use super::*;
use crate::Options;

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

/// What is measured of passes that take this long, ns, and the numbers of turns that are tried.
fn tried(most: u32, time_ns: impl Fn(u32) -> f64) -> (Vec<u32>, Ceiling) {
    let mut tried = Vec::new();
    let limit = Limit::Arithmetic { pass: PassKind::Compute };
    let (turns, ceiling) = attempted(10, most, |turns| {
        tried.push(turns);
        // Three of seven rounds meet something else that runs.
        let round = |turns: u32| {
            let ns = time_ns(turns);
            (0..ROUNDS).map(|n| if n % 2 == 1 { 5.0 * ns } else { ns }).collect::<Vec<f64>>()
        };
        let [once, twice] = [turns, 2 * turns].map(round);
        Ok(of_times(limit, f64::from(turns), &once, &twice))
    })
    .unwrap();
    assert_eq!(tried.last(), Some(&turns));
    (tried, ceiling)
}

#[test]
fn rates_are_positive_where_a_busy_machine_makes_times_negative() {
    let limit = Limit::Arithmetic { pass: PassKind::Compute };
    let ceiling = of_times(
        limit,
        10.0,
        &[-5.0, 9.0, -2.0, 8.0, 7.0, 9.0, 8.0],
        &[-8.0, 8.0, -9.0, 16.0, 9.0, 20.0, 15.0],
    );
    assert!(ceiling.rate.ends().into_iter().all(|rate| rate > 0.0 && rate.is_finite()));
}

#[test]
fn more_work_makes_fixed_costs_small_and_leaves_skipped_work_unsound() {
    let free = |turns| f64::from(turns);
    assert_eq!(tried(1 << 20, free).0, [10]);
    // A fixed cost as large as the work: doubling 1.5, then 1.8.
    let (turns, ceiling) = tried(1 << 20, |turns| 10.0 + f64::from(turns));
    assert_eq!((turns.as_slice(), ceiling.is_sound()), ([10, 40].as_slice(), true));
    assert!((ceiling.rate.median * 1e-9 - 1.0).abs() < 1e-12, "{ceiling:?}");
    // A driver that does no more than so much, and one that skips the second half.
    for skipping in [|turns: u32| f64::from(turns.min(10)), |_: u32| 5.0] {
        let (turns, ceiling) = tried(1 << 20, skipping);
        assert_eq!((turns.as_slice(), ceiling.is_sound()), ([10, 40, 160].as_slice(), false));
    }
    // Never more than there may be, and no more where a busy machine made the second half too long.
    assert_eq!(tried(20, |_| 5.0).0, [10, 20, 20]);
    assert_eq!(tried(1 << 20, |turns| f64::from(turns).powi(2)).0, [10, 10, 10]);
}
