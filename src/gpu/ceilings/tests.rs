use super::*;
use crate::Options;

/// Whether so many turns in place of so many are noticed.
fn skips(gpu: &Gpu, kernel: &BenchKernel, run: u32, told: u32) -> bool {
    kernel.reset(gpu);
    kernel.prepare(gpu, run);
    if run > 0 {
        gpu.run(&[&KernelRun { kernel, iterations: run }]).unwrap();
    }
    kernel.compare(gpu, told).unwrap().is_err()
}

/// Whether the result tells that nothing was done, and how many turns were. Of the others the law of doubled work tells it.
fn tells(limit: &Limit) -> [bool; 2] {
    match limit {
        Limit::SmallTriangles => [false, false],
        Limit::WriteCached => [true, false],
        Limit::Fill(_) => [true, false],
        _ => [true, true],
    }
}

#[test]
fn kernels_give_the_results_of_the_cpu_and_skipped_work_is_noticed() {
    let gpu = Gpu::open(&Options::default()).expect("an adapter is there");
    // The same kernels with larger buffers.
    let large = [Limit::ReadMemory, Limit::WriteMemory];
    for limit in limits(&gpu).into_iter().filter(|limit| !large.contains(limit)) {
        let kernel = kernel_of(&gpu, &limit).unwrap();
        let name = limit.name();
        assert_eq!(
            [skips(&gpu, &kernel, 0, 4), skips(&gpu, &kernel, 3, 4)],
            tells(&limit),
            "{name}"
        );
        assert_eq!(kernel.check(&gpu, 4).unwrap(), Ok(()), "{name}");
    }
}

/// What is measured of passes that take this long, ns, and the numbers of turns that are tried.
fn tried(max: u32, time_ns: impl Fn(u32) -> f64) -> (Vec<u32>, Ceiling) {
    let mut tried = Vec::new();
    let limit = Limit::SmallTriangles;
    let (turns, ceiling) = retry_until_sound(10, max, |turns| {
        tried.push(turns);
        // Three of seven rounds meet something else that runs.
        let round = |turns: u32| {
            let ns = time_ns(turns);
            (0..ROUNDS).map(|n| if n % 2 == 1 { 5.0 * ns } else { ns }).collect::<Vec<f64>>()
        };
        let [once, twice] = [turns, 2 * turns].map(round);
        Ok(compute_ceiling(&limit, f64::from(turns), &once, &twice))
    })
    .unwrap();
    assert_eq!(tried.last(), Some(&turns));
    (tried, ceiling)
}

#[test]
fn rates_are_positive_where_a_busy_machine_makes_times_negative() {
    let limit = Limit::SmallTriangles;
    let ceiling = compute_ceiling(
        &limit,
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
