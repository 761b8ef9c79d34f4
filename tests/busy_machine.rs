//! A run beside processes that keep every core busy: the clock's scatter fails no cell and leaves no time of zero or less.

mod common;

use std::sync::atomic::{AtomicBool, Ordering};

use common::{cells, fathom, measured, stderr};
use fathom::record::Clock;

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
fn a_busy_machine_fails_no_cell_and_leaves_no_time_of_zero_or_less() {
    let folder = tempfile::tempdir().unwrap();
    let experiment = folder.path().join("short.toml");
    std::fs::write(&experiment, SHORT_STAGES).unwrap();
    let out = folder.path().join("out");
    let ran = beside_load(|| {
        let mut fathom = fathom();
        fathom.args(["run", "--no-ceilings"]).arg(&experiment).arg("--out").arg(&out);
        fathom.args(["--budget", "2", "--precision", "0.0001"]).output().unwrap()
    });
    stderr(&ran, 0);
    let cells = cells(&out);
    assert_eq!(cells.len(), 2);
    for measured in cells.iter().map(measured) {
        assert!(measured.rejected.is_empty(), "{:?}", measured.rejected);
        assert!(measured.frame.accounting_error < 0.05, "{:?}", measured.frame);
        for stage in &measured.stages {
            assert!(stage.samples_ns.iter().all(|ns| *ns > 0.0), "{stage:?}");
            assert!(stage.time.ends()[0] > 0.0, "{stage:?}");
            let fenced = stage.fenced.as_ref();
            let by_fence = matches!(stage.clock, Clock::FencedHost | Clock::ProcessCpu);
            assert_eq!(fenced.is_some(), by_fence, "{stage:?}");
            assert!(fenced.is_none_or(|fenced| fenced.resolution_ns > 0.0));
        }
    }
    let table = std::fs::read_to_string(out.join("summary.md")).unwrap();
    assert!(!table.contains("| -") && !table.contains("| 0 ("), "{table}");
}
