use std::collections::BTreeMap;

use rand::SeedableRng;
use rand_pcg::Pcg64;
use serde_json::{Map, Value, json};

use super::Verdict::{Contradicted, Inconclusive, NearBound, NotRun, Supported};
use super::*;
use crate::fixtures::{OWN, noisy, own, sampled_at_s, timed};
use fathom_base::visits;
use fathom_record::{Clock, Fenced, FrameRecord, Measured, Note, Outcome, Work};

/// A cell with one axis, one stage and one quantity; the frame takes as long as the stage.
fn cell(axes: &[(&str, Value)], ms: f64, random: &mut Pcg64) -> Cell {
    let axes: Map<String, Value> =
        axes.iter().map(|(name, value)| ((*name).to_owned(), value.clone())).collect();
    let stage = timed("s", Clock::Timestamp, noisy(ms * 1e6, 24, random), Work::default());
    let measured = Measured {
        frame: FrameRecord {
            rounds: (0..24).collect(),
            visits: visits::numbers(&sampled_at_s(24)),
            sampled_at_s: sampled_at_s(24),
            untimed_samples_ns: stage.samples_ns.clone(),
            untimed: stage.time,
            ..FrameRecord::default()
        },
        stages: vec![stage],
        quantities: BTreeMap::from([("error".to_owned(), ms)]),
        ..Measured::default()
    };
    Cell { axes, outcome: Outcome::Measured(Box::new(measured)), ..Cell::default() }
}

/// Of the cells along `n` the one of least error is tested, at each value of `m` by a claim of its own.
#[test]
fn a_claim_stands_for_one_at_each_value_and_a_rule_chooses_its_cell() {
    let two = SWEPT.to_owned() + "[[sweep.axis]]\nname = \"m\"\nvalues = [1]\n";
    let rulings = |claim: &str, cells: &[Cell]| {
        let text = format!("{two}[claim.c]\ntext = \"x\"\n{claim}");
        own(&text).rulings(&cells.iter().collect::<Vec<_>>(), false)
    };
    let mut random = Pcg64::seed_from_u64(5);
    let error = |n: f64, m: f64| m * (1.0 + (n - 2.0).powi(2));
    let places = [1.0, 2.0, 3.0].into_iter().flat_map(|n| [1.0, 4.0].map(|m| (n, m)));
    let mut at = |(n, m)| cell(&[("n", json!(n)), ("m", json!(m))], error(n, m), &mut random);
    let cells: Vec<Cell> = places.map(&mut at).collect();
    let test = "each.m = [1, 4]\nleast = { y = \"quantity:error\", over = \"n\" }\ntest.within = { y = \"quantity:error\", high = 1.2 }";
    let told = |claim: &str, cells: &[Cell]| {
        let found = rulings(claim, cells).into_iter();
        found.map(|ruling| (ruling.id, ruling.verdict, ruling.deciding.len())).collect::<Vec<_>>()
    };
    let expected = [("c-1", Supported, 1), ("c-4", Contradicted, 1)];
    assert_eq!(told(test, &cells), expected.map(|(id, of, n)| (id.to_owned(), of, n)));
    assert!(rulings(test, &cells)[1].text.ends_with("x (m 4)"));
    // Without the rule the cells of larger errors decide.
    let all = test.replace("least = { y = \"quantity:error\", over = \"n\" }", "");
    assert_eq!(told(&all, &cells)[0].1, Contradicted);
    let two_axes = crate::Experiment::parse(
        "own",
        &format!(
            "{OWN}{two}[claim.c]\ntext = \"x\"\neach = {{ m = [1], n = [1] }}\ntest.within = {{ y = \"frame\" }}"
        ),
    );
    assert!(two_axes.unwrap_err().to_string().contains("`each` takes one axis"));
}

/// Cells along the axis `n` whose stage takes `ms(n)`.
pub(super) fn swept(values: &[f64], ms: impl Fn(f64) -> f64) -> Vec<Cell> {
    let mut random = Pcg64::seed_from_u64(11);
    values.iter().map(|n| cell(&[("n", json!(n))], ms(*n), &mut random)).collect()
}

