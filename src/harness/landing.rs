//! Where a measured cell's photons land, against exact refraction and ray casting.

use std::collections::BTreeMap;

use super::subject::Subject;
use crate::gpu::{Gpu, GpuError, read_buffer};
use crate::pipelines::Pipeline;
use crate::pipelines::underwater::{self, Params};
use crate::reference::ReferenceError;
use crate::reference::photons::{PhotonGrid, land_all};
use crate::reference::quantities::{StoredPhoton, photon_errors, stored_photons};
use crate::reference::rays::Tracer;
use crate::scene::Scene;
use crate::stages::OutputData;

/// Photons of a grid that are held against the reference at most: enough for a 99th percentile.
const MOST_PHOTONS: usize = 10_000;

/// Why photons could not be held against the reference.
#[derive(Debug, thiserror::Error)]
pub enum LandingError {
    #[error(transparent)]
    Gpu(#[from] GpuError),
    #[error(transparent)]
    Reference(#[from] ReferenceError),
    #[error("stage {0} has no photons to read back")]
    NoPhotons(&'static str),
    #[error("{0}")]
    Params(String),
}

/// Errors of a measured cell's photons.
pub(super) fn cell_errors(
    gpu: &Gpu,
    subject: &Subject,
    pipeline: &dyn Pipeline,
) -> Result<BTreeMap<String, f64>, LandingError> {
    let params = Params::from_value(&subject.params).map_err(LandingError::Params)?;
    photon_quantities(gpu, &subject.scene, &params, pipeline)
}

/// Errors of the last frame's photons, of both grids: `caustics_photon_error_median_m`,
/// `…_photon_error_p99_m`, `…_photon_miss_rate` and `…_photon_false_hit_rate`, `godrays_…` likewise.
///
/// `scene` and `params` are those that the pipeline was built from. Of large grids an even selection is
/// judged.
pub fn photon_quantities(
    gpu: &Gpu,
    scene: &Scene,
    params: &Params,
    pipeline: &dyn Pipeline,
) -> Result<BTreeMap<String, f64>, LandingError> {
    let view = underwater::view(params, scene);
    let frame = view.light_frame();
    let tracer = Tracer::new(&scene.objects)?;
    let grids = [
        ("caustics", "caustics/trace", params.caustics.grid_settings()),
        ("godrays", "godrays/trace", params.godrays.grid_settings()),
    ];
    let mut quantities = BTreeMap::new();
    for (name, stage, settings) in grids {
        let grid =
            PhotonGrid::new(settings.grid, settings.subdivision)?.with_offset(settings.offset);
        let step = step(grid.count() as usize);
        let photons: Vec<StoredPhoton> =
            stage_photons(gpu, pipeline, stage)?.into_iter().step_by(step).collect();
        let landings = land_all(&frame, &view.water, &tracer, grid, step);
        let errors = photon_errors(&photons, &landings);
        let figures = [
            ("photon_error_median_m", errors.median_m),
            ("photon_error_p99_m", errors.p99_m),
            ("photon_miss_rate", errors.miss_rate),
            ("photon_false_hit_rate", errors.false_hit_rate),
        ];
        quantities.extend(figures.map(|(figure, value)| (format!("{name}_{figure}"), value)));
    }
    Ok(quantities)
}

/// Step through a grid's memory that leaves [`MOST_PHOTONS`]: odd, so that it meets every sub-photon
/// of a cell and not always the same column.
fn step(count: usize) -> usize {
    count.div_ceil(MOST_PHOTONS).max(1) | 1
}

/// Photons that a tracing stage left behind in the last frame.
pub fn stage_photons(
    gpu: &Gpu,
    pipeline: &dyn Pipeline,
    name: &'static str,
) -> Result<Vec<StoredPhoton>, LandingError> {
    let stages = pipeline.stages();
    let stage = stages.iter().find(|stage| stage.name() == name);
    for output in stage.map(|stage| stage.outputs()).unwrap_or_default() {
        if let OutputData::Buffer { buffer, .. } = output.data {
            return Ok(stored_photons(&read_buffer(gpu, &buffer)?));
        }
    }
    Err(LandingError::NoPhotons(name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_odd_and_leave_few() {
        for count in [1, 9_999, 10_000, 160_000, 4_000_000] {
            let step = step(count);
            assert!(step % 2 == 1 && count.div_ceil(step) <= MOST_PHOTONS);
        }
        assert_eq!(step(500), 1);
    }
}
