//! Sentences with a known answer, tested by a whole run whose times are replaced by those of a modelled clock: false ones are
//! contradicted and true ones supported. Of the run's own times only what holds on any machine is tested.
//! `FATHOM_PLANTED_RUNS=20 cargo test --test program claims` draws the model's noise more often.

use crate::common::{Ends, Place, cells, holds, records};
use fathom::experiments::{Experiment, Ruling, Verdict};
use fathom::record::{Cell, Clock, Outcome, Record, StageRecord};
use fathom::statistics::estimate;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Four times the photons from cell to cell.
const PLANTED: &str = r#"
id = "planted"
title = "Sentences with a known answer"
source = "none"
pipeline = "underwater"
scene = "tank"
[params]
view = { width = 64, height = 64 }
shadow.size = 512
surface.cells = 8
caustics.buffer = [64, 64]
caustics.filter = false
godrays = { grid = 8, filter = false, buffer = [16, 16] }
[[sweep]]
[[sweep.axis]]
name = "caustics.grid"
values = [60, 120, 240]

[[claim]]
id = "true: rises"
text = "Tracing takes longer with more photons"
test.monotone = { y = "stage:caustics/trace", x = "work:caustics/trace.photons", over = "caustics.grid", direction = "rising" }

[[claim]]
id = "true: in proportion"
text = "Sixteen times the photons take 6 to 24 times as long"
test.ratio = { y = "stage:caustics/trace", over = "caustics.grid", numerator = 240, denominator = 60, low = 6.0, high = 24.0 }

[[claim]]
id = "true: independent"
text = "The depth pass does not depend on the photons"
test.independent = { y = "stage:shadow/depth", over = "caustics.grid", tolerance = 0.3 }

[[claim]]
id = "false: falls"
text = "Splatting takes less time with more photons"
test.monotone = { y = "stage:caustics/splat", x = "work:caustics/trace.photons", over = "caustics.grid", direction = "falling" }

[[claim]]
id = "false: constant"
text = "Tracing does not depend on the photons"
test.independent = { y = "stage:caustics/trace", over = "caustics.grid", tolerance = 0.3 }
"#;

/// A folder whose `out` holds a run of this experiment.
fn measured(experiment: &str) -> Place {
    let place = Place::new();
    place.write("planted.toml", experiment);
    place.fathom("run --no-ceilings planted.toml --budget 10m --precision 1 --out out").ends(0);
    place
}

#[test]
fn planted_sentences_get_their_verdicts_and_no_verdict_rests_on_few_samples() {
    let draws = std::env::var("FATHOM_PLANTED_RUNS").map_or(3, |draws| draws.parse().unwrap());
    let place = measured(PLANTED);
    let measured = cells(&place.path("out"));
    agrees_with_itself(&measured, &place.read("out/summary.md"));
    is_timed_by_the_cpu_time_of_a_quiet_process(&records(&place.path("out"))[0], &measured);
    for seed in 0..draws {
        let verdicts = |samples, noise| verdicts(&modelled(&measured, samples, noise, seed));
        assert!(verdicts(24, 0.05).iter().all(|(right, verdict)| verdict == right), "{seed}");
        // So noisy that nothing can be said, and too few to say anything.
        let vague = verdicts(24, 3.0);
        assert!(vague.iter().any(|(_, verdict)| *verdict == Verdict::Inconclusive), "{vague:?}");
        let few = verdicts(7, 0.05);
        let decided =
            |verdict: Verdict| matches!(verdict, Verdict::Supported | Verdict::Contradicted);
        assert!(!few.iter().any(|(_, verdict)| decided(*verdict)), "{few:?}");
    }
}

fn rulings(experiment: &str, cells: &[Cell]) -> Vec<Ruling> {
    let experiment = Experiment::parse("planted", experiment).unwrap();
    experiment.rulings(&cells.iter().collect::<Vec<_>>(), true)
}

/// The right verdict of each sentence, and the one that it gets.
fn verdicts(cells: &[Cell]) -> Vec<(Verdict, Verdict)> {
    let right = |id: &str| match id.split_once(':').unwrap().0 {
        "true" => Verdict::Supported,
        _ => Verdict::Contradicted,
    };
    let rulings = rulings(PLANTED, cells).into_iter();
    rulings.map(|ruling| (right(&ruling.id), ruling.verdict)).collect()
}

