//! Shadows by rays traced in screen space: Krüger, Bürger and Westermann (SPT) §5, Fig. 11 and 12.

use std::collections::BTreeMap;

use super::screen_tracing::{self, Composition, LayeredDepth, RaySettings};
use super::settings::{self, VIEWPORT};
use super::{Errors, Judging, Parameters, Pipeline, PipelineInstance, PixelComparison};
use super::{exact_answers, judged_view, objects_of, occlusion::signed_color, share, to_map};
use fathom_base::parameter::ParamError;
use fathom_base::settings;
use fathom_gpu::kit::Resources;
use fathom_gpu::{Gpu, GpuError};
use fathom_reference::picture::PictureLight;
use fathom_reference::rays::{PixelRays, Tracer};
use fathom_scene::{Camera, Light, Scene, SceneFile};
use fathom_stages::geometry::{Geometry, Objects};
use fathom_stages::photon::{Fate, Photon, Photons};
use fathom_stages::screen_ray::RayInputs;
use fathom_stages::uniforms::View;
use fathom_stages::{ldi, scene, shadow, transfer};
use image::{Rgb, RgbImage};

settings! {
    pub struct Params from file: SceneFile {
        // SPT §5: 800 × 600.
        view: settings::Viewport = settings::Viewport { width: 800, height: 600 };
        camera: Camera = file.camera.clone();
        light: Light = file.light.clone();
        ldi: LayeredDepth = LayeredDepth::default();
        rays: RaySettings =
            RaySettings { start_m: START_M * file.tank_scale(), ..RaySettings::from(file) };
        /// Whether rays start only on materials that are a `receiver`, as in SPT §5; else on all that faces the light.
        receivers_only: bool = false;
        compose: Composition = Composition::default();
    }
}

/// Rays start on surfaces. Within this distance surfaces do not hide themselves, metres in scene tank.
const START_M: f64 = 0.03;
/// At most about this many pixels are compared with the reference.
const MAX_PIXELS: usize = 40_000;
/// A ray cast from a surface starts this far from it, metres in scene tank.
const OFF_M: f64 = 1e-4;

impl Parameters for Params {
    fn check_consistent(&self) -> Result<(), ParamError> {
        self.rays.fits(self.view.width.saturating_mul(self.view.height), 1, VIEWPORT)
    }
}

/// Shadows of what the camera sees.
pub struct ShadowRays {
    params: Params,
    view: View,
    /// Ends of the rays to the light, a pixel each.
    pub photons: Photons,
    image: wgpu::Texture,
}

impl Pipeline for ShadowRays {
    const NAME: &'static str = "shadow_rays";
    const ABOUT: &'static str = "shadows by rays in screen space (SPT §5): each pixel's ray to the light through layered depth";
    type Params = Params;

    fn new(resources: &Resources<'_>, scene: &Scene, params: &Params) -> Result<Self, GpuError> {
        scene.needs_objects(Self::NAME).map_err(GpuError::Unusable)?;
        let view = settings::view(&params.view, &params.camera, &params.light, scene);
        let shared = &settings::begin(resources, &view);
        let geometry = &Geometry::new(resources, scene);
        let size_px = view.size_px.to_array();
        let of_view = &resources.with_size_hint(VIEWPORT);
        let gbuffer = of_view.push(scene::gbuffer::new(of_view, shared, geometry, size_px)?);
        let of_layers = &resources.with_size_hint("view × ldi.layers");
        let (of, layers) = (Objects::Opaque, params.ldi.layers);
        let peel = ldi::peel::new(of_layers, shared, scene, geometry, of, size_px, layers)?;
        let layers = of_layers.push(peel);
        let starts = transfer::shadow::new(of_view, shared, &layers, params.receivers_only)?;
        let starts = of_view.push(starts);
        let traced = RayInputs {
            transfers: &starts,
            layers: &layers,
            bounds: scene.solid_bounds(),
            walking: params.rays.walking(resources.gpu, 1, 1),
        };
        let photons = screen_tracing::trace(of_view, shared, &traced, params.rays.method)?;
        let exposure = params.compose.exposure;
        let compose = shadow::compose::new(of_view, shared, &gbuffer, &photons, exposure)?;
        let image = of_view.push(compose);
        Ok(Self { params: params.clone(), view, photons, image })
    }
}

impl PipelineInstance for ShadowRays {
    fn image(&self) -> &wgpu::Texture {
        &self.image
    }

    /// Share of the pixels that face the light, and of these that are in shadow.
    fn quantities(&self, gpu: &Gpu) -> Result<BTreeMap<String, f64>, GpuError> {
        let ends = self.photons.read(gpu)?;
        let facing = ends.iter().filter(|end| end.fate() != Fate::MissedWater).count();
        let light = light_of(&self.view);
        let shadowed = ends.iter().filter(|end| is_shadowed(end, &light)).count();
        Ok(to_map([
            ("facing_light_rate", share(facing, ends.len())),
            ("shadowed_rate", share(shadowed, facing)),
        ]))
    }

