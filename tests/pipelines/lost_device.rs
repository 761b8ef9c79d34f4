//! A device that is lost while a run measures.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use fathom::Catalog;
use fathom::gpu::{Gpu, GpuError};
use fathom::harness::plan::Request;
use fathom::harness::run::{self, Options};
use fathom::pipelines::voxelize::{Params, Voxelize};
use fathom::pipelines::{Drawing, Pipeline};
use fathom::record::Outcome;
use fathom::scene::Scene;
use fathom::stages::kit::Resources;

use crate::common::{Place, cells};

static IS_DESTROYED: AtomicBool = AtomicBool::new(false);

/// Destroys the device when the first cell's figures are read.
struct Destroying(Voxelize);

impl Pipeline for Destroying {
    const NAME: &'static str = "destroying";
    const ABOUT: &'static str = "voxelization that destroys its device";
    type Params = Params;

    fn new(resources: &Resources<'_>, scene: &Scene, params: &Params) -> Result<Self, GpuError> {
        Voxelize::new(resources, scene, params).map(Self)
    }
}

impl Drawing for Destroying {
    fn image(&self) -> &wgpu::Texture {
        self.0.image()
    }

    fn quantities(&self, gpu: &Gpu) -> Result<BTreeMap<String, f64>, GpuError> {
        if !IS_DESTROYED.swap(true, Ordering::Relaxed) {
            gpu.device.destroy();
        }
        self.0.quantities(gpu)
    }
}

const EXPERIMENT: &str = r#"
id = "lost"
title = "t"
source = "s"
pipeline = "destroying"
scene = "corner"
params = { view = { width = 16, height = 16 } }
[[sweep]]
[[sweep.axis]]
name = "voxel.resolution"
values = [16, 24, 32]
"#;

#[test]
fn a_lost_device_fails_one_cell_by_its_name_and_the_others_are_measured() {
    let place = Place::new();
    let experiments = vec![place.write("lost.toml", EXPERIMENT).display().to_string()];
    let options = Options {
        catalog: Catalog::builtin().pipeline::<Destroying>(),
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
    let reasons = cells.iter().filter_map(|cell| match &cell.outcome {
        Outcome::Failed { reason } => Some(reason.as_str()),
        _ => None,
    });
    let reasons: Vec<&str> = reasons.collect();
    assert!(matches!(reasons[..], [reason] if reason.starts_with("device lost: ")), "{reasons:?}");
}
