//! A run of an experiment with claims: its summary tells their verdicts, and rests on few visits for none; clocks, and what a cell costs the CPU
//! beside its frames. That false sentences are contradicted and true ones supported is tested in `experiments::claims`.

use crate::common::{Ends, Place, cells, holds, records};
use fathom::experiments::{Experiment, Ruling, Verdict};
use fathom::record::{Cell, Clock, Record};
use itertools::Itertools as _;

/// Four times the photons from cell to cell.
const PLANTED: &str = r#"
id = "planted"
title = "Sentences with a known answer"
source = "none"
pipeline = "underwater"
scene = "tank"
[params]
view = { width = 64, height = 64 }
shadow.size = 64
surface.cells = 8
caustics.buffer = [64, 64]
caustics.filter = false
godrays = { grid = 8, filter = false, buffer = [16, 16] }
[[sweep]]
[[sweep.axis]]
name = "caustics.grid"
values = [15, 30, 60]

[[claim]]
id = "true: rises"
text = "Tracing takes longer with more photons"
test.monotone = { y = "stage:caustics/trace", x = "work:caustics/trace.photons", over = "caustics.grid", direction = "rising" }

[[claim]]
id = "false: falls"
text = "Splatting takes less time with more photons"
test.monotone = { y = "stage:caustics/splat", x = "work:caustics/trace.photons", over = "caustics.grid", direction = "falling" }

[[claim]]
id = "false: constant"
text = "Tracing does not depend on the photons"
test.ratio = { y = "stage:caustics/trace", over = "caustics.grid", high = 1.3 }
"#;

/// A folder whose `out` holds a run of this experiment.
fn measured(experiment: &str) -> Place {
    let place = Place::new();
    place.write("planted.toml", experiment);
    place.fathom("run --no-ceilings planted.toml --budget 10m --visits 4 --out out").ends(0);
    place
}

#[test]
fn verdicts_agree_with_the_samples_and_the_summary() {
    let place = measured(PLANTED);
    let measured = cells(&place.path("out"));
    agrees_with_itself(&measured, &place.read("out/summary.md"));
    is_timed_by_the_cpu_time_of_a_quiet_process(&records(&place.path("out"))[0], &measured);
    one_cell_tells_what_it_costs_the_cpu(&measured);
    holds(&place.read("out/index.html"), &["What it costs the CPU"]);
}

/// One of a pipeline.
#[track_caller]
fn one_cell_tells_what_it_costs_the_cpu(cells: &[Cell]) {
    let timed = cells.iter().filter_map(|cell| cell.measured().filter(|it| it.host.is_some()));
    let measured = timed.exactly_one().unwrap_or_else(|_| panic!("of {} cells", cells.len()));
    let host = measured.host.as_ref().unwrap();
    let encoded = host.stages.iter().map(|stage| &stage.stage);
    assert!(encoded.eq(measured.stages.iter().map(|stage| &stage.stage)), "{host:?}");
    let mut encoded = host.stages.iter().map(|stage| &stage.encode).chain([&host.encode]);
    assert!(encoded.all(|spent| spent.median > 0.0 && spent.interval.is_some()), "{host:?}");
    assert!(host.submit.median > 0.0, "{host:?}");
}

fn rulings(experiment: &str, cells: &[Cell]) -> Vec<Ruling> {
    let experiment = Experiment::parse("planted", experiment).unwrap();
    experiment.rulings(&cells.iter().collect::<Vec<_>>(), true)
}

/// All cells were visited together, no verdict rests on fewer than four visits, and the summary counts the verdicts.
#[track_caller]
fn agrees_with_itself(cells: &[Cell], summary: &str) {
    let rounds: Vec<_> = cells.iter().map(|cell| &cell.measured().unwrap().frame.rounds).collect();
    let visits = rounds[0].iter().zip(&cells[0].measured().unwrap().frame.visits);
    let together = visits.filter(|(round, _)| rounds.iter().all(|all| all.contains(round)));
    assert!(together.unique_by(|(_, visit)| **visit).count() >= 4, "visited together: {rounds:?}");
    let rulings = rulings(PLANTED, cells);
    for ruling in &rulings {
        assert!(!ruling.verdict.is_settled() || ruling.n.is_some_and(|n| n >= 4), "{ruling:?}");
    }
    let told = summary.lines().find(|line| line.contains(", of 3")).expect(summary);
    for (verdict, count) in rulings.iter().counts_by(|ruling| ruling.verdict) {
        holds(told, &[&format!("{count} {verdict}, ")]);
    }
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
test.ratio = { y = "stage:caustics/trace", over = "caustics.grid", high = 1.3 }
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
    let tally =
        "of 2. Verdicts by a bound of this project: 1; at the sizes of the quick profile: 1";
    assert!(summary.contains(tally) && !summary.contains("NaN"), "{summary}");
}
