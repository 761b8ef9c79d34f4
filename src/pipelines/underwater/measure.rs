//! Figures read back from a frame: what became of the photons.

use std::collections::BTreeMap;

use glam::{DVec2, DVec4};
use serde_json::Value;

use super::Underwater;
use super::grid::largest_contraction;
use crate::caustics_image::FrameCaustics;
use crate::off_frustum::Frustum;
use crate::{Judging, PipelineInstance, share};
use fathom_gpu::{Gpu, GpuError};
use fathom_reference::godray::covered_px;
use fathom_stages::photon::{Fate, Photon, PhotonEstimator};

impl Underwater {
    /// Pixels that the lines of godrays cover in their buffer, each line's counted, hidden or not.
    fn covered_px(&self, photons: &[Photon]) -> f64 {
        let size = self.view.square_px(self.params.godrays_buffer());
        let (near_m, width_px) = (self.view.camera.z_near_m, self.params.godrays.line_width_px);
        let matrix = self.view.camera.view_projection(self.view.aspect());
        let place = |clip: DVec4| {
            let ndc = clip.truncate() / clip.w;
            let share = DVec2::new(ndc.x * 0.5 + 0.5, 0.5 - ndc.y * 0.5);
            share * size
        };
        let drawn = photons.iter().filter(|p| p.has_landed() && p.distance_m > 0.0);
        let lines = drawn.filter_map(|photon| {
            let ends = [photon.entry(), photon.hit()].map(|p| matrix * p.extend(1.0));
            let [start, end] = ends;
            // The part in front of the near plane.
            let crossing = || start.lerp(end, (near_m - start.w) / (end.w - start.w));
            let cut = |end: DVec4| if end.w < near_m { crossing() } else { end };
            (start.w.max(end.w) > near_m).then(|| ends.map(|end| place(cut(end))))
        });
        lines.map(|line| covered_px(line, width_px, size)).sum()
    }
}

impl PipelineInstance for Underwater {
    fn image(&self) -> &wgpu::Texture {
        &self.image
    }

    /// Shares of the photons that never enter the water, that leave the light's frustum, and that land in view, hidden or not; pixels that godrays cover; of
    /// the paper's estimator the factor of its error in an iteration, where it is largest.
    fn quantities(&self, gpu: &Gpu) -> Result<BTreeMap<String, f64>, GpuError> {
        let mut quantities = BTreeMap::new();
        let frustum = Frustum::new(&self.view, 1.0);
        for (name, _, settings, photons) in self.grids() {
            if settings.estimator == PhotonEstimator::Paper {
                let factor = largest_contraction(&self.view);
                quantities.insert(format!("{name}_contraction"), factor);
            }
            let photons = photons.read(gpu)?;
            let rate = |is_so: &dyn Fn(&Photon) -> bool| {
                share(photons.iter().filter(|photon| is_so(photon)).count(), photons.len())
            };
            let figures = [
                ("missed_water_rate", rate(&|photon| photon.fate() == Fate::MissedWater)),
                ("left_frustum_rate", rate(&|photon| photon.fate() == Fate::LeftLight)),
                ("in_view_rate", rate(&|p| p.has_landed() && frustum.holds(p.hit()))),
            ];
            quantities.extend(figures.map(|(figure, value)| (format!("{name}_{figure}"), value)));
            if name == "godrays" {
                quantities
                    .insert("godrays_covered_px".to_owned(), self.covered_px(&photons).round());
            }
        }
        Ok(quantities)
    }

    fn context(&self, stage: &str) -> Value {
        self.explained(stage)
    }

    fn judge(&self, gpu: &Gpu) -> Result<Judging, GpuError> {
        self.landing_errors(gpu)
    }

    fn caustics(&self, gpu: &Gpu) -> Result<Option<FrameCaustics>, GpuError> {
        self.frame_caustics(gpu).map(Some)
    }
}