/// The same but for the cell at one place.
pub(super) fn but(place: usize, n: f64, ms: f64, mut cells: Vec<Cell>) -> Vec<Cell> {
    cells[place] = swept(&[n], |_| ms).remove(0);
    cells
}

/// What claims are added to.
pub(super) const SWEPT: &str = r#"
[[sweep]]
[[sweep.axis]]
name = "n"
values = [1]
"#;

pub(super) fn ruled(test: &str, cells: &[Cell], software: bool) -> (Verdict, String) {
    let claim = format!("[[claim]]\nid = \"c\"\ntext = \"x\"\ntest.{test}");
    let experiment = own(&format!("{SWEPT}{claim}"));
    let cells: Vec<&Cell> = cells.iter().collect();
    let ruling = experiment.rulings(&cells, software).remove(0);
    (ruling.verdict, ruling.reason)
}

/// Rules on a claim for each set of cells on a software driver: the verdict, and a part of its reason, in which `^` and `$`
/// stand for the reason's beginning and end.
#[track_caller]
pub(super) fn all_ruled<const N: usize>(test: &str, cases: [(&str, Vec<Cell>, Verdict, &str); N]) {
    for (name, cells, expected, part) in cases {
        let (verdict, reason) = ruled(test, &cells, true);
        assert_eq!(verdict, expected, "{name}: {reason}");
        assert!(format!("^{reason}$").contains(part), "{name}: {reason}");
    }
}

const GRID: [f64; 6] = [1e3, 3e3, 1e4, 3e4, 1e5, 3e5];
const LINEAR: &str =
    r#"slope = { y = "stage:s", x = "axis:n", over = "n", expected = 1.0, tolerance = 0.1 }"#;
pub(super) const RISING: &str =
    r#"monotone = { y = "stage:s", x = "axis:n", over = "n", direction = "rising" }"#;

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
    let left_out = "2 cells left out below a fixed cost";
    let costs = "ms is more than 10 % of the figure in 4 of 6 cells$";
    let few = "^2 measured cells, and a slope needs 3$";
    all_ruled(
        LINEAR,
        [
            ("linear", swept(&GRID, |n| 0.5 + 1e-3 * n), Supported, ""),
            ("steep", steep, Contradicted, ""),
            ("a fixed cost", swept(&GRID, |n| 1.0 + 1e-3 * n), Supported, left_out),
            ("a high fixed cost", dear, NotRun, costs),
            ("few cells", swept(&GRID[..2], |n| n), NotRun, few),
            ("a short range", short, NotRun, "x must span a factor of 10 at least$"),
            ("no cell", Vec::new(), NotRun, "^no cell along `n`$"),
            ("skipped cells", skipped, NotRun, ""),
        ],
    );
}

