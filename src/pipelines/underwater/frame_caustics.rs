//! Irradiance that a frame's caustics bring to what each of their pixels shows.

use super::{IntensityRule, Underwater};
use crate::caustics_image::{FrameCaustics, channel};
use crate::settings::Animation;
use crate::{Judge, JudgeError};
use fathom_gpu::read_texture;
use fathom_reference::image::Image;
use fathom_reference::rays::{PixelRays, Tracer};

/// Least cosine between line of sight and normal for which flux is turned into irradiance, as in `shaders/compose.wgsl`.
const MIN_FACING: f64 = 0.1;

impl Underwater {
    /// As `compose` has it, at the pixels of the caustics buffer.
    pub(super) fn frame_caustics(
        &self,
        judge: &mut Judge<'_>,
    ) -> Result<FrameCaustics, JudgeError> {
        let texels = channel(&read_texture(judge.gpu, self.caustics.texture())?, 0);
        let scale = f64::from(self.plan.compose.caustics_scale);
        let irradiance = match self.params.caustics.intensity {
            IntensityRule::Paper => texels.map(|value| value * scale),
            IntensityRule::Conserving => {
                let still = Animation::default();
                let tracer = judge.references.geometry.tracer(judge.scene, &still);
                self.per_area(&texels, &tracer)
            }
        };
        Ok(FrameCaustics { irradiance, stage: self.caustics.last })
    }

    /// The flux in each pixel over the area of the surface behind it.
    fn per_area(&self, flux: &Image, tracer: &Tracer) -> Image {
        let camera = &self.view.camera;
        let [width, height] = flux.size();
        let rays = PixelRays::of_matrix(camera.view_projection(self.view.aspect()), width, height);
        let side = self.view.pixel_tangent(flux.size());
        Image::from_fn(flux.size(), |x, y| {
            let Some((hit, _)) = rays.cast(tracer, x, y) else { return 0.0 };
            let sight = hit.position - camera.position();
            let (d, z) = (sight.length(), sight.dot(camera.direction()));
            let facing = (hit.normal.dot(sight).abs() / d).max(MIN_FACING);
            flux.clamped(x.into(), y.into()) * facing * d / (side * side * z.powi(3))
        })
    }
}
