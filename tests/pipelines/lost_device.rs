//! A device that is lost while a run measures.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use fathom::Catalog;
use fathom::gpu::{Gpu, GpuError};
use fathom::harness::plan::Request;
use fathom::harness::run::{self, Options};
use fathom::pipelines::voxelize::Voxelize;
use fathom::pipelines::{AnyPipeline, PipelineKind};
use fathom::record::Outcome;
use fathom::scene::Scene;
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
values = [16, 24, 32]
"#;

/// Builds a pipeline, and destroys the device behind the first of 24 voxels.
fn build(tree: &Value, gpu: &Gpu, scene: &Scene) -> Result<Box<AnyPipeline>, GpuError> {
    static IS_DESTROYED: AtomicBool = AtomicBool::new(false);
    let built = (PipelineKind::of::<Voxelize>().build)(tree, gpu, scene);
    if tree["voxel"]["resolution"] == 24 && !IS_DESTROYED.swap(true, Ordering::Relaxed) {
        gpu.device.destroy();
    }
    built
}

/// In a process of its own on one core, where the audit of its clock is soon done.
#[test]
fn a_lost_device_fails_one_cell_by_its_name_and_the_others_are_measured() {
    let child = super::this_program("lost_device::child").output().unwrap();
    assert!(child.status.success(), "{}", String::from_utf8_lossy(&child.stderr));
}

#[test]
#[ignore = "run by the other test"]
fn child() {
    fathom_base::quiet::begin_again();
    let place = Place::new();
    let experiments = vec![place.write("lost.toml", EXPERIMENT).display().to_string()];
    let mut catalog = Catalog::builtin();
    catalog.kinds = vec![PipelineKind { build, ..PipelineKind::of::<Voxelize>() }];
    let options = Options {
        catalog,
        request: Request { experiments, ..Request::default() },
        budget_s: Some(600.0),
        precision: Some(1.0),
        out: Some(place.path("out")),
        no_ceilings: true,
        ..Options::default()
    };
    let goes_on = AtomicBool::new(false);
    let summary = run::run(&options, Instant::now(), &mut |_, _, _| (), &goes_on).unwrap();
    assert_eq!((summary.counts.measured, summary.counts.failed), (2, 1));
    let cells = cells(&place.path("out"));
    let failed = cells.iter().find(|cell| cell.cell == "voxel.resolution=24").unwrap();
    let Outcome::Failed { reason } = &failed.outcome else { panic!("{failed:?}") };
    assert!(reason.starts_with("device lost: "), "{reason}");
}
