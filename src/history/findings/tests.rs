use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use super::*;
use crate::run::FigureKey;
use crate::stored::{Point, SeriesKey};

fn key(cell: usize) -> SeriesKey {
    let cell = format!("cell {cell}");
    let names = ["a", "d", "quick", &cell, "0", "frame", "ns", ""];
    let figure = FigureKey::of_names(names.map(Into::into));
    SeriesKey { branch: "main".to_owned(), machine: "m".into(), figure }
}

fn stored(series: Vec<Vec<f64>>) -> StoredRuns {
    let series = series.into_iter().enumerate().map(|(cell, values)| {
        let point = |(run, median)| Point { run, value: Estimate { median, interval: None, n: 1 } };
        Series { key: key(cell), points: values.into_iter().enumerate().map(point).collect() }
    });
    StoredRuns { runs: Vec::new(), series: series.collect() }
}

/// `stepped` of so many series are slower by a share from run 25 on. The noise is of 1 %.
fn history(seed: u64, series: usize, stepped: usize, share: f64) -> StoredRuns {
    let mut random = Pcg64::seed_from_u64(seed);
    let mut noise = || (0..4).map(|_| random.random::<f64>() - 0.5).sum::<f64>() * 0.01 / 0.577;
    let of = |cell: usize, noise: &mut dyn FnMut() -> f64| -> Vec<f64> {
        let step = |run: usize| if cell < stepped && run >= 25 { 1.0 + share } else { 1.0 };
        (0..50).map(|run| 7e6 * step(run) * noise().exp()).collect()
    };
    stored((0..series).map(|cell| of(cell, &mut noise)).collect())
}

#[test]
fn sizes_have_intervals_that_hold_the_truth_and_larger_ones_come_first() {
    let mut all = history(1, 8, 8, 0.05);
    all.series[3].points[25..].iter_mut().for_each(|point| point.value.median *= 1.2 / 1.05);
    let findings = Findings::of(&all);
    assert_eq!((findings.changes.len(), findings.sure(), findings.searched), (8, 8, 8));
    assert_eq!(findings.changes[0].series, 3);
    for change in &findings.changes {
        let Size::Share(share) = change.size else { panic!("{change:?}") };
        let interval = share.interval.unwrap();
        let truth = if change.series == 3 { 0.2 } else { 0.05 };
        assert!(interval.low < truth + 0.01 && truth - 0.01 < interval.high, "{change:?}");
        assert!(change.at.abs_diff(25) <= 1 && change.n[0] + change.n[1] == 50, "{change:?}");
    }
}

#[test]
fn few_of_the_sure_changes_are_false() {
    let (mut sure, mut wrong) = (0, 0);
    for seed in 0..20 {
        let findings = Findings::of(&history(seed, 200, 10, 0.02));
        let told = findings.changes.iter().filter(|change| change.is_sure());
        for change in told {
            sure += 1;
            wrong += usize::from(change.series >= 10);
        }
    }
    // All but a few of 200 steps, and at most 5 % more that are none; three standard deviations.
    assert!(sure >= 180, "{sure}");
    assert!(wrong <= 20, "{wrong} of {sure}");
}

#[test]
fn a_stable_history_has_next_to_no_sure_change() {
    let sure: usize = (0..10).map(|seed| Findings::of(&history(seed, 200, 0, 0.0)).sure()).sum();
    assert!(sure <= 3, "{sure}");
}

#[test]
fn short_series_are_counted_and_zeros_have_differences() {
    let mut exact = vec![0.0; 20];
    exact.extend([0.5; 20]);
    let findings = Findings::of(&stored(vec![vec![1.0; LEAST_RUNS - 1], exact]));
    assert_eq!((findings.searched, findings.too_short), (1, 1));
    let [change] = findings.changes.as_slice() else { panic!("{findings:?}") };
    let Size::Difference(difference) = change.size else { panic!("{change:?}") };
    assert_eq!((difference.median, change.at, change.runs), (0.5, 20, [19, 20]));
}
