use std::collections::BTreeMap;

use rand::SeedableRng;
use rand_pcg::Pcg64;
use serde_json::{Map, Value, json};

use super::Verdict::{Contradicted, Supported, Untestable};
use super::*;
use crate::record::{Clock, Fenced, FrameRecord, Measured, Outcome, Work};
use crate::report::fixtures::{noisy, timed};
use crate::statistics;

/// A cell with one axis, one stage and one quantity; the frame takes as long as the stage.
fn cell(axes: &[(&str, Value)], ms: f64, random: &mut Pcg64) -> Cell {
    let axes: Map<String, Value> =
        axes.iter().map(|(name, value)| ((*name).to_owned(), value.clone())).collect();
    let stage = timed("s", Clock::Timestamp, noisy(ms * 1e6, 21, random), Work::default());
    let measured = Measured {
        frame: FrameRecord {
            untimed_samples_ns: stage.samples_ns.clone(),
            untimed: stage.time,
            ..FrameRecord::default()
        },
        stages: vec![stage],
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

/// The same but for the cell at one place.
fn but(place: usize, n: f64, ms: f64, mut cells: Vec<Cell>) -> Vec<Cell> {
    cells[place] = swept(&[n], |_| ms).remove(0);
    cells
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

/// Rules on a claim for each set of cells on a software driver: the verdict, and a part of its reason, in which `^` and `$`
/// stand for the reason's beginning and end.
#[track_caller]
fn all_ruled<const N: usize>(test: &str, cases: [(&str, Vec<Cell>, Verdict, &str); N]) {
    for (name, cells, expected, part) in cases {
        let (verdict, reason) = ruled(test, &cells, true);
        assert_eq!(verdict, expected, "{name}: {reason}");
        assert!(format!("^{reason}$").contains(part), "{name}: {reason}");
    }
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
    for exponent in [0.8, 1.2] {
        let bent = swept(&GRID, |n| 1e-3 * n.powf(exponent));
        let (verdict, reason) = ruled(LINEAR, &bent, true);
        assert_ne!(verdict, Supported, "{exponent}: {reason}");
    }
    let mut skipped = swept(&GRID, |n| n);
    for cell in &mut skipped[2..] {
        cell.outcome = Outcome::Skipped { reason: "too large".to_owned() };
    }
    let dear = swept(&GRID, |n| 8.0 + 1e-3 * n);
    let short = swept(&[1e3, 2e3, 4e3], |n| n);
    let steep = swept(&GRID, |n| 1e-3 * n.powf(1.3));
    let left_out = "2 left out below a fixed cost";
    let costs = "ms is more than 10 % of the time in 4 of 6 cells$";
    let few = "^2 measured cells, and a slope needs 3$";
    all_ruled(
        LINEAR,
        [
            ("linear", swept(&GRID, |n| 0.5 + 1e-3 * n), Supported, ""),
            ("steep", steep, Contradicted, ""),
            ("a fixed cost", swept(&GRID, |n| 1.0 + 1e-3 * n), Supported, left_out),
            ("a high fixed cost", dear, Untestable, costs),
            ("few cells", swept(&GRID[..2], |n| n), Untestable, few),
            ("a short range", short, Untestable, "1 decades are needed$"),
            ("no cell", Vec::new(), Untestable, "^no cell along `n`$"),
            ("skipped cells", skipped, Untestable, ""),
        ],
    );
}

#[test]
fn independence_flips_with_a_perturbed_cell() {
    let alike = || swept(&[1.0, 2.0, 4.0], |_| 5.0);
    let cases = [
        ("alike", alike(), Supported, ""),
        ("one apart", but(1, 2.0, 7.0, alike()), Contradicted, ""),
    ];
    all_ruled(r#"independent = { y = "stage:s", over = "n", tolerance = 0.15 }"#, cases);
}

#[test]
fn ratios_lie_within_their_band_or_do_not() {
    let test = r#"ratio = { y = "stage:s", over = "n", numerator = 2, denominator = 1, low = 1.05, high = 2.0 }"#;
    let at = |ratio: f64| swept(&[1.0, 2.0], move |n| if n > 1.0 { 5.0 * ratio } else { 5.0 });
    all_ruled(
        test,
        [
            ("inside", at(1.5), Supported, ""),
            ("below", at(0.9), Contradicted, ""),
            ("above", at(2.4), Contradicted, ""),
            ("at the edge", at(1.05), Untestable, "straddles"),
            ("one cell", at(1.5)[..1].to_vec(), Untestable, ""),
        ],
    );
}

#[test]
fn absolute_rates_count_only_on_hardware() {
    let test = r#"at_least = { y = "fps", value = 60 }"#;
    let [fast, slow] = [5.0, 50.0].map(|ms| swept(&[1.0], |_| ms));
    assert_eq!(ruled(test, &fast, false).0, Supported);
    all_ruled(test, [("fast", fast, Untestable, "only on hardware")]);
    assert_eq!(ruled(test, &slow, false).0, Contradicted);
}

#[test]
fn no_worse_compares_two_cells() {
    let test = r#"no_worse = { y = "quantity:error", of = { n = 2 }, than = { n = 1 } }"#;
    let better = swept(&[1.0, 2.0], |n| 1.0 / n);
    let one = better[..1].to_vec();
    all_ruled(
        test,
        [
            ("better", better, Supported, ""),
            ("worse", swept(&[1.0, 2.0], |n| n), Contradicted, ""),
            ("one cell", one, Untestable, "^error was not recorded in both cells$"),
        ],
    );
}

#[test]
fn monotony_flips_with_one_cell_out_of_order() {
    let test = r#"monotone = { y = "stage:s", x = "axis:n", over = "n", direction = "rising", tolerance = 0.05 }"#;
    let rising = || swept(&[1.0, 2.0, 3.0, 4.0], |n| n);
    all_ruled(&test.replace("rising", "falling"), [("rising", rising(), Contradicted, "")]);
    let bent = but(2, 3.0, 1.0, rising());
    all_ruled(test, [("rising", rising(), Supported, ""), ("bent", bent, Contradicted, "")]);
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
    assert_eq!(verdict, Contradicted);
    assert!(reason.contains("model=a: slope 1.0") || reason.contains("model=a: slope 0.99"));
    assert!(reason.contains("model=b: slope 1.5") || reason.contains("model=b: slope 1.49"));
}

#[test]
fn an_affine_time_is_told_from_a_bent_one() {
    let test = r#"affine = { y = "stage:s", x = "axis:n", over = "n", tolerance = 0.08 }"#;
    let sizes = [480.0, 786.0, 1310.0, 1920.0, 2304.0];
    all_ruled(
        test,
        [
            ("straight", swept(&sizes, |n| 200.0 + n), Supported, "5 cells"),
            ("bent", swept(&sizes, |n| 1e-3 * n * n), Contradicted, ""),
            ("falling", swept(&sizes, |n| 5e3 - n), Contradicted, ""),
            ("flat", swept(&sizes, |n| 1e4 + n), Untestable, "50 % are needed$"),
            ("few cells", swept(&sizes[..3], |n| n), Untestable, ""),
        ],
    );
}

#[test]
fn noise_that_falls_with_the_root_of_the_samples_has_a_slope_of_minus_a_half() {
    let test = r#"slope = { y = "quantity:error", x = "axis:n", over = "n", expected = -0.5, tolerance = 0.05 }"#;
    let rays = [4.0, 8.0, 16.0, 32.0, 64.0];
    let falling = || swept(&rays, |n| 1.0 / n.sqrt());
    all_ruled(test, [("falling", falling(), Supported, "")]);
    let flat = swept(&rays, |n| 0.1 + 1.0 / n.sqrt());
    assert_ne!(ruled(test, &flat, true).0, Supported);
    // One cell off: the interval over the cells shows it.
    assert_ne!(ruled(test, &but(4, 64.0, 0.5, falling()), true).0, Supported);
}

#[test]
fn the_lowest_value_is_held_against_all_others() {
    let test = r#"lowest = { y = "quantity:error", over = "n", value = 2 }"#;
    let errors = |of: [f64; 3]| swept(&[1.0, 2.0, 3.0], move |n| of[n as usize - 1]);
    let lowest = errors([0.4, 0.1, 0.2]);
    let one = lowest[..1].to_vec();
    all_ruled(
        test,
        [
            ("lowest", lowest, Supported, "lowest of 2 others: 0.500"),
            ("not the lowest", errors([0.4, 0.1, 0.09]), Contradicted, ""),
            ("one cell", one, Untestable, ""),
        ],
    );
}

#[test]
fn a_minimum_needs_cells_on_both_sides_of_its_band() {
    let test =
        r#"minimum = { y = "quantity:error", x = "axis:n", over = "n", low = 0.2, high = 0.8 }"#;
    let values = [0.05, 0.2, 0.5, 0.8, 0.95];
    let around = |best: f64| swept(&values, move |n| 0.1 + (n - best).abs());
    all_ruled(
        test,
        [
            ("inside", around(0.5), Supported, "^lowest at 0.5: 0.1000$"),
            ("outside", around(0.95), Contradicted, ""),
            ("one-sided", around(0.5)[..4].to_vec(), Untestable, ""),
        ],
    );
    // Times of 3 % noise that differ by less.
    let timed = test.replace("quantity:error", "stage:s");
    let cells = swept(&values, |_| 5.0);
    all_ruled(&timed, [("flat", cells, Untestable, "within the noise")]);
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
    let other = but(1, 2.0, 10.0, eight.clone());
    let timed = r#"within = { y = "stage:s per axis:n", low = 1.0, high = 2.0 }"#;
    all_ruled(timed, [("timed", other.clone(), Untestable, "")]);
    all_ruled(
        test,
        [
            ("inside", eight, Supported, "^8.00 (8.00 – 8.00) error per n"),
            ("one outside", other, Contradicted, ""),
        ],
    );
}