/// Exact figures within a tenth of a bound that is ours, and sampled ones whose interval holds it.
#[test]
fn figures_at_a_bound_are_near_it_unless_the_bound_is_printed() {
    let exact = r#"within = { y = "quantity:error", low = 1.0, high = 2.0 }"#;
    let narrow = r#"within = { y = "quantity:error", low = 0.95, high = 1.05 }"#;
    let sampled = r#"ratio = { y = "stage:s", over = "n", numerator = 2, denominator = 1, low = 1.0, high = 2.0 }"#;
    let printed = |words: &str| format!("\nsource = \"UW §1\"\nprinted = \"{words}\"");
    for (test, value, ours, by_print) in [
        (exact, 0.8999, Contradicted, Contradicted),
        (exact, 0.9, NearBound, Contradicted),
        (exact, 1.1, NearBound, Supported),
        (exact, 1.1001, Supported, Supported),
        (exact, 1.7999, Supported, Supported),
        (exact, 1.8, NearBound, Supported),
        (exact, 2.2, NearBound, Contradicted),
        (exact, 2.2001, Contradicted, Contradicted),
        // The tenth is wider than the band, of which a quarter counts.
        (narrow, 1.0, Supported, Supported),
        (narrow, 1.03, NearBound, Supported),
        (narrow, 1.07, NearBound, Contradicted),
        // The interval of 3 % noise counts, not the tenth.
        (sampled, 2.0, NearBound, Inconclusive),
        (sampled, 1.9, Supported, Supported),
        (sampled, 2.1, Contradicted, Contradicted),
    ] {
        let cells =
            swept(
                &[1.0, 2.0][usize::from(test != sampled)..],
                |n| if n > 1.0 { value } else { 1.0 },
            );
        let words =
            ["small", "as in a 3D texture", "about 2", "1 to 2, or 60+", "(95%)"].map(printed);
        let [in_words @ .., by_range, by_share] =
            words.map(|words| ruled(&format!("{test}{words}"), &cells, true).0);
        let verdict = ruled(test, &cells, true).0;
        assert_eq!((verdict, in_words), (ours, [ours; 3]), "{test} of {value}");
        assert_eq!([by_range, by_share], [by_print; 2], "{test} of {value}");
    }
    let none = swept(&[2.0], |_| 0.0);
    all_ruled(&exact.replace("low = 1.0", "low = 0.0"), [("none", none, Supported, "")]);
}

#[test]
fn a_figure_that_could_not_be_computed_says_why() {
    let test = r#"ratio = { y = "quantity:error", over = "n", numerator = 2, denominator = 1, low = 1.0, high = 3.0 }"#;
    let cells = swept(&[1.0, 2.0], |n| n);
    let mut lacking = cells.clone();
    lacking[1].cell = "n=2".to_owned();
    let measured = lacking[1].measured_mut().unwrap();
    measured.quantities = BTreeMap::new();
    let unknown = lacking.clone();
    let note = Note::new(NoteKind::NotComputed, "error not computed: too large");
    lacking[1].measured_mut().unwrap().notes.push(note);
    all_ruled(
        test,
        [
            ("computed", cells, Supported, ""),
            ("lacking", lacking, NotRun, "^n=2: error not computed: too large$"),
            ("for no known reason", unknown, NotRun, "^`2` and `1` were not both measured$"),
        ],
    );
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
    assert!(reason.contains("model=b: slope over 2.48 decades (6 cells) 1.5"), "{reason}");
    assert!(reason.ends_with("(1 of 2 comparisons)"), "{reason}");
}

#[test]
fn an_affine_time_is_told_from_a_bent_one() {
    let test = r#"affine = { y = "stage:s", x = "axis:n", over = "n", tolerance = 0.08 }"#;
    let sizes = [480.0, 786.0, 1310.0, 1920.0, 2304.0];
    all_ruled(
        test,
        [
            ("straight", swept(&sizes, |n| 200.0 + n), Supported, "nearest to its bound of 6"),
            ("bent", swept(&sizes, |n| 1e-3 * n * n), Contradicted, ""),
            ("falling", swept(&sizes, |n| 5e3 - n), Contradicted, ""),
            ("flat", swept(&sizes, |n| 1e4 + n), NotRun, "50 % are needed$"),
            ("few cells", swept(&sizes[..3], |n| n), NotRun, ""),
        ],
    );
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
        record.stage = stage.into();
        measured.stages.push(record);
    }
    let measured = cell.measured().unwrap();
    let read = |text: &str| text.parse::<Measure>().unwrap().read(&cell, measured);
    let sum = read("stage:f/").unwrap();
    let samples = sum.values();
    assert_eq!(samples[0], measured.stages[1].samples_ns[0] + measured.stages[2].samples_ns[0]);
    assert!((sum.median() / 8e6 - 1.0).abs() < 0.05);
    assert_eq!(read("stage:g/x|s").unwrap().figure(), measured.stages[0].time);
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
    short.stage = "f/short".into();
    // Half of the differences are negative.
    let wall_ns = |frame: usize| 60e3 + if frame.is_multiple_of(2) { 5e3 } else { -5e3 };
    let fenced = Fenced {
        wall_samples_ns: (0..short.samples_ns.len()).map(wall_ns).collect(),
        submit_cost_samples_ns: vec![60e3; short.samples_ns.len()],
        resolution_ns: 50e3,
    };
    short.samples_ns = fenced.samples_ns();
    short.time = visits::estimate_of_samples(&short.samples_ns, &measured.frame.visits);
    short.fenced = Some(fenced);
    assert!(short.samples_ns.iter().all(|ns| *ns == 50e3));
    let mut long = measured.stages[0].clone();
    long.stage = "f/long".into();
    measured.stages.extend([short, long]);
    let measured = cell.measured().unwrap();
    let read = |text: &str| text.parse::<Measure>().unwrap().read(&cell, measured);
    assert_eq!(read("stage:f/short"), None);
    assert_eq!(read("stage:s per stage:f/short"), None);
    let sum = read("stage:f/").unwrap().median();
    let alone = read("stage:f/long").unwrap().median();
    assert!((sum - alone).abs() <= 5e3, "{sum} and {alone}");
}

