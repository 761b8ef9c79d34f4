//! Occlusion in a scalar field against rays cast through the same field.

use glam::DVec3;
use rayon::prelude::*;

use super::{Gather, Law, Mode, Scalar, ScalarAo};
use crate::occlusion::{exact, figures, lattice};
use crate::{Errors, Judge, JudgeError, Judging, to_map};
use fathom_base::statistics::mean;
use fathom_gpu::{Gpu, GpuError, Pixels, read_texture};
use fathom_reference::isosurface::FieldSurface;
use fathom_reference::media::{self, FieldMarch};
use fathom_reference::occlusion::Obscurity;
use fathom_reference::rays::PixelRays;
use fathom_scene::Volume;
use fathom_stages::scalar;

/// Pixels that figures rest on at most, and rays at each point that they show.
const MAX_POINTS: f64 = 800.0;
const RAYS: u32 = 256;
/// The same in a medium, where each pixel shows many points.
const MAX_IN_MEDIUM: f64 = 300.0;
const RAYS_IN_MEDIUM: u32 = 96;
/// Steps along view rays and strata of occlusion rays in a medium, voxels.
const STEP_VOXELS: f64 = 0.5;
/// The window and the opacity at its end that leave values as they are.
const UNCHANGED: ([f64; 2], f64) = ([0.0, 1.0], 1.0);

/// Origin on the near plane, unit direction and length up to the far plane.
type ViewRay = (DVec3, DVec3, f64);

impl ScalarAo {
    /// Errors `ao_rmse` and `ao_bias` and the means `ao_mean` and `ao_reference_mean`, in units of A. Rays that gather opacity at an
    /// isosurface know no ρ: their reference has none. That of a medium marches by the same law and rejection in fine strata at
    /// the field's full resolution, and no threshold ends it. Nothing of a medium whose window or opacity changes values: a
    /// window's cut and interpolation do not commute.
    pub(super) fn read(&self, gpu: &Gpu) -> Result<Judging, GpuError> {
        let pixels = read_texture(gpu, self.result())?;
        let view = PixelRays::new(&self.camera, pixels.width, pixels.height);
        let (settings, lengths_m) = (self.settings.clone(), [self.field.voxel_m, self.r_max_m]);
        Ok(Box::new(move |judge| judged(judge, &pixels, &view, &settings, lengths_m)))
    }
}

/// `lengths_m`: of a voxel, and of the rays.
fn judged(
    judge: &Judge<'_>,
    pixels: &Pixels,
    view: &PixelRays,
    settings: &Scalar,
    [voxel_m, r_max_m]: [f64; 2],
) -> Result<Errors, JudgeError> {
    let Some(volume) = &judge.scene.volume else {
        return Ok(Errors::default());
    };
    let exact = ScalarReference { volume, settings, voxel_m, r_max_m };
    let unchanged = (settings.window, settings.opacity) == UNCHANGED;
    let in_medium = || compared(pixels, view, MAX_IN_MEDIUM, |ray| exact.in_medium(ray));
    let (stage, found) = match settings.mode {
        Mode::Isosurface => (
            scalar::isosurface::INFO.name,
            compared(pixels, view, MAX_POINTS, |ray| exact.at_isosurface(ray)),
        ),
        _ if !unchanged => return Ok(Errors::default()),
        Mode::Direct => (scalar::direct::INFO.name, in_medium()),
        Mode::Positional => (scalar::positional::INFO.name, in_medium()),
    };
    if found.is_empty() {
        return Err(JudgeError::Nothing);
    }
    let (values, exact): (Vec<f64>, Vec<f64>) = found.into_iter().unzip();
    let errors: Vec<f64> = values.iter().zip(&exact).map(|(a, exact)| a - exact).collect();
    let quantities = [("ao_mean", mean(values)), ("ao_reference_mean", mean(exact))];
    let errors = figures("ao", stage, &errors).into();
    Ok(Errors { errors, quantities: to_map(quantities), ..Errors::default() })
}

/// A as shown and as it should be, at a lattice of the pixels that show something.
fn compared(
    pixels: &Pixels,
    view: &PixelRays,
    max: f64,
    exact: impl Fn(ViewRay) -> Option<f64> + Sync,
) -> Vec<(f64, f64)> {
    let size = [pixels.width, pixels.height];
    let step = (f64::from(size[0]) * f64::from(size[1]) / max).sqrt().max(1.0);
    let places: Vec<[u32; 2]> = lattice(size, step).collect();
    let found = places.into_par_iter().filter_map(|[x, y]| {
        let shown = pixels.texel(x, y);
        let exact = (shown[1] > 0.0).then(|| exact(view.ray(x, y)))??;
        Some((1.0 - f64::from(shown[0]), exact))
    });
    found.collect()
}

struct ScalarReference<'a> {
    volume: &'a Volume,
    settings: &'a Scalar,
    voxel_m: f64,
    r_max_m: f64,
}

impl ScalarReference<'_> {
    fn surface(&self) -> FieldSurface<'_> {
        FieldSurface { field: self.volume, iso: self.settings.iso }
    }

    fn at_isosurface(&self, (origin, direction, length_m): ViewRay) -> Option<f64> {
        let attenuation = match self.settings.gather {
            Gather::End => exact(self.settings.attenuation),
            Gather::Opacity => Obscurity::Hard,
        };
        let surface = self.surface();
        let distance_m = surface.entry(origin, direction, length_m).filter(|d| *d > 0.0)?;
        let point = origin + direction * distance_m;
        surface.occlusion(point, self.r_max_m, attenuation, RAYS)
    }

    fn in_medium(&self, ray: ViewRay) -> Option<f64> {
        let marching = self.marching();
        let occlusion = |p| match self.settings.mode {
            Mode::Positional => marching.positional(self.volume, p, RAYS_IN_MEDIUM),
            _ => {
                let normal = self.surface().normal(p).unwrap_or(-ray.1);
                marching.hemispherical(self.volume, p, normal, RAYS_IN_MEDIUM)
            }
        };
        marching.along_view(self.volume, ray, STEP_VOXELS * self.voxel_m, occlusion)
    }

    fn marching(&self) -> FieldMarch {
        let Scalar { law, density_per_m, rejection, window, opacity, .. } = *self.settings;
        let law = match law {
            Law::Opacity => media::FieldLaw::Opacity { full: opacity, voxel_m: self.voxel_m },
            Law::Beer => media::FieldLaw::Beer { density_per_m },
        };
        let samples = (self.r_max_m / (STEP_VOXELS * self.voxel_m)).ceil() as u32;
        let threshold = f64::INFINITY;
        FieldMarch { law, window, r_max_m: self.r_max_m, samples, rejection, threshold }
    }
}