/// The cells with times of a clock on which caustics take 1 µs a photon and all else 1 ms, but for log-normal noise.
fn modelled(cells: &[Cell], samples: usize, noise: f64, seed: u64) -> Vec<Cell> {
    let mut random = Pcg64::seed_from_u64(seed);
    // Of twelve uniform numbers: near enough to a normal one.
    let mut drawn = || (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
    let mut timed = |stage: &mut StageRecord, photons: u64| {
        let of_photons = stage.stage.starts_with("caustics/");
        let ns = if of_photons { 1e3 * photons as f64 } else { 1e6 };
        stage.samples_ns = (0..samples).map(|_| ns * (noise * drawn()).exp()).collect();
        stage.time = estimate(&stage.samples_ns);
        (stage.clock, stage.fenced) = (Clock::Timestamp, None);
    };
    let mut cells = cells.to_vec();
    for cell in &mut cells {
        let mut measured = cell.measured().unwrap().clone();
        let photons = measured.stages.iter().map(|stage| stage.work.photons).max().unwrap();
        measured.stages.iter_mut().for_each(|stage| timed(stage, photons));
        measured.frame.rounds = (0..).take(samples).collect();
        cell.outcome = Outcome::Measured(Box::new(measured));
    }
    cells
}

/// All cells were sampled together at least up to a look, no verdict rests on fewer than 8 samples, and the summary counts the verdicts.
#[track_caller]
fn agrees_with_itself(cells: &[Cell], summary: &str) {
    let rounds: Vec<_> = cells.iter().map(|cell| &cell.measured().unwrap().frame.rounds).collect();
    let together = rounds[0].iter().filter(|round| rounds.iter().all(|all| all.contains(round)));
    assert!(together.count() >= 12, "sampled together: {rounds:?}");
    let rulings = rulings(PLANTED, cells);
    for ruling in &rulings {
        let decided = matches!(ruling.verdict, Verdict::Supported | Verdict::Contradicted);
        assert!(!decided || ruling.n.is_some_and(|n| n >= 8), "{ruling:?}");
    }
    let count = |verdict| rulings.iter().filter(|ruling| ruling.verdict == verdict).count();
    let [supported, contradicted, inconclusive, not_run] =
        [Verdict::Supported, Verdict::Contradicted, Verdict::Inconclusive, Verdict::NotRun]
            .map(count);
    let tally = format!(
        "{supported} supported, {contradicted} contradicted, {inconclusive} inconclusive, {not_run} not run, of {}",
        rulings.len()
    );
    holds(summary, &[&tally]);
}

/// On a software driver, if that clock is sound.
#[track_caller]
fn is_timed_by_the_cpu_time_of_a_quiet_process(header: &Record, cells: &[Cell]) {
    let header = header.try_as_run_ref().unwrap();
    if !header.adapter.software || cfg!(not(target_os = "linux")) {
        return;
    }
    assert_eq!(header.conditions.cores.len(), 1, "{:?}", header.conditions);
    assert_eq!(header.conditions.randomized, Some(false));
    // Where a busy machine spoils the audit of the CPU time, its rows say so, and no pass is timed by it.
    let is_cpu = |clock: &Clock| *clock == Clock::ProcessCpu;
    let audited: Vec<_> = header.audit.iter().filter(|row| is_cpu(&row.clock)).collect();
    assert_eq!(audited.len(), 3, "{header:?}");
    let sound = audited.iter().all(|row| row.sound);
    assert!(header.clocks.values().all(|clock| is_cpu(clock) == sound), "{header:?}");
    for cell in cells {
        let measured = cell.measured().unwrap();
        let timed = measured.stages.iter().filter(|stage| stage.clock != Clock::Host);
        assert!(timed.clone().count() > 0);
        assert!(timed.clone().all(|stage| is_cpu(&stage.clock) == sound));
        let sampled = &measured.frame.sampled_at_s;
        assert!(sampled.is_sorted() && sampled.len() == measured.frame.rounds.len());
    }
}

#[test]
fn a_cell_that_is_there_for_its_errors_renders_one_frame_and_has_no_times() {
    let text = PLANTED.split("[[claim]]").next().unwrap();
    let text = text.replace("[[sweep]]\n", "[[sweep]]\nerrors_only = true\n");
    let claim = r#"
[[claim]]
id = "exact"
text = "Errors have no samples"
test.within = { y = "quantity:caustics_photon_error_median_m", low = 0.0, high = 1.0 }
[[claim]]
id = "timed"
text = "No times are there"
test.independent = { y = "stage:caustics/trace", over = "caustics.grid", tolerance = 0.3 }
"#;
    let text = text + claim;
    let place = measured(&text);
    let cells = cells(&place.path("out"));
    for cell in &cells {
        let measured = cell.measured().unwrap();
        assert!(!measured.is_timed() && !measured.errors.is_empty());
        assert!(measured.stages.iter().all(|stage| stage.samples_ns.is_empty()));
        assert!(measured.stages.iter().any(|stage| stage.work.photons > 0));
    }
    let rulings = rulings(&text, &cells);
    assert_eq!(rulings[0].verdict, Verdict::Supported, "{rulings:?}");
    assert_eq!((rulings[0].n, rulings[1].verdict), (None, Verdict::NotRun));
    let summary = place.read("out/summary.md");
    let tally = "1 supported, 0 contradicted, 0 inconclusive, 1 not run, of 2";
    assert!(summary.contains(tally) && !summary.contains("NaN"), "{summary}");
}
