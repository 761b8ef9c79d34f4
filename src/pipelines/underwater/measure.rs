//! Figures read back from a frame: what became of the photons.

use std::collections::BTreeMap;

use super::Underwater;
use crate::gpu::{Gpu, GpuError, read_buffer};
use crate::stages::photon::{MISSED, OUTSIDE, Photon, Photons};

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
                ("missed_water_share", share(&|p| p.residual_m == MISSED)),
                ("left_frustum_share", share(&|p| p.residual_m == OUTSIDE)),
                ("unconverged_share", share(&|p| p.residual_m > tolerance)),
            ];
            quantities.extend(figures.map(|(figure, value)| (format!("{name}.{figure}"), value)));
        }
        Ok(quantities)
    }
}

/// Reads a photon buffer back.
pub fn read_photons(gpu: &Gpu, photons: &Photons) -> Result<Vec<Photon>, GpuError> {
    Ok(bytemuck::pod_collect_to_vec(&read_buffer(gpu, &photons.buffer)?))
}