#[test]
fn a_claim_that_cannot_be_decided_here_is_not_run_whatever_was_measured() {
    let cells = swept(&[1.0, 2.0], |n| 8.0 * n);
    let within = r#"within = { y = "quantity:error per axis:n", low = 7.0, high = 9.0 }"#;
    all_ruled(within, [("decided", cells.clone(), Supported, "")]);
    let undecided = format!("{within}\nnot_run = \"another method\"");
    all_ruled(&undecided, [("not decided", cells, NotRun, "^another method$")]);
}

/// Cells whose times follow from the number of the round: drift that all share, and noise of their own.
fn drifting(
    values: &[f64],
    rounds: u32,
    ms: impl Fn(f64) -> f64,
    noise: f64,
    seed: u64,
) -> Vec<Cell> {
    let mut random = Pcg64::seed_from_u64(seed);
    let mut of = |n: f64| {
        let mut cell = cell(&[("n", json!(n))], 1.0, &mut random);
        let scatter = noisy(1.0, rounds as usize, &mut random);
        let times = (0..rounds).zip(scatter).map(|(round, own)| {
            let drift = 1.0 + 0.3 * (f64::from(round) / 3.0).sin();
            // The fixture scatters by about 3 %.
            1e6 * ms(n) * drift * (1.0 + (own - 1.0) * noise / 0.03)
        });
        let times: Vec<f64> = times.collect();
        let measured = cell.measured_mut().unwrap();
        measured.frame.rounds = (0..rounds).collect();
        measured.frame.sampled_at_s = sampled_at_s(rounds as usize);
        measured.frame.visits = visits::numbers(&measured.frame.sampled_at_s);
        measured.stages[0].time = visits::estimate_of_samples(&times, &measured.frame.visits);
        measured.stages[0].samples_ns = times;
        cell
    };
    values.iter().map(|n| of(*n)).collect()
}

#[test]
fn ratios_are_paired_by_round_so_that_drift_cancels() {
    let test = r#"ratio = { y = "stage:s", over = "n", numerator = 2, denominator = 1, low = 1.03, high = inf }"#;
    let cells = drifting(&[1.0, 2.0], 16, |n| if n > 1.0 { 1.05 } else { 1.0 }, 0.003, 1);
    let (verdict, reason) = ruled(test, &cells, true);
    assert_eq!(verdict, Supported, "5 % within a drift of 30 %: {reason}");
    assert!(reason.contains("n = 6"), "{reason}");
    // The same samples in rounds of their own cannot be paired.
    let mut apart = cells;
    apart[1].measured_mut().unwrap().frame.rounds = (100..116).collect();
    let (verdict, reason) = ruled(test, &apart, true);
    assert_eq!(verdict, Inconclusive, "{reason}");
    assert!(reason.contains("n = 0") && reason.ends_with("4 visits are needed"), "{reason}");
    assert!(reason.contains(NO_VISIT) && !reason.contains("NaN"), "{reason}");
}

