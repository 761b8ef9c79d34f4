//! A device that is lost while a run measures.

use std::sync::Mutex;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use fathom::Catalog;
use fathom::gpu::{Gpu, GpuError};
use fathom::harness::plan::Request;
use fathom::harness::run::{self, RunOptions};
use fathom::pipelines::voxelize::Voxelize;
use fathom::pipelines::{AnyPipeline, PipelineKind};
use fathom::record::Outcome;
use fathom::scene::Scene;
use itertools::Itertools as _;
use serde_json::Value;

use crate::common::{Place, cells};

const EXPERIMENT: &str = r#"
id = "lost"
title = "t"
source = "s"
pipeline = "voxelize"
scene = "corner"
params = { view = { width = 16, height = 16 } }
[[sweep]]
[[sweep.axis]]
name = "voxel.resolution"
values = [16, 20, 24, 32]
"#;

/// Behind the first pipeline of so many voxels the device is destroyed.
static DESTROYING: Mutex<Vec<u64>> = Mutex::new(Vec::new());

fn build(tree: &Value, gpu: &Gpu, scene: &Scene) -> Result<Box<AnyPipeline>, GpuError> {
    let built = (PipelineKind::new::<Voxelize>().build)(tree, gpu, scene);
    let is_here = |side: &mut u64| tree["voxel"]["resolution"] == *side;
    if DESTROYING.lock().unwrap().extract_if(.., is_here).count() > 0 {
        gpu.device.destroy();
    }
    built
}

/// In a process of its own on one core, where the audit of its clock is soon done.
#[test]
fn a_lost_device_fails_one_cell_by_its_name_and_one_lost_again_ends_the_run() {
    let child = super::this_program("lost_device::child").output().unwrap();
    assert!(child.status.success(), "{}", String::from_utf8_lossy(&child.stderr));
}

#[test]
#[ignore = "run by the other test"]
fn child() {
    fathom_base::quiet::begin_again();
    let place = Place::new();
    let experiments = vec![place.write("lost.toml", EXPERIMENT).display().to_string()];
    for (destroying, measured, reasons) in [
        (vec![24], 3, vec!["device lost: "]),
        // The second time it is not opened again, and what was measured before stays.
        (
            vec![20, 24],
            1,
            vec!["device lost: ", "device lost: ", "not recovered: it was lost before"],
        ),
    ] {
        *DESTROYING.lock().unwrap() = destroying;
        let mut catalog = Catalog::builtin();
        catalog.kinds = vec![PipelineKind { build, ..PipelineKind::new::<Voxelize>() }];
        let out = place.path(measured.to_string());
        let options = RunOptions {
            catalog,
            request: Request { experiments: experiments.clone(), ..Request::default() },
            budget_s: Some(600.0),
            precision: Some(1.0),
            out: Some(out.clone()),
            no_ceilings: true,
            ..RunOptions::default()
        };
        let goes_on = AtomicBool::new(false);
        let summary = run::run(&options, Instant::now(), &mut |_, _, _| (), &goes_on).unwrap();
        assert_eq!((summary.counts.measured, summary.counts.failed), (measured, reasons.len()));
        let cells = cells(&out);
        let failed = cells.iter().filter_map(|cell| match &cell.outcome {
            Outcome::Failed { reason } => Some(reason),
            _ => None,
        });
        let failed = failed.sorted_by_key(|reason| reason.contains("not recovered"));
        for (reason, expected) in failed.zip(reasons) {
            assert!(reason.contains(expected), "{reason}");
        }
    }
}
