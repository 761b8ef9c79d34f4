//! Sentences with a known answer, tested by whole runs: false ones are contradicted and true ones supported.
//! `FATHOM_PLANTED_RUNS=20 cargo test --test claims` runs more often.

mod common;

use std::path::Path;

use common::{cells, fathom, records};
use fathom::experiments::{Experiment, Verdict};
use fathom::record::{Cell, Clock, Record};

/// On a busy machine a verdict may stay open, and another run may decide it.
const ATTEMPTS: u32 = 3;
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

/// The command with a run into this folder.
fn run(experiment: &Path, out: &Path) {
    let mut command = fathom();
    command
        .args(["run", "--no-ceilings"])
        .arg(experiment)
        .args(["--budget", "12", "--out"])
        .arg(out);
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn planted_sentences_get_their_verdicts_and_no_verdict_rests_on_few_samples() {
    let runs = std::env::var("FATHOM_PLANTED_RUNS").map_or(1, |runs| runs.parse().unwrap());
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("planted.toml");
    std::fs::write(&file, PLANTED).unwrap();
    let experiment = Experiment::parse("planted", PLANTED).unwrap();
    for number in 0..runs {
        let decided = |attempt: u32| {
            let out = folder.path().join(format!("{number}-{attempt}"));
            run(&file, &out);
            are_decided(&experiment, &cells(&out), number)
        };
        assert!((0..ATTEMPTS).any(decided), "run {number} stays inconclusive");
    }
}

/// Whether all sentences got their verdicts. None may get the wrong one.
fn are_decided(experiment: &Experiment, cells: &[Cell], number: u32) -> bool {
    let rounds: Vec<_> =
        cells.iter().map(|cell| &cell.measured().unwrap().frame.rounds[..12]).collect();
    assert!(rounds.windows(2).all(|pair| pair[0] == pair[1]), "sampled together: {rounds:?}");
    let rulings = experiment.rulings(&cells.iter().collect::<Vec<_>>(), true);
    for ruling in &rulings {
        let (expected, _) = ruling.id.split_once(':').unwrap();
        let verdict = if expected == "true" { Verdict::Supported } else { Verdict::Contradicted };
        let may_be = [verdict, Verdict::Inconclusive];
        assert!(may_be.contains(&ruling.verdict), "run {number}, {ruling:?}");
        assert!(ruling.n.is_some_and(|n| n >= 8), "{ruling:?}");
    }
    rulings.iter().all(|ruling| ruling.verdict != Verdict::Inconclusive)
}

#[test]
fn a_software_driver_is_timed_by_the_cpu_time_of_a_quiet_process() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("planted.toml");
    std::fs::write(&file, PLANTED).unwrap();
    let out = folder.path().join("out");
    run(&file, &out);
    let records = records(&out);
    let Record::Run(header) = &records[0] else { panic!("{records:?}") };
    if !header.adapter.software || cfg!(not(target_os = "linux")) {
        return;
    }
    assert_eq!(header.conditions.cores.len(), 1, "{:?}", header.conditions);
    assert_eq!(header.conditions.randomized, Some(false));
    assert!(header.clocks.values().all(|clock| *clock == Clock::ProcessCpu), "{header:?}");
    assert!(header.audit.iter().all(|row| row.sound && row.clock == Clock::ProcessCpu));
    for cell in cells(&out) {
        let measured = cell.measured().unwrap();
        assert!(measured.frame.accounting_error < 0.01, "{}", measured.frame.accounting_error);
        let sampled = &measured.frame.sampled_at_s;
        assert!(sampled.is_sorted() && sampled.len() == measured.frame.rounds.len());
    }
}

#[test]
fn a_cell_that_is_there_for_its_errors_renders_one_frame_and_has_no_times() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("errors.toml");
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
    std::fs::write(&file, text + claim).unwrap();
    let out = folder.path().join("out");
    run(&file, &out);
    let cells = cells(&out);
    for cell in &cells {
        let measured = cell.measured().unwrap();
        assert!(!measured.is_timed() && !measured.errors.is_empty());
        assert!(measured.stages.iter().all(|stage| stage.samples_ns.is_empty()));
        assert!(measured.stages.iter().any(|stage| stage.work.photons > 0));
    }
    let experiment = Experiment::parse("planted", &std::fs::read_to_string(&file).unwrap());
    let rulings = experiment.unwrap().rulings(&cells.iter().collect::<Vec<_>>(), true);
    assert_eq!(rulings[0].verdict, Verdict::Supported, "{rulings:?}");
    assert_eq!((rulings[0].n, rulings[1].verdict), (None, Verdict::NotRun));
    let summary = std::fs::read_to_string(out.join("summary.md")).unwrap();
    let tally = "1 supported, 0 contradicted, 0 inconclusive, 1 not run, of 2";
    assert!(summary.contains(tally) && !summary.contains("NaN"), "{summary}");
}
