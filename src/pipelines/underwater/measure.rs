//! Figures read back from a frame: what became of the photons.

use std::collections::BTreeMap;

use super::{Intensity, Params, Underwater, view};
use crate::gpu::{Gpu, GpuError, read_buffer, read_texture};
use crate::pipelines::Pipeline;
use crate::scene::Scene;
use crate::stages::frame::Shared;
use crate::stages::geometry::Geometry;
use crate::stages::kit::Resources;
use crate::stages::photon::{MISSED, OUTSIDE, Photon, Photons};
use crate::stages::photons::query::{Answer, Query, Start};
use crate::stages::shadow;

impl Underwater {
    pub(super) fn measured_quantities(&self, gpu: &Gpu) -> Result<BTreeMap<String, f64>, GpuError> {
        let grids = [
            ("caustics", &self.caustics_trace.0.photons, self.params.caustics.tolerance_m),
            ("godrays", &self.godrays_trace.0.photons, self.params.godrays.tolerance_m),
        ];
        let mut quantities = BTreeMap::new();
        for (name, photons, tolerance_m) in grids {
            let photons = read_photons(gpu, photons)?;
            let share = |test: &dyn Fn(&Photon) -> bool| {
                photons.iter().filter(|p| test(p)).count() as f64 / photons.len() as f64
            };
            let tolerance = tolerance_m as f32;
            let figures = [
                ("missed_water_rate", share(&|p| p.residual_m == MISSED)),
                ("left_frustum_rate", share(&|p| p.residual_m == OUTSIDE)),
                ("unconverged_rate", share(&|p| p.residual_m > tolerance)),
            ];
            quantities.extend(figures.map(|(figure, value)| (format!("{name}_{figure}"), value)));
        }
        Ok(quantities)
    }
}

/// Reads a photon buffer back.
pub fn read_photons(gpu: &Gpu, photons: &Photons) -> Result<Vec<Photon>, GpuError> {
    Ok(bytemuck::pod_collect_to_vec(&read_buffer(gpu, &photons.buffer)?))
}

/// Photons from given starts, by the settings of `caustics` and the scene as the light sees it. One start at least.
///
/// # Errors
/// What the GPU reports.
pub fn photons_at(
    gpu: &Gpu,
    scene: &Scene,
    params: &Params,
    starts: &[Start],
) -> Result<Vec<Answer>, GpuError> {
    let resources = &Resources::new(gpu);
    let shared = Shared::new(resources, &view(params, scene));
    let geometry = Geometry::new(resources, scene);
    let depth = shadow::depth::Depth::new(resources, &shared, &geometry, params.shadow.size)?;
    let cells = params.surface.cells;
    let mask = shadow::mask::Mask::new(resources, &shared, depth.texture(), cells)?;
    let query = Query::new(
        resources,
        &shared,
        (depth.texture(), mask.texture()),
        starts,
        &params.caustics.grid_settings().uniforms(),
        params.caustics.intensity == Intensity::Conserving,
    )?;
    gpu.run(&[&depth, &mask, &query])?;
    Ok(bytemuck::pod_collect_to_vec(&read_buffer(gpu, &query.answers)?))
}

/// Fragments that `caustics/splat` and `godrays/lines` blend in a frame, by stage.
///
/// Counted, not estimated: without attenuation and with isotropic scattering every blended fragment adds the same, so that
/// the sum over the buffer is their number.
pub fn blended_fragments(
    gpu: &Gpu,
    scene: &Scene,
    params: &Params,
) -> Result<BTreeMap<&'static str, u64>, GpuError> {
    let mut params = params.clone();
    params.water.attenuation_per_m = 0.0;
    params.water.fresnel = false;
    params.caustics.intensity = Intensity::Paper;
    params.godrays.intensity = Intensity::Paper;
    params.godrays.phase_k = 0.0;
    let pipeline = gpu.scoped(|| Underwater::new(gpu, scene, params))?;
    gpu.run(&pipeline.stages())?;

    let isotropic = 1.0 / (4.0 * std::f64::consts::PI);
    let targets = [
        (
            "caustics/splat",
            pipeline.caustics_splat.texture(),
            f64::from(pipeline.plan.splat.photon_w),
        ),
        (
            "godrays/lines",
            pipeline.godrays_lines.texture(),
            f64::from(pipeline.plan.lines.photon_w) * isotropic,
        ),
    ];
    let mut counts = BTreeMap::new();
    for (stage, texture, each) in targets {
        let sum: f64 = read_texture(gpu, texture)?.data.iter().map(|&v| f64::from(v)).sum();
        counts.insert(stage, (sum / each).round() as u64);
    }
    Ok(counts)
}