/// Cells that were measured one by one share no round: a slope of their first visits, of their second …
#[test]
fn an_exponent_of_cells_measured_apart_is_fitted_visit_by_visit() {
    let (y, x) = ("stage:s".parse().unwrap(), "axis:n".parse().unwrap());
    let fitted = |rounds: u32, apart: u32| {
        let mut cells = drifting(&GRID, rounds, |n| 1e-3 * n, 0.02, 3);
        for (place, cell) in (0..).zip(&mut cells) {
            let own = apart * place..apart * place + rounds;
            cell.measured_mut().unwrap().frame.rounds = own.collect();
        }
        scaling(&y, &x, &cells.iter().collect::<Vec<_>>(), 1.0).unwrap()
    };
    // All rounds, two rounds and none in common.
    let [paired, few, none] = [0, 2, 100].map(|apart| fitted(12, apart));
    assert_eq!([&paired, &few, &none].map(|fit| fit.slopes.n()), [Some(4); 3]);
    for fit in [paired, few, none] {
        let interval = fit.interval().unwrap();
        assert!(interval.low <= fit.exponent() && fit.exponent() <= interval.high, "{fit:?}");
        assert!((fit.exponent() - 1.0).abs() < 0.05 && interval.half_width() < 0.3, "{fit:?}");
    }
    let few = fitted(4, 100);
    assert!(few.exponent().is_finite() && few.interval().is_none(), "{few:?}");
}

#[test]
fn nothing_is_concluded_from_few_visits_nor_from_those_of_less_than_a_minute() {
    let test = r#"ratio = { y = "stage:s", over = "n", numerator = 2, denominator = 1, low = 1.5, high = inf }"#;
    for rounds in 1..24 {
        let cells = drifting(&[1.0, 2.0], rounds, |n| n, 0.001, 2);
        let (verdict, reason) = ruled(test, &cells, true);
        // Visits of three rounds, 15 s apart: the fourth ends at 47 s.
        let enough = rounds > 12;
        assert_eq!(verdict == Supported, enough, "{rounds}: {reason}");
        assert_ne!(verdict, Contradicted, "{rounds}: {reason}");
    }
    // Of records that do not tell visits each sample counts, at a sixth of the level.
    for rounds in [3, 7, 8] {
        let mut cells = drifting(&[1.0, 2.0], rounds, |n| n, 0.001, 2);
        cells.iter_mut().for_each(|cell| cell.measured_mut().unwrap().frame.visits.clear());
        let (verdict, reason) = ruled(test, &cells, true);
        assert_eq!(verdict == Supported, rounds == 8, "{rounds}: {reason}");
        assert!(rounds == 8 || reason.ends_with("more samples are needed"), "{reason}");
    }
}

#[test]
fn a_repeated_quantity_has_an_interval_and_an_exact_one_none() {
    let test = r#"ratio = { y = "quantity:noise", numerator = { n = 2 }, denominator = { n = 1 }, high = 1.0 }"#;
    let mut cells = swept(&[1.0, 2.0], |n| n);
    for (cell, level) in cells.iter_mut().zip([1.0, 0.9]) {
        let values = (0..10).map(|i| level * (1.0 + 0.01 * f64::from(i % 3))).collect();
        cell.measured_mut().unwrap().repeated.insert("noise".to_owned(), values);
    }
    let (verdict, reason) = ruled(test, &cells, true);
    assert_eq!(verdict, Supported);
    assert!(reason.contains("n = 10"), "{reason}");
    let (_, reason) = ruled(&test.replace("noise", "error"), &cells, true);
    assert!(!reason.contains("n ="), "{reason}");
}

/// How often each verdict comes out of so many experiments.
fn verdicts(test: &str, trials: u64, cells: impl Fn(u64) -> Vec<Cell>) -> BTreeMap<Verdict, u32> {
    let mut counts = BTreeMap::new();
    for trial in 0..trials {
        *counts.entry(ruled(test, &cells(trial), true).0).or_default() += 1;
    }
    counts
}

