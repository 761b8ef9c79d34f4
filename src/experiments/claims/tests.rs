use std::collections::BTreeMap;

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use serde_json::{Map, Value, json};

use super::*;
use crate::record::{Clock, Fenced, FrameRecord, Measured, Outcome, StageRecord, Work};
use crate::statistics;

/// About 3 %, log-normal.
fn noise(random: &mut Pcg64) -> f64 {
    let normal: f64 = (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
    (0.03 * normal).exp()
}

/// A cell with one axis, one stage and one quantity; the frame takes as long as the stage.
fn cell(axes: &[(&str, Value)], ms: f64, random: &mut Pcg64) -> Cell {
    let samples_ns: Vec<f64> = (0..21).map(|_| ms * 1e6 * noise(random)).collect();
    let time = statistics::estimate(&samples_ns);
    let axes: Map<String, Value> =
        axes.iter().map(|(name, value)| ((*name).to_owned(), value.clone())).collect();
    let stage = StageRecord {
        stage: "s".to_owned(),
        clock: Clock::Timestamp,
        samples_ns: samples_ns.clone(),
        time,
        fenced: None,
        work: Work::default(),
        counters: BTreeMap::new(),
    };
    let measured = Measured {
        stages: vec![stage],
        frame: FrameRecord {
            untimed_samples_ns: samples_ns,
            untimed: time,
            ..FrameRecord::default()
        },
        quantities: BTreeMap::from([("error".to_owned(), ms)]),
        ..Measured::default()
    };
    Cell {
        experiment: "e".to_owned(),
        cell: String::new(),
        axes,
        pipeline: "p".to_owned(),
        scene: "tank".to_owned(),
        stand_ins: Vec::new(),
        params: json!({}),
        outcome: Outcome::Measured(Box::new(measured)),
    }
}

/// Cells along the axis `n` whose stage takes `ms(n)`.
fn swept(values: &[f64], ms: impl Fn(f64) -> f64) -> Vec<Cell> {
    let mut random = Pcg64::seed_from_u64(11);
    values.iter().map(|n| cell(&[("n", json!(n))], ms(*n), &mut random)).collect()
}

fn ruled(test: &str, cells: &[Cell], software: bool) -> (Verdict, String) {
    let text = format!(
        r#"
        id = "e"
        title = "t"
        source = "s"
        pipeline = "p"
        scene = "tank"
        [[sweep]]
        [[sweep.axis]]
        name = "n"
        values = [1]
        [[claim]]
        id = "c"
        text = "x"
        test.{test}
        "#
    );
    let experiment = Experiment::parse("e", &text).unwrap();
    let cells: Vec<&Cell> = cells.iter().collect();
    let ruling = experiment.rulings(&cells, software).remove(0);
    (ruling.verdict, ruling.reason)
}

const GRID: [f64; 6] = [1e3, 3e3, 1e4, 3e4, 1e5, 3e5];
const LINEAR: &str =
    r#"slope = { y = "stage:s", x = "axis:n", over = "n", expected = 1.0, tolerance = 0.1 }"#;

#[test]
fn a_known_slope_is_recovered_from_noise_above_a_fixed_cost() {
    for exponent in [0.5, 1.0, 2.0] {
        let cells = swept(&GRID, |n| 1e-3 * n.powf(exponent));
        let cells: Vec<&Cell> = cells.iter().collect();
        let (y, x) = ("stage:s".parse().unwrap(), "axis:n".parse().unwrap());
        // A square root is all fixed cost to an affine fit: allow for it.
        let fit = scaling(&y, &x, &cells, 1.0).unwrap();
        assert!((fit.slope.slope - exponent).abs() < 0.02, "{fit:?}");
        assert!(fit.slope.low <= exponent && exponent <= fit.slope.high);
    }
}

#[test]
fn linear_time_supports_linearity_and_other_powers_contradict_it() {
    let linear = swept(&GRID, |n| 0.5 + 1e-3 * n);
    let (verdict, reason) = ruled(LINEAR, &linear, true);
    assert_eq!(verdict, Verdict::Supported, "{reason}");
    for exponent in [0.8, 1.2] {
        let bent = swept(&GRID, |n| 1e-3 * n.powf(exponent));
        let (verdict, reason) = ruled(LINEAR, &bent, true);
        assert_ne!(verdict, Verdict::Supported, "{exponent}: {reason}");
    }
    let steep = swept(&GRID, |n| 1e-3 * n.powf(1.3));
    assert_eq!(ruled(LINEAR, &steep, true).0, Verdict::Contradicted);
}

#[test]
fn cells_below_the_fixed_cost_are_left_out_and_counted() {
    let cells = swept(&GRID, |n| 1.0 + 1e-3 * n);
    let (verdict, reason) = ruled(LINEAR, &cells, true);
    assert_eq!(verdict, Verdict::Supported, "{reason}");
    assert!(reason.contains("2 left out below a fixed cost"), "{reason}");
    let dear = swept(&GRID, |n| 8.0 + 1e-3 * n);
    let (verdict, reason) = ruled(LINEAR, &dear, true);
    assert_eq!(verdict, Verdict::Untestable);
    assert!(reason.ends_with("ms is more than 10 % of the time in 4 of 6 cells"), "{reason}");
}

#[test]
fn too_few_cells_or_too_short_a_range_decide_nothing() {
    let few = swept(&GRID[..2], |n| n);
    let (verdict, reason) = ruled(LINEAR, &few, true);
    assert_eq!(verdict, Verdict::Untestable);
    assert_eq!(reason, "2 measured cells, and a slope needs 3");
    let short = swept(&[1e3, 2e3, 4e3], |n| n);
    let (verdict, reason) = ruled(LINEAR, &short, true);
    assert_eq!(verdict, Verdict::Untestable);
    assert!(reason.ends_with("1 decades are needed"), "{reason}");
    assert_eq!(ruled(LINEAR, &[], true).1, "no cell along `n`");
}

#[test]
fn independence_flips_with_a_perturbed_cell() {
    let test = r#"independent = { y = "stage:s", over = "n", tolerance = 0.15 }"#;
    let mut cells = swept(&[1.0, 2.0, 4.0], |_| 5.0);
    assert_eq!(ruled(test, &cells, true).0, Verdict::Supported);
    cells[1] = swept(&[2.0], |_| 7.0).remove(0);
    assert_eq!(ruled(test, &cells, true).0, Verdict::Contradicted);
}

#[test]
fn ratios_lie_within_their_band_or_do_not() {
    let test = r#"ratio = { y = "stage:s", over = "n", numerator = 2, denominator = 1, low = 1.05, high = 2.0 }"#;
    let at = |ratio: f64| swept(&[1.0, 2.0], move |n| if n > 1.0 { 5.0 * ratio } else { 5.0 });
    assert_eq!(ruled(test, &at(1.5), true).0, Verdict::Supported);
    assert_eq!(ruled(test, &at(0.9), true).0, Verdict::Contradicted);
    assert_eq!(ruled(test, &at(2.4), true).0, Verdict::Contradicted);
    let (verdict, reason) = ruled(test, &at(1.05), true);
    assert_eq!(verdict, Verdict::Untestable);
    assert!(reason.contains("straddles"), "{reason}");
    assert_eq!(ruled(test, &at(1.5)[..1], true).0, Verdict::Untestable);
}

#[test]
fn absolute_rates_count_only_on_hardware() {
    let test = r#"at_least = { y = "fps", value = 60 }"#;
    let fast = swept(&[1.0], |_| 5.0);
    assert_eq!(ruled(test, &fast, false).0, Verdict::Supported);
    let (verdict, reason) = ruled(test, &fast, true);
    assert_eq!(verdict, Verdict::Untestable);
    assert!(reason.contains("only on hardware"), "{reason}");
    let slow = swept(&[1.0], |_| 50.0);
    assert_eq!(ruled(test, &slow, false).0, Verdict::Contradicted);
}

#[test]
fn no_worse_compares_two_cells() {
    let test = r#"no_worse = { y = "quantity:error", of = { n = 2 }, than = { n = 1 } }"#;
    let better = swept(&[1.0, 2.0], |n| 1.0 / n);
    assert_eq!(ruled(test, &better, true).0, Verdict::Supported);
    let worse = swept(&[1.0, 2.0], |n| n);
    assert_eq!(ruled(test, &worse, true).0, Verdict::Contradicted);
    let (verdict, reason) = ruled(test, &better[..1], true);
    assert_eq!(verdict, Verdict::Untestable);
    assert_eq!(reason, "error was not recorded in both cells");
}

#[test]
fn monotony_flips_with_one_cell_out_of_order() {
    let test = r#"monotone = { y = "stage:s", x = "axis:n", over = "n", direction = "rising", tolerance = 0.05 }"#;
    let falling = test.replace("rising", "falling");
    let mut cells = swept(&[1.0, 2.0, 3.0, 4.0], |n| n);
    assert_eq!(ruled(test, &cells, true).0, Verdict::Supported);
    assert_eq!(ruled(&falling, &cells, true).0, Verdict::Contradicted);
    cells[2] = swept(&[3.0], |_| 1.0).remove(0);
    assert_eq!(ruled(test, &cells, true).0, Verdict::Contradicted);
}

#[test]
fn groups_are_ruled_apart_and_the_worst_decides() {
    let mut random = Pcg64::seed_from_u64(5);
    let mut cells = Vec::new();
    for (model, exponent) in [("a", 1.0), ("b", 1.5)] {
        for n in GRID {
            let axes = [("n", json!(n)), ("model", json!(model))];
            cells.push(cell(&axes, 1e-3 * n.powf(exponent), &mut random));
        }
    }
    let (verdict, reason) = ruled(LINEAR, &cells, true);
    assert_eq!(verdict, Verdict::Contradicted);
    assert!(reason.contains("model=a: slope 1.0") || reason.contains("model=a: slope 0.99"));
    assert!(reason.contains("model=b: slope 1.5") || reason.contains("model=b: slope 1.49"));
}

#[test]
fn skipped_cells_leave_a_claim_untestable() {
    let mut cells = swept(&GRID, |n| n);
    for cell in &mut cells[2..] {
        cell.outcome = Outcome::Skipped { reason: "too large".to_owned() };
    }
    assert_eq!(ruled(LINEAR, &cells, true).0, Verdict::Untestable);
}

#[test]
fn an_affine_time_is_told_from_a_bent_one() {
    let test = r#"affine = { y = "stage:s", x = "axis:n", over = "n", tolerance = 0.08 }"#;
    let sizes = [480.0, 786.0, 1310.0, 1920.0, 2304.0];
    let (verdict, reason) = ruled(test, &swept(&sizes, |n| 200.0 + n), true);
    assert_eq!(verdict, Verdict::Supported, "{reason}");
    assert!(reason.contains("5 cells"), "{reason}");
    let bent = swept(&sizes, |n| 1e-3 * n * n);
    assert_eq!(ruled(test, &bent, true).0, Verdict::Contradicted);
    let falling = swept(&sizes, |n| 5e3 - n);
    assert_eq!(ruled(test, &falling, true).0, Verdict::Contradicted);
    let (verdict, reason) = ruled(test, &swept(&sizes, |n| 1e4 + n), true);
    assert_eq!(verdict, Verdict::Untestable);
    assert!(reason.ends_with("50 % are needed"), "{reason}");
    let few = swept(&sizes[..3], |n| n);
    assert_eq!(ruled(test, &few, true).0, Verdict::Untestable);
}

#[test]
fn noise_that_falls_with_the_root_of_the_samples_has_a_slope_of_minus_a_half() {
    let test = r#"slope = { y = "quantity:error", x = "axis:n", over = "n", expected = -0.5, tolerance = 0.05 }"#;
    let rays = [4.0, 8.0, 16.0, 32.0, 64.0];
    let (verdict, reason) = ruled(test, &swept(&rays, |n| 1.0 / n.sqrt()), true);
    assert_eq!(verdict, Verdict::Supported, "{reason}");
    let flat = swept(&rays, |n| 0.1 + 1.0 / n.sqrt());
    assert_ne!(ruled(test, &flat, true).0, Verdict::Supported);
    // One cell off: the interval over the cells shows it.
    let mut bent = swept(&rays, |n| 1.0 / n.sqrt());
    bent[4] = swept(&[64.0], |_| 0.5).remove(0);
    assert_ne!(ruled(test, &bent, true).0, Verdict::Supported);
}

#[test]
fn the_lowest_value_is_held_against_all_others() {
    let test = r#"lowest = { y = "quantity:error", over = "n", value = 2 }"#;
    let errors = |of: [f64; 3]| swept(&[1.0, 2.0, 3.0], move |n| of[n as usize - 1]);
    let (verdict, reason) = ruled(test, &errors([0.4, 0.1, 0.2]), true);
    assert_eq!(verdict, Verdict::Supported, "{reason}");
    assert!(reason.contains("lowest of 2 others: 0.500"), "{reason}");
    assert_eq!(ruled(test, &errors([0.4, 0.1, 0.09]), true).0, Verdict::Contradicted);
    assert_eq!(ruled(test, &errors([0.4, 0.1, 0.2])[..1], true).0, Verdict::Untestable);
}

#[test]
fn a_minimum_needs_cells_on_both_sides_of_its_band() {
    let test =
        r#"minimum = { y = "quantity:error", x = "axis:n", over = "n", low = 0.2, high = 0.8 }"#;
    let values = [0.05, 0.2, 0.5, 0.8, 0.95];
    let around = |best: f64| swept(&values, move |n| 0.1 + (n - best).abs());
    let (verdict, reason) = ruled(test, &around(0.5), true);
    assert_eq!(verdict, Verdict::Supported);
    assert_eq!(reason, "lowest at 0.5: 0.1000");
    assert_eq!(ruled(test, &around(0.95), true).0, Verdict::Contradicted);
    let one_sided = &around(0.5)[..4];
    assert_eq!(ruled(test, one_sided, true).0, Verdict::Untestable);
    // Times of 3 % noise that differ by less.
    let timed = test.replace("quantity:error", "stage:s");
    let (verdict, reason) = ruled(&timed, &swept(&values, |_| 5.0), true);
    assert_eq!(verdict, Verdict::Untestable);
    assert!(reason.contains("within the noise"), "{reason}");
}

#[test]
fn families_of_stages_are_summed_frame_by_frame() {
    let mut random = Pcg64::seed_from_u64(3);
    let mut cell = cell(&[], 4.0, &mut random);
    let measured = cell.measured_mut().unwrap();
    let mut other = measured.stages[0].clone();
    other.samples_ns.reverse();
    for (stage, reversed) in [("f/a", false), ("f/b", true)] {
        let mut record = if reversed { other.clone() } else { measured.stages[0].clone() };
        record.stage = stage.to_owned();
        measured.stages.push(record);
    }
    let measured = cell.measured().unwrap();
    let read = |text: &str| text.parse::<Measure>().unwrap().read(&cell, measured);
    let sum = read("stage:f/").unwrap();
    let samples = sum.samples.unwrap();
    assert_eq!(samples[0], measured.stages[1].samples_ns[0] + measured.stages[2].samples_ns[0]);
    assert!((sum.estimate.median / 8e6 - 1.0).abs() < 0.05);
    assert_eq!(read("stage:g/x|s").unwrap().estimate, measured.stages[0].time);
    assert_eq!(read("stage:g/"), None);
    let names: Measure = "stage:g/x|s".parse().unwrap();
    assert_eq!(names.stages().map(ToString::to_string).collect::<Vec<_>>(), ["g/x", "s"]);
    assert_eq!(names.to_string(), "g/x or s time");
}

#[test]
fn a_time_below_the_clock_s_resolution_is_no_figure() {
    let mut random = Pcg64::seed_from_u64(4);
    let mut cell = cell(&[], 4.0, &mut random);
    let measured = cell.measured_mut().unwrap();
    let mut short = measured.stages[0].clone();
    short.stage = "f/short".to_owned();
    // Half of the differences are negative.
    let wall_ns = |frame: usize| 60e3 + if frame.is_multiple_of(2) { 5e3 } else { -5e3 };
    let fenced = Fenced {
        wall_samples_ns: (0..short.samples_ns.len()).map(wall_ns).collect(),
        submit_cost_samples_ns: vec![60e3; short.samples_ns.len()],
        resolution_ns: 50e3,
    };
    short.samples_ns = fenced.samples_ns();
    short.time = statistics::estimate(&short.samples_ns);
    short.fenced = Some(fenced);
    assert!(short.samples_ns.iter().all(|ns| *ns == 50e3));
    let mut long = measured.stages[0].clone();
    long.stage = "f/long".to_owned();
    measured.stages.extend([short, long]);
    let measured = cell.measured().unwrap();
    let read = |text: &str| text.parse::<Measure>().unwrap().read(&cell, measured);
    assert_eq!(read("stage:f/short"), None);
    assert_eq!(read("stage:s per stage:f/short"), None);
    let sum = read("stage:f/").unwrap().estimate.median;
    let alone = read("stage:f/long").unwrap().estimate.median;
    assert!((sum - alone).abs() <= 5e3, "{sum} and {alone}");
}

#[test]
fn quotients_of_a_cell_lie_within_a_band_or_do_not() {
    let test = r#"within = { y = "quantity:error per axis:n", low = 7.9, high = 8.1 }"#;
    let eight = swept(&[1.0, 2.0, 5.0], |n| 8.0 * n);
    let (verdict, reason) = ruled(test, &eight, true);
    assert_eq!(verdict, Verdict::Supported, "{reason}");
    assert!(reason.starts_with("8.00 (8.00 – 8.00) error per n"), "{reason}");
    let mut other = eight;
    other[1] = swept(&[2.0], |_| 10.0).remove(0);
    assert_eq!(ruled(test, &other, true).0, Verdict::Contradicted);
    let timed = r#"within = { y = "stage:s per axis:n", low = 1.0, high = 2.0 }"#;
    assert_eq!(ruled(timed, &other, true).0, Verdict::Untestable);
}
