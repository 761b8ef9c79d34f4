//! A run beside processes that keep every core busy. What it measures depends on them; that no time is zero or less, and that each
//! follows from what the clock read, does not. `harness::sample::tests::busy` has the scheduler on a modelled busy machine.

use std::sync::atomic::{AtomicBool, Ordering};

use crate::common::{Place, Told, cells};
use fathom::record::{Clock, Outcome, StageRecord};
use fathom::statistics;

/// Stages from some µs to a few ms, most on the fenced host clock of lavapipe.
const SHORT_STAGES: &str = r#"
id = "short"
title = "t"
source = "s"
pipeline = "voxelize"
scene = "corner"

[params]
view.width = 16
view.height = 16

[[sweep]]
[[sweep.axis]]
name = "voxel.resolution"
values = [16, 32]
"#;

/// Runs `work` while every core computes something else.
fn beside_load<T>(work: impl FnOnce() -> T) -> T {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let done = AtomicBool::new(false);
    let compute = || {
        let mut value = 1u64;
        while !done.load(Ordering::Relaxed) {
            value = std::hint::black_box(value.wrapping_mul(6_364_136_223_846_793_005));
        }
    };
    std::thread::scope(|scope| {
        for _ in 0..cores {
            scope.spawn(compute);
        }
        let result = work();
        done.store(true, Ordering::Relaxed);
        result
    })
}

#[test]
fn a_busy_machine_leaves_no_time_of_zero_or_less() {
    let place = Place::new();
    place.write("short.toml", SHORT_STAGES);
    let run = "run --no-ceilings short.toml --out out --budget 10m --precision 0.0001";
    let ran = beside_load(|| place.fathom(run).output().unwrap());
    let cells = cells(&place.path("out"));
    assert_eq!(cells.len(), 2);
    let all = cells.iter().all(|cell| cell.measured().is_some());
    Told::of(ran, i32::from(!all));
    for cell in &cells {
        let measured = match &cell.outcome {
            Outcome::Measured(measured) => measured,
            // So busy that most frames were impossible.
            Outcome::Failed { reason } if reason.contains(" timed frames rejected: ") => continue,
            other => panic!("{other:?}"),
        };
        let frame = &measured.frame;
        assert_eq!(frame.untimed.n, frame.envelope_samples_ns.len());
        assert!(frame.untimed_samples_ns.iter().all(|ns| *ns > 0.0), "{frame:?}");
        measured.stages.iter().for_each(|stage| has_times(stage, frame.untimed.n));
    }
    let table = place.read("out/summary.md");
    assert!(!table.contains("| -") && !table.contains("| 0 ("), "{table}");
}

#[track_caller]
fn has_times(stage: &StageRecord, frames: usize) {
    assert_eq!(stage.samples_ns.len(), frames, "{stage:?}");
    assert!(stage.samples_ns.iter().all(|ns| *ns > 0.0), "{stage:?}");
    assert!(stage.time.ends()[0] > 0.0, "{stage:?}");
    assert_eq!(stage.time, statistics::estimate(&stage.samples_ns), "{stage:?}");
    let by_fence = matches!(stage.clock, Clock::FencedHost | Clock::ProcessCpu);
    assert_eq!(stage.fenced.is_some(), by_fence, "{stage:?}");
    let Some(fenced) = &stage.fenced else { return };
    assert!(fenced.resolution_ns > 0.0);
    assert_eq!(fenced.samples_ns(), stage.samples_ns);
}
