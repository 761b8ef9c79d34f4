use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use super::*;
use crate::run::FigureKey;
use crate::stored::{RunValue, SeriesKey};

fn key(cell: usize) -> SeriesKey {
    let cell = format!("cell {cell}");
    let names = ["a", "d", "quick", &cell, "0", "frame", "ns", ""];
    let figure = FigureKey::from_names(names.map(Into::into));
    SeriesKey { branch: "main".to_owned(), machine: "m".into(), figure }
}

fn stored(series: Vec<Vec<f64>>) -> StoredRuns {
    let series = series.into_iter().enumerate().map(|(cell, values)| {
        let point =
            |(run, median)| RunValue { run, value: Estimate { median, interval: None, n: 1 } };
        FigureSeries { key: key(cell), points: values.into_iter().enumerate().map(point).collect() }
    });
    StoredRuns { series: series.collect(), ..StoredRuns::default() }
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
    let findings = HistoryChanges::find(&all);
    assert_eq!(
        (findings.changes.len(), findings.count(Certainty::Sure), findings.searched),
        (8, 8, 8)
    );
    assert_eq!(findings.changes[0].series, 3);
    for change in &findings.changes {
        let Size::Share(share) = change.size else { panic!("{change:?}") };
        let interval = share.interval.unwrap();
        let truth = if change.series == 3 { 0.2 } else { 0.05 };
        assert!(interval.low < truth + 0.01 && truth - 0.01 < interval.high, "{change:?}");
        assert!(change.point.abs_diff(25) <= 1 && change.n[0] + change.n[1] == 50, "{change:?}");
    }
}

#[test]
fn few_of_the_sure_changes_are_false() {
    let (mut sure, mut wrong) = (0, 0);
    for seed in 0..20 {
        let findings = HistoryChanges::find(&history(seed, 200, 10, 0.02));
        let sure_changes = findings.changes.iter().filter(|change| change.is_sure());
        for change in sure_changes {
            sure += 1;
            wrong += usize::from(change.series >= 10);
        }
    }
    // All but a few of 200 steps, and at most 5 % more that are none; three standard deviations.
    assert!(sure >= 180, "{sure}");
    assert!(wrong <= 20, "{wrong} of {sure}");
}

#[test]
fn short_series_are_counted_and_zeros_have_differences() {
    let mut exact = vec![0.0; 20];
    exact.extend([0.5; 20]);
    let findings = HistoryChanges::find(&stored(vec![vec![1.0; MIN_RUNS - 1], exact]));
    assert_eq!((findings.searched, findings.too_short), (1, 1));
    let [change] = findings.changes.as_slice() else { panic!("{findings:?}") };
    let Size::Difference(difference) = change.size else { panic!("{change:?}") };
    assert_eq!((difference.median, change.point, change.runs), (0.5, 20, [19, 20]));
}

/// A history on a machine whose times take `machine` times as long in a run, as its limits tell; `program` is what the commits do.
/// All of 8 times are of the program, and 6 limits of the machine. The noise is of 1 %.
fn on_machine(
    seed: u64,
    machine: impl Fn(usize) -> f64,
    program: impl Fn(usize) -> f64,
) -> StoredRuns {
    let mut random = Pcg64::seed_from_u64(seed);
    let mut noise = || (0..4).map(|_| random.random::<f64>() - 0.5).sum::<f64>() * 0.01 / 0.577;
    let mut series = |of: &dyn Fn(usize) -> f64| -> Vec<f64> {
        (0..60).map(|run| of(run) * noise().exp()).collect()
    };
    let times = (0..8).map(|_| series(&|run| 7e6 * machine(run) * program(run))).collect();
    let limits = (0..6).map(|_| series(&|run| 3e9 / machine(run))).collect();
    let mut all = stored(times);
    all.controls = stored(limits).series;
    for control in &mut all.controls {
        let names =
            ["a", "d", "", "limits of the adapter", "", &control.key.figure.cell, "B/s", ""];
        control.key.figure = FigureKey::from_names(names.map(Into::into));
    }
    all
}

fn step(at: usize, share: f64) -> impl Fn(usize) -> f64 {
    move |run| if run < at { 1.0 } else { 1.0 + share }
}

/// 20 % over the history.
fn ramp(run: usize) -> f64 {
    (0.2 * run as f64 / 60.0).exp()
}

fn still(_: usize) -> f64 {
    1.0
}

/// Places and sizes of the changes that are told of commits, and the number of those of the machine, over so many histories.
fn simulate(
    histories: u64,
    machine: impl Fn(usize) -> f64,
    program: impl Fn(usize) -> f64,
) -> (Vec<(usize, f64)>, usize) {
    let all =
        (0..histories).map(|seed| HistoryChanges::find(&on_machine(seed, &machine, &program)));
    let (drift, changes): (Vec<SeriesChange>, Vec<SeriesChange>) = all
        .flat_map(|findings| findings.changes)
        .partition(|change| change.certainty() == Certainty::Drift);
    let of = |change: &SeriesChange| (change.point, change.size.estimate().median);
    (changes.iter().map(of).collect(), drift.len())
}

#[test]
fn drift_of_the_machine_is_no_change_of_a_commit() {
    // 400 series each. Of 20, one has a change by chance, and an interval of 95 % misses.
    let (changes, drift) = simulate(50, step(30, 0.08), still);
    assert!(changes.len() <= 40 && drift >= 360, "{} {drift}", changes.len());
    let (changes, drift) = simulate(50, ramp, still);
    assert!(changes.len() <= drift / 10 && drift >= 400, "{} {drift}", changes.len());
}

#[test]
fn a_change_during_drift_is_told_with_its_own_size() {
    let mean =
        |found: &[(usize, f64)]| found.iter().map(|(_, s)| s).sum::<f64>() / found.len() as f64;
    for (name, machine) in [
        ("still", &still as &dyn Fn(usize) -> f64),
        ("a step in the same night", &step(30, 0.1)),
        ("back in the same night", &step(30, -0.03)),
        ("a step in another night", &step(45, 0.1)),
        ("drift", &ramp),
    ] {
        let (changes, _) = simulate(20, machine, step(30, 0.06));
        let there: Vec<(usize, f64)> =
            changes.into_iter().filter(|(at, _)| at.abs_diff(30) <= 2).collect();
        assert!(there.len() >= 150, "{name}: {}", there.len());
        assert!((mean(&there) - 0.06).abs() < 0.005, "{name}: {}", mean(&there));
    }
}

#[test]
fn controls_of_another_machine_explain_nothing() {
    let mut all = on_machine(1, step(30, 0.08), still);
    all.controls.iter_mut().for_each(|control| control.key.machine = "other".into());
    let findings = HistoryChanges::find(&all);
    assert_eq!((findings.count(Certainty::Sure), findings.count(Certainty::Drift)), (8, 0));
}