#[test]
fn false_sentences_are_contradicted_and_true_ones_supported_every_time() {
    // Rises with the power 1.3: not linear, and not constant.
    let cells = |trial| drifting(&GRID, 16, |n| 1e-3 * n.powf(1.3), 0.02, trial);
    let power = LINEAR.replace("expected = 1.0", "expected = 1.3");
    let falling = RISING.replace("rising", "falling");
    let constant = r#"ratio = { y = "stage:s", over = "n", high = 1.5 }"#;
    for sentence in [LINEAR, &falling, constant] {
        assert_eq!(
            verdicts(sentence, 20, cells),
            BTreeMap::from([(Contradicted, 20)]),
            "{sentence}"
        );
    }
    for sentence in [&power, RISING] {
        assert_eq!(verdicts(sentence, 20, cells), BTreeMap::from([(Supported, 20)]), "{sentence}");
    }
}

#[test]
fn noise_supports_a_claim_no_more_often_than_the_stated_rate() {
    // The figure lies exactly at the bound.
    let test = r#"ratio = { y = "stage:s", over = "n", numerator = 2, denominator = 1, low = 1.0, high = inf }"#;
    let trials = 400;
    let cells = |trial| drifting(&[1.0, 2.0], 18, |_| 5.0, 0.02, 1_000 + trial);
    let counts = verdicts(test, trials, cells);
    let [supported, contradicted] =
        [Supported, Contradicted].map(|verdict| counts.get(&verdict).copied().unwrap_or(0));
    // Three standard deviations above the rate.
    let max_count = CHANCE * trials as f64 + 3.0 * (CHANCE * trials as f64).sqrt();
    assert!(f64::from(supported) <= max_count, "{supported} of {trials}");
    assert!(f64::from(contradicted) <= max_count, "{contradicted} of {trials}");
    // A rule that never decides would pass, too.
    assert!(supported + contradicted > 0);
}

#[test]
fn more_visits_than_there_are_settle_what_is_open() {
    let bounded = r#"ratio = { y = "stage:s", over = "n", numerator = 2, denominator = 1, low = 0.99, high = inf }"#;
    let rounds = 24;
    let mut told = 0;
    for seed in 0..30 {
        // Just below the bound, and falling slightly where rising is claimed: one of three steps.
        let below = drifting(&[1.0, 2.0], rounds, |n| 5.0 - 0.07 * (n - 1.0), 0.02, seed);
        let falling = drifting(&[1.0, 2.0, 3.0, 4.0], rounds, |n| 5.0 - 0.04 * n, 0.02, seed);
        for (test, cells) in [(bounded, below), (RISING, falling)] {
            let (verdict, reason) = ruled(test, &cells, true);
            let number = reason.split_once("; about ").and_then(|(_, rest)| rest.split(' ').next());
            if let Some(number) = number.filter(|_| !verdict.is_settled()) {
                assert!(number.parse::<u32>().unwrap() >= rounds / 3, "{reason}");
                told += 1;
            }
        }
    }
    assert!(told > 10, "{told}");
}

#[test]
fn a_balance_is_published_or_free_for_a_reason() {
    let parse = |text: &str| Balance::try_from(text.to_owned());
    assert_eq!(parse("published"), Ok(Balance::Published));
    assert_eq!(parse("free: counts"), Ok(Balance::Free("counts".to_owned())));
    for wrong in ["free", "free:", "free: ", "any", "published: yes"] {
        assert!(parse(wrong).is_err(), "{wrong}");
    }
    let without = OWN.to_owned()
        + r#"
        [[claim]]
        id = "c"
        text = "x"
        balance = "published"
        test.within = { y = "fps", low = 1.0 }
        "#;
    assert!(
        Experiment::parse("own", &without).unwrap_err().to_string().contains("published sizes")
    );
}

