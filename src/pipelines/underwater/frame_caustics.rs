//! Irradiance that a frame's caustics bring to what each of their pixels shows.

use super::{IntensityRule, Underwater};
use crate::Judge;
use crate::caustics_image::{FrameCaustics, channel};
use crate::settings::Animation;
use fathom_gpu::{Gpu, GpuError, read_texture};
use fathom_reference::image::Image;
use fathom_reference::rays::{PixelRays, Tracer};
use fathom_stages::uniforms::View;

/// Least cosine between line of sight and normal for which flux is turned into irradiance, as in `shaders/compose.wgsl`.
const MIN_FACING: f64 = 0.1;

impl Underwater {
    /// As `compose` has it, at the pixels of the caustics buffer.
    pub(super) fn frame_caustics(&self, gpu: &Gpu) -> Result<FrameCaustics, GpuError> {
        let texels = channel(&read_texture(gpu, self.caustics.texture())?, 0);
        let scale = f64::from(self.plan.compose.caustics_scale);
        let (intensity, view) = (self.params.caustics.intensity, self.view.clone());
        let irradiance = move |judge: &Judge<'_>| match intensity {
            IntensityRule::Paper => Ok(texels.map(|value| value * scale)),
            IntensityRule::Conserving => {
                let still = Animation::default();
                let tracer = judge.references.geometry.tracer(judge.scene, &still);
                Ok(per_area(&view, &texels, &tracer))
            }
        };
        let (irradiance, view) = (Box::new(irradiance), self.view.clone());
        Ok(FrameCaustics { irradiance, stage: self.caustics.last, view })
    }
}

/// The flux in each pixel over the area of the surface behind it.
fn per_area(view: &View, flux: &Image, tracer: &Tracer) -> Image {
    let camera = &view.camera;
    let [width, height] = flux.size();
    let rays = PixelRays::of_matrix(camera.view_projection(view.aspect()), width, height);
    let side = view.pixel_tangent(flux.size());
    Image::from_fn(flux.size(), |x, y| {
        let Some((hit, _)) = rays.cast(tracer, x, y) else { return 0.0 };
        let sight = hit.position - camera.position();
        let (d, z) = (sight.length(), sight.dot(camera.direction()));
        let facing = (hit.normal.dot(sight).abs() / d).max(MIN_FACING);
        flux.clamped(x.into(), y.into()) * facing * d / (side * side * z.powi(3))
    })
}
