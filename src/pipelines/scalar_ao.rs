//! Ambient occlusion in scalar fields and participating media: Papaioannou, Menexi and Papadopoulos, *Real-time Volume-based
//! Ambient Occlusion* (VAO), §5.2.

mod judge;
mod parameters;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;

use super::settings::{self, VIEWPORT};
use super::{Judging, Pipeline, PipelineInstance, to_map};
use fathom_gpu::kit::{self, Resources};
use fathom_gpu::{Gpu, GpuError, read_texture};
use fathom_record::Work;
use fathom_scene::{Camera, Scene, Volume};
use fathom_stages::Stage;
use fathom_stages::ray_cast::{self, Cast};
use fathom_stages::scalar;
use fathom_stages::scalar_field::ScalarField;
use fathom_stages::uniforms::Shared;

pub use parameters::{Gather, Law, Mode, Params, Scalar, Stop};

fn volume_of(scene: &Scene) -> Result<&Volume, GpuError> {
    scene.volume.as_ref().ok_or_else(|| {
        GpuError::Unusable(format!(
            "scene `{}` has no volume: pipeline scalar_ao needs one, such as engine, smoke or bonsai",
            scene.name
        ))
    })
}

/// Rays cast through a scalar field.
pub struct ScalarAo {
    settings: Scalar,
    camera: Camera,
    cast: Cast,
    field: ScalarField,
    r_max_m: f64,
}

impl ScalarAo {
    /// Visibility, opacity, distance and look-ups of each pixel: see [`Cast::result`].
    pub fn result(&self) -> &wgpu::Texture {
        &self.cast.result
    }
}

impl Pipeline for ScalarAo {
    const NAME: &'static str = "scalar_ao";
    const ABOUT: &'static str = "ambient occlusion in scalar fields (VAO §5.2): an isosurface, direct volume rendering, or smoke";
    type Params = Params;

    fn new(resources: &Resources<'_>, scene: &Scene, params: &Params) -> Result<Self, GpuError> {
        let volume = volume_of(scene)?;
        let named = |fault| GpuError::Unusable(format!("volume `{}`: {fault}", volume.name));
        volume.validate().map_err(named)?;
        let r_max_m = settings::r_max_m(scene, params.scalar.r_max_m, params.scalar.r_max_share);
        params.scalar.check_volume(volume, r_max_m)?;
        let view = settings::view(&params.view, &params.camera, &params.light, scene);
        let shared = settings::begin(resources, &view);
        let field = ScalarField::new(resources, volume, params.scalar.needs_pyramid());
        let of_view = &resources.with_size_hint(VIEWPORT);
        let size_px = [params.view.width, params.view.height];
        let stage = cast(of_view, &shared, &field, &params.scalar, size_px, r_max_m)?;
        let cast = of_view.push(stage);
        let texel_fetches =
            kit::pixels(&cast.image).saturating_mul(params.scalar.typical_fetches(volume));
        of_view.add_work("look-ups", Work { texel_fetches, ..Work::default() });
        let (settings, camera) = (params.scalar.clone(), params.camera.clone());
        Ok(Self { settings, camera, cast, field, r_max_m })
    }
}

impl PipelineInstance for ScalarAo {
    fn image(&self) -> &wgpu::Texture {
        &self.cast.image
    }

    fn quantities(&self, gpu: &Gpu) -> Result<BTreeMap<String, f64>, GpuError> {
        let pixels = read_texture(gpu, self.result())?;
        let texels =
            || pixels.data.chunks_exact(4).map(|t| [t[0], t[1], t[2], t[3]].map(f64::from));
        let count = texels().count() as f64;
        let covered = || texels().filter(|[_, opacity, ..]| *opacity > 0.0);
        let covered_count = covered().count() as f64;
        let look_ups: f64 = texels().map(|[.., look_ups]| look_ups).sum();
        let max = texels().fold(0.0, |max: f64, [.., look_ups]| max.max(look_ups));
        let visibility: f64 = covered().map(|[visibility, ..]| visibility).sum();
        let settings = &self.settings;
        let step_m = self.r_max_m / f64::from(settings.samples);
        let mut figures = vec![
            ("samples_per_pixel", look_ups / count),
            ("samples_per_pixel_most", max),
            ("covered_share", covered_count / count),
            ("r_max_m", self.r_max_m),
            ("step_voxels", step_m / self.field.voxel_m),
            ("voxel_m", self.field.voxel_m),
            ("volume_bytes", self.field.bytes() as f64),
        ];
        if covered_count > 0.0 {
            figures.push((
                "samples_per_covered_pixel",
                covered().map(|[.., n]| n).sum::<f64>() / covered_count,
            ));
            figures.push(("visibility_mean", visibility / covered_count));
        }
        Ok(to_map(figures))
    }

    fn judge(&self, gpu: &Gpu) -> Result<Judging, GpuError> {
        self.read(gpu)
    }
}

/// The stage that `scalar.mode` names.
pub fn cast(
    resources: &Resources<'_>,
    shared: &Shared,
    field: &ScalarField,
    settings: &Scalar,
    size_px: [u32; 2],
    r_max_m: f64,
) -> Result<Stage<Cast>, GpuError> {
    let march = &settings.uniforms(size_px, field.voxel_m, r_max_m);
    // With Beer's law values are densities (Eq. 5), else opacities (Eq. 7). Rejection: Eq. 4.
    let defs = [("BEER", settings.law == Law::Beer), ("REJECTION", settings.rejection)];
    let medium = |info| ray_cast::new(resources, info, shared, field, &defs, false, march);
    match settings.mode {
        Mode::Isosurface => {
            scalar::isosurface::new(resources, shared, field, march, settings.surface_rays())
        }
        Mode::Direct => medium(&scalar::direct::INFO),
        Mode::Positional => medium(&scalar::positional::INFO),
    }
}