#[test]
fn a_contradicted_claim_tells_its_cause() {
    let reason = |cause: &str, low: f64, software: bool| {
        let claim = format!(
            "[[claim]]\nid = \"c\"\ntext = \"x\"\ncause = {cause}\ntest.within = {{ y = \"quantity:error\", low = {low:?} }}"
        );
        let experiment = own(&format!("{SWEPT}{claim}"));
        let cells = swept(&[1.0], |_| 3.0);
        let cells: Vec<&Cell> = cells.iter().collect();
        experiment.rulings(&cells, software).remove(0).reason
    };
    let [hardware, paper] = ["{ hardware = \"no units\" }", "{ paper = \"a slip\" }"];
    assert!(reason(hardware, 5.0, true).ends_with(". The hardware decides: no units"));
    assert!(!reason(hardware, 5.0, false).contains("hardware"));
    assert!(reason(paper, 5.0, false).ends_with(". The paper decides: a slip"));
    assert!(!reason(paper, 1.0, true).contains("paper"));
}

/// Of `b` time 4 gives an error of 2, and time 1 of 8: half of it at time 2.
#[test]
fn at_equal_time_the_least_error_is_interpolated_over_time() {
    let test = r#"equal_time = { y = "quantity:error", time = "stage:s", over = "m", numerator = "a", of = { m = "b", n = 2 }, shares = [0.5, 1.0] }"#;
    let sized = |errors: [f64; 2], faster: f64| {
        let mut random = Pcg64::seed_from_u64(7);
        let mut of = |m: &str, n: u32, error: f64, ms: f64| {
            let mut made = cell(&[("m", json!(m)), ("n", json!(n))], ms, &mut random);
            if let Outcome::Measured(measured) = &mut made.outcome {
                measured.quantities.insert("error".to_owned(), error);
            }
            made
        };
        let a = [of("a", 1, errors[0], faster), of("a", 2, errors[1], 2.0 * faster)];
        a.into_iter().chain([of("b", 1, 8.0, 1.0), of("b", 2, 2.0, 4.0)]).collect::<Vec<_>>()
    };
    let ruled_by = |test: &str, cells: Vec<Cell>, software: bool| {
        let axes = SWEPT.to_owned() + "[[sweep.axis]]\nname = \"m\"\nvalues = [\"a\"]\n";
        let claim = format!("{axes}[[claim]]\nid = \"c\"\ntext = \"x\"\ntest.{test}");
        let ruling = own(&claim).rulings(&cells.iter().collect::<Vec<_>>(), software).remove(0);
        (ruling.verdict, ruling.reason, ruling.deciding.first().map_or(f64::NAN, |f| f.value))
    };
    let ruled = |cells, software| ruled_by(test, cells, software);
    // At time 2 `b` gives 4, and `a` 1.9; at time 4 it is 2 and 1.
    let (verdict, reason, value) = ruled(sized([2.0, 1.0], 1.9), false);
    assert_eq!(verdict, Supported, "{reason}");
    assert!((value - 0.5).abs() < 0.02 && reason.contains("of 2"), "{reason} {value}");
    assert_eq!(ruled(sized([9.0, 5.0], 1.0), false).0, Contradicted);
    // Less at its smallest size than at its larger one: more time allows the smaller size.
    assert_eq!(ruled(sized([1.0, 9.0], 1.5), false).0, Supported);
    let (verdict, reason, _) = ruled(sized([2.0, 1.0], 3.0), false);
    assert!(verdict == NotRun && reason.contains("takes more than 0.5"), "{reason}");
    let (verdict, reason, _) = ruled(sized([2.0, 1.0], 2.0), true);
    assert!(verdict == NotRun && reason.contains("software"), "{reason}");
    // Of `b` only the frame whose time is shared out: half of it is too little.
    let mut cells = sized([2.0, 1.0], 1.0);
    cells.remove(2);
    let (verdict, reason, _) = ruled_by(&test.replace(", 1.0]", "]"), cells, false);
    assert!(verdict == NotRun && reason.contains("no other value of the axis"), "{reason}");
}
