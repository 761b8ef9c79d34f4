//! Occlusion of an isosurface against rays cast through the same field.

use rayon::prelude::*;

use super::{Gather, Mode, ScalarAo};
use crate::occlusion::{figures, lattice};
use crate::settings::Attenuation;
use crate::{Judge, JudgeError, Judged, named};
use fathom_gpu::read_texture;
use fathom_reference::isosurface::FieldSurface;
use fathom_reference::occlusion as reference;
use fathom_reference::rays::PixelRays;
use fathom_stages::scalar::isosurface::INFO;

/// Pixels that figures rest on at most, and rays at each of them.
const MOST_POINTS: f64 = 800.0;
const RAYS: u32 = 256;

impl ScalarAo {
    /// Errors `ao_rmse` and `ao_bias` of an isosurface and the means `ao_mean` and `ao_reference_mean`, in units of A; nothing
    /// of media. Rays that gather opacity know no ρ: their reference has none.
    pub(super) fn judged(&self, judge: &mut Judge<'_>) -> Result<Judged, JudgeError> {
        let (Mode::Isosurface, Some(volume)) = (self.settings.mode, &judge.scene.volume) else {
            return Ok(Judged::default());
        };
        let pixels = read_texture(judge.gpu, self.result())?;
        let (width, height) = (pixels.width, pixels.height);
        let rays = PixelRays::new(&self.camera, width, height);
        let surface = FieldSurface { field: volume, iso: self.settings.iso };
        let attenuation = match (self.settings.gather, self.settings.attenuation) {
            (Gather::End, Attenuation::Linear) => reference::Attenuation::Linear,
            _ => reference::Attenuation::Hard,
        };
        let r_max_m = self.r_max_m;
        let step = (f64::from(width) * f64::from(height) / MOST_POINTS).sqrt().max(1.0);
        let places: Vec<[u32; 2]> = lattice([width, height], step).collect();
        let found = places.into_par_iter().filter_map(|[x, y]| {
            let shown = pixels.texel(x, y);
            let (origin, direction, length_m) = rays.ray(x, y);
            let point = surface.seen(origin, direction, length_m)?;
            let exact = surface.occlusion(point, r_max_m, attenuation, RAYS)?;
            (shown[1] > 0.0).then(|| (1.0 - f64::from(shown[0]), exact))
        });
        let found: Vec<(f64, f64)> = found.collect();
        if found.is_empty() {
            return Err(JudgeError::Nothing);
        }
        let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
        let (values, exact): (Vec<f64>, Vec<f64>) = found.into_iter().unzip();
        let errors: Vec<f64> = values.iter().zip(&exact).map(|(a, exact)| a - exact).collect();
        let quantities = [("ao_mean", mean(&values)), ("ao_reference_mean", mean(&exact))];
        let errors = figures("ao", INFO.name, &errors).into();
        Ok(Judged { errors, quantities: named(quantities) })
    }
}
