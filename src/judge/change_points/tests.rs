use std::ops::Range;

use proptest::prelude::*;
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use super::*;
use crate::rank::normal;

fn points(values: &[f64]) -> Vec<usize> {
    change_points(values, &mut Scores::default()).iter().map(|point| point.first).collect()
}

fn noise(random: &mut Pcg64, n: usize) -> Vec<f64> {
    (0..n).map(|_| normal(random)).collect()
}

/// One run in ten is six standard deviations slow.
fn with_outliers(random: &mut Pcg64, n: usize) -> Vec<f64> {
    let slow = |random: &mut Pcg64| if random.random_bool(0.1) { 6.0 } else { 0.0 };
    (0..n).map(|_| normal(random) + slow(random)).collect()
}

#[test]
fn a_constant_series_has_no_change() {
    for n in [0, 1, 11, 12, 100, 1_000] {
        assert_eq!(points(&vec![3.5; n]), [0_usize; 0]);
    }
}

/// The same values, higher by a step in some of the runs.
fn raised(mut values: Vec<f64>, runs: Range<usize>, step: f64) -> Vec<f64> {
    values[runs].iter_mut().for_each(|value| *value += step);
    values
}

#[test]
fn steps_are_found_where_they_are() {
    let mut random = Pcg64::seed_from_u64(1);
    for (n, runs, expected) in [
        (24, 12..24, vec![12]),
        (60, 20..60, vec![20]),
        (60, 52..60, vec![52]),
        (1_000, 700..1_000, vec![700]),
        // A slowdown that was repaired.
        (1_000, 480..495, vec![480, 495]),
    ] {
        assert_eq!(points(&raised(noise(&mut random, n), runs, 6.0)), expected, "of {n}");
    }
    for (first, expected) in [(31, vec![31]), (38, Vec::new())] {
        assert_eq!(points(&raised(vec![0.25; 40], first..40, 0.01)), expected, "without noise");
    }
}

#[test]
fn min_runs_are_the_fewest_that_reach_the_level() {
    let step = |n: usize| -> Vec<f64> {
        (0..n).map(|i| i as f64 * 1e-3 + f64::from(u8::from(i >= n / 2))).collect()
    };
    let p = |n: usize| {
        let at = n / 2;
        max_split_p_value(split_p_value(((n - 1) as f64).sqrt(), at, n, 1), n) / WHOLE_SHARE
    };
    assert!(p(MIN_RUNS) <= LEVEL, "{}", p(MIN_RUNS));
    assert!(p(MIN_RUNS - 1) > LEVEL, "{}", p(MIN_RUNS - 1));
    assert_eq!(points(&step(MIN_RUNS - 1)), [0_usize; 0]);
    assert_eq!(points(&step(16)), [8]);
}

type DrawSeries = fn(&mut Pcg64, usize) -> Vec<f64>;

/// False points in 1,000 stable series.
fn false_points(seed: u64, n: usize, draw: DrawSeries) -> usize {
    let mut random = Pcg64::seed_from_u64(seed);
    let mut scores = Scores::default();
    (0..1_000).map(|_| change_points(&draw(&mut random, n), &mut scores).len()).sum()
}

#[test]
fn stable_series_have_few_false_points_whatever_their_noise() {
    for (n, draw) in [(30, noise as DrawSeries), (30, with_outliers), (120, with_outliers)] {
        let found = false_points(3, n, draw);
        // At most the level of 1,000, and three standard deviations.
        assert!(found <= 128, "{found} of 1,000 series of {n} runs");
    }
}

#[test]
fn probabilities_hold_for_every_arrangement() {
    let mut random = Pcg64::seed_from_u64(9);
    let mut values = with_outliers(&mut random, 40);
    let mut scores = Scores::default();
    let mut below = [0; 2];
    for _ in 0..2_000 {
        values.shuffle(&mut random);
        let p = best_split(&values, &mut scores).unwrap().p;
        below[0] += u32::from(p <= 0.05);
        below[1] += u32::from(p <= 0.01);
    }
    // At most the level, with three standard deviations of 2,000 draws, and not far below it.
    assert!((25..=129).contains(&below[0]), "{below:?}");
    assert!((2..=33).contains(&below[1]), "{below:?}");
}

proptest! {
    #[test]
    fn units_and_logarithms_change_nothing(seed in 0_u64..500, factor in 1e-9_f64..1e9) {
        let mut random = Pcg64::seed_from_u64(seed);
        let values = raised(noise(&mut random, 50), 30..50, 1.5);
        let times: Vec<f64> = values.iter().map(|value| (0.01 * value).exp()).collect();
        let scaled: Vec<f64> = times.iter().map(|time| factor * time).collect();
        prop_assert_eq!(points(&values), points(&times));
        prop_assert_eq!(points(&scaled), points(&times));
    }

    #[test]
    fn backwards_in_time_the_changes_are_the_same(seed in 0_u64..200) {
        let mut random = Pcg64::seed_from_u64(seed);
        let mut values = raised(noise(&mut random, 60), 25..60, 5.0);
        let forwards = points(&values);
        values.reverse();
        let backwards: Vec<usize> = points(&values).iter().rev().map(|at| 60 - at).collect();
        prop_assert_eq!(forwards, backwards);
    }
}