    fn judge(&self, gpu: &Gpu) -> Result<Judging, GpuError> {
        let (ends, view) = (self.photons.read(gpu)?, self.view.clone());
        let stage = self.params.rays.method.info().name;
        Ok(Box::new(move |judge| {
            let compared = compare(&view, &ends, judge.scene, MAX_PIXELS);
            let pixels: Vec<InShadow> = compared.into_iter().map(|(_, pixel)| pixel).collect();
            Ok(Errors::new(stage, shadow_errors(&pixels), []))
        }))
    }

    /// Every pixel that faces the light: dark in shadow, white elsewhere; red where a shadow is missed, blue where one is false.
    fn compare_pixels(
        &self,
        gpu: &Gpu,
        scene: &Scene,
    ) -> Result<Option<PixelComparison>, GpuError> {
        let ends = self.photons.read(gpu)?;
        let [width, height] = self.view.size_px.to_array();
        let mut exact = RgbImage::from_pixel(width, height, Rgb([190; 3]));
        let mut error = exact.clone();
        for (pixel, in_shadow) in compare(&self.view, &ends, scene, ends.len()) {
            let [x, y] = [pixel as u32 % width, pixel as u32 / width];
            exact.put_pixel(x, y, InShadow { found: in_shadow.exact, ..in_shadow }.color());
            error.put_pixel(x, y, in_shadow.color());
        }
        Ok(Some(PixelComparison { exact, error }))
    }
}

/// Whether a pixel is in shadow, as it was found and by ray casting.
#[derive(Clone, Copy)]
struct InShadow {
    found: bool,
    exact: bool,
}

impl InShadow {
    fn color(self) -> Rgb<u8> {
        Rgb(match (self.found, self.exact) {
            (true, true) => [110; 3],
            (false, false) => [255; 3],
            (false, true) => signed_color(1.0),
            (true, false) => signed_color(-1.0),
        })
    }
}

/// Shares of the pixels that face the light: wrong ones, and their two kinds.
fn shadow_errors(pixels: &[InShadow]) -> [(&'static str, f64, &'static str); 3] {
    let rate = |is_so: fn(&InShadow) -> bool| {
        share(pixels.iter().filter(|pixel| is_so(pixel)).count(), pixels.len())
    };
    [
        ("shadow_wrong_rate", rate(|pixel| pixel.found != pixel.exact), "1"),
        ("shadow_missed_rate", rate(|pixel| pixel.exact && !pixel.found), "1"),
        ("shadow_false_rate", rate(|pixel| pixel.found && !pixel.exact), "1"),
    ]
}

fn light_of(view: &View) -> PictureLight {
    PictureLight::new(&view.camera, &view.light, &view.water)
}

fn is_shadowed(end: &Photon, light: &PictureLight) -> bool {
    end.has_landed() && f64::from(end.distance_m) < light.distance_m(end.entry())
}

/// An even selection of at most about so many of the pixels that face the light, each with its number.
fn compare(
    drawn: &View,
    ends: &[Photon],
    scene: &Scene,
    max_pixels: usize,
) -> Vec<(usize, InShadow)> {
    let tracer = Tracer::new(&objects_of(scene, Objects::Opaque));
    let view = &judged_view(drawn, scene);
    let [width, height] = view.size_px.to_array();
    let rays = PixelRays::new(&view.camera, width, height);
    let off_m = OFF_M * scene.solid_bounds().tank_scale();
    let light = light_of(view);
    let answers = exact_answers(ends.len(), max_pixels, |pixel| {
        let [x, y] = [pixel as u32 % width, pixel as u32 / width];
        let place = rays.cast(&tracer, x, y)?.0.position;
        Some(tracer.cast(place, light.to_light(place), off_m, light.distance_m(place)).is_some())
    });
    let (facing, drawn) = (|n: usize| ends[n].fate() != Fate::MissedWater, light_of(drawn));
    let pair = |(n, exact)| (n, InShadow { found: is_shadowed(&ends[n], &drawn), exact });
    answers.into_iter().filter(|(n, _)| facing(*n)).map(pair).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_kinds_of_wrong_pixels_are_told_apart() {
        let pairs = [(true, true), (true, false), (false, true), (false, true), (false, false)];
        let pairs = pairs.map(|(found, exact)| InShadow { found, exact });
        assert_eq!(shadow_errors(&pairs).map(|(_, value, _)| value), [0.6, 0.4, 0.2]);
        assert_eq!(shadow_errors(&[]).map(|(_, value, _)| value), [0.0; 3]);
    }
}
