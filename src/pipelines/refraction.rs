//! Refraction through glass as the camera sees it: Krüger, Bürger and Westermann (SPT) §4 and Table 1, beside Wyman's approximation.

use std::collections::BTreeMap;

use glam::DVec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::screen_tracing::{Composition, LayeredDepth};
use super::settings::{self, VIEWPORT};
use super::{Drawing, Judge, JudgeError, Judged, Parameters, Pipeline};
use super::{even_step, named, objects_of, share};
use fathom_base::choices;
use fathom_base::parameter::ParamError;
use fathom_base::settings;
use fathom_gpu::{Gpu, GpuError, read_texture};
use fathom_reference::quantities::quantile;
use fathom_reference::rays::{PixelRays, Tracer};
use fathom_reference::specular::Surfaces;
use fathom_scene::{Bounds, Camera, Light, Object, Scene, SceneFile};
use fathom_stages::geometry::{Geometry, Part};
use fathom_stages::kit::{Buffer, Resources};
use fathom_stages::refraction::Exits;
use fathom_stages::refraction::trace::{self, Surface};
use fathom_stages::refraction::two_interface;
use fathom_stages::screen_ray::{WalkUniforms, walk_uniforms};
use fathom_stages::uniforms::{Shared, View};
use fathom_stages::{ldi, refraction, scene};

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// Through layers of depth. SPT §4.
    Trace,
    /// Through the nearest and the farthest surface. Wyman 2005.
    TwoInterface,
}

choices!(Method);

settings! {
    /// Everything that can be set. The dotted paths of `--set` are these fields' names.
    pub struct Params from file: SceneFile {
        // SPT §5: 800 × 600.
        view: settings::View = settings::View { width: 800, height: 600 };
        camera: Camera = file.camera.clone();
        light: Light = file.light.clone();
        ldi: LayeredDepth = LayeredDepth { layers: 2 };
        refraction: Refraction = Refraction::default();
        compose: Composition = Composition::default();
    }
}

settings! {
    /// How lines of sight pass through glass. SPT §4.
    pub struct Refraction {
        /// What finds where they leave it.
        method: Method = Method::Trace;
        /// What a ray inside is held against. `depth` is the paper's.
        surface: Surface = Surface::Plane;
        /// Surfaces that refract a ray; each needs a layer. SPT Table 1: 2.
        count: u32 = 2 => 1 ..= 16, "1";
        /// Fewest steps of a ray. SPT §2.1 enforces a minimum and does not give it.
        least_px: u32 = 8 => 1 ..= 4096, "px";
    }
}

/// At most about this many pixels are compared with the reference.
const MOST_PIXELS: usize = 20_000;

impl Parameters for Params {
    fn consistent(&self) -> Result<(), ParamError> {
        let (count, layers) = (self.refraction.count, self.ldi.layers);
        if self.refraction.method == Method::Trace && count > layers {
            return Err(ParamError::Unfit(format!(
                "refraction.count = {count} needs as many layers: ldi.layers is {layers}"
            )));
        }
        Ok(())
    }
}

/// Glass in an environment.
pub struct ScreenRefraction {
    params: Params,
    view: View,
    exits: Exits,
    image: wgpu::Texture,
}

impl Pipeline for ScreenRefraction {
    const NAME: &'static str = "refraction";
    const ABOUT: &'static str =
        "refraction through glass in screen space (SPT §4), and by Wyman's two interfaces";
    type Params = Params;

    fn new(resources: &Resources<'_>, scene: &Scene, params: &Params) -> Result<Self, GpuError> {
        if !scene.objects.iter().any(|object| Part::Glass.holds(&object.material)) {
            let without = format!(
                "scene `{}` has no object whose material.optics is glass: pipeline {} needs one",
                scene.name,
                Self::NAME
            );
            return Err(GpuError::Unusable(without));
        }
        let view = settings::view(&params.view, &params.camera, &params.light, scene);
        let shared = &settings::begin(resources, &view);
        let geometry = &Geometry::new(resources, scene);
        let size_px = view.size_px.to_array();
        let of_view = &resources.sized_by(VIEWPORT);
        let gbuffer = of_view.push(scene::gbuffer::new(of_view, shared, geometry, size_px)?);
        let exits = match params.refraction.method {
            Method::Trace => traced(resources, shared, (scene, geometry), size_px, params)?,
            Method::TwoInterface => {
                let thickness_m = thickness(resources, scene);
                let stage = two_interface::new(of_view, shared, geometry, size_px, &thickness_m)?;
                of_view.push(stage)
            }
        };
        let exposure = params.compose.exposure;
        let opaque = opaque_bounds(scene);
        let compose =
            refraction::compose::new(of_view, shared, &gbuffer, &exits, opaque, exposure)?;
        let image = of_view.push(compose);
        Ok(Self { params: params.clone(), view, exits, image })
    }
}

impl Drawing for ScreenRefraction {
    fn image(&self) -> &wgpu::Texture {
        &self.image
    }

    /// Share of the pixels that show glass, and of these whose ray is totally reflected at the last surface.
    fn quantities(&self, gpu: &Gpu) -> Result<BTreeMap<String, f64>, GpuError> {
        let found = self.found(gpu)?;
        let glass = found.iter().flatten().count();
        let inside = found.iter().flatten().filter(|exit| exit.inside).count();
        Ok(named([
            ("glass_rate", share(glass, found.len())),
            ("totally_reflected_rate", share(inside, glass)),
        ]))
    }

    fn judge(&self, judge: &mut Judge<'_>) -> Result<Judged, JudgeError> {
        let mut angles_deg = self.angles_deg(&self.found(judge.gpu)?, judge.scene)?;
        let stage = match self.params.refraction.method {
            Method::Trace => &trace::INFO,
            Method::TwoInterface => &two_interface::INFO,
        };
        let errors = [
            ("refraction_error_median_deg", quantile(&mut angles_deg, 0.5), "°"),
            ("refraction_error_p90_deg", quantile(&mut angles_deg, 0.9), "°"),
        ];
        Ok(Judged::of(stage.name, errors, []))
    }
}

/// The box of what is seen through glass; none where there is nothing.
fn opaque_bounds(scene: &Scene) -> Option<Bounds> {
    let opaque = scene.objects.iter().filter(|object| Part::Opaque.holds(&object.material));
    opaque.map(|object| object.mesh.bounds()).reduce(Bounds::union)
}

/// Pushes the stages that trace lines of sight through layers.
fn traced(
    resources: &Resources<'_>,
    shared: &Shared,
    (scene, geometry): (&Scene, &Geometry),
    size_px: [u32; 2],
    params: &Params,
) -> Result<Exits, GpuError> {
    let of_layers = &resources.sized_by("view × ldi.layers");
    let glass = (geometry, Part::Glass);
    let peel = ldi::peel::new(of_layers, shared, glass, size_px, params.ldi.layers)?;
    let layers = of_layers.push(peel);
    let walk: WalkUniforms =
        walk_uniforms(&layers, scene.solid_bounds(), params.refraction.least_px);
    let of_view = &resources.sized_by(VIEWPORT);
    let method = (params.refraction.count, params.refraction.surface);
    Ok(of_view.push(trace::new(of_view, shared, &layers, &walk, method)?))
}

/// Way through the glass from each vertex against its normal, up to the nearest surface; 0 where there is none. Wyman's d_N, stored once.
fn thickness(resources: &Resources<'_>, scene: &Scene) -> Buffer {
    let count: usize = scene.objects.iter().map(|object| object.mesh.positions.len()).sum();
    let off_m = OFF_M * scene.solid_bounds().times_tank();
    let ways = || -> Vec<f32> {
        let tracer = Tracer::new(&objects_of(scene, Part::Glass));
        let way = |(p, n): (&[f32; 3], &[f32; 3])| {
            let [place, normal] = [p, n].map(|v| DVec3::from(v.map(f64::from)));
            let inwards = -normal.normalize_or_zero();
            tracer.cast(place, inwards, off_m, f64::MAX).map_or(0.0, |hit| hit.distance_m as f32)
        };
        let of = |object: &Object| -> Vec<f32> {
            let mesh = &object.mesh;
            if !Part::Glass.holds(&object.material) {
                return vec![0.0; mesh.positions.len()];
            }
            mesh.positions.par_iter().zip(&mesh.normals).map(way).collect()
        };
        scene.objects.iter().flat_map(of).collect()
    };
    let bytes = (count * size_of::<f32>()) as u64;
    let made = if resources.gpu.is_planner() { Vec::new() } else { ways() };
    resources.filled_by("thickness", bytes, wgpu::BufferUsages::STORAGE, || {
        bytemuck::cast_slice(&made).to_vec()
    })
}

/// A ray cast from a vertex starts this far from it, metres in scene tank.
const OFF_M: f64 = 1e-4;

/// A pixel's ray behind glass.
struct Exit {
    direction: DVec3,
    inside: bool,
}

impl ScreenRefraction {
    /// Row by row; none where a pixel shows no glass.
    fn found(&self, gpu: &Gpu) -> Result<Vec<Option<Exit>>, GpuError> {
        let positions = read_texture(gpu, &self.exits.positions)?;
        let directions = read_texture(gpu, &self.exits.directions)?;
        let exit = |(place, along): (&[f32], &[f32])| {
            let direction = DVec3::new(along[0].into(), along[1].into(), along[2].into());
            (place[3] > 0.0).then_some(Exit { direction, inside: along[3] > 0.0 })
        };
        Ok(positions.data.chunks_exact(4).zip(directions.data.chunks_exact(4)).map(exit).collect())
    }

    /// Angles between rays and exact ones, of an even selection of the pixels that show glass.
    fn angles_deg(&self, found: &[Option<Exit>], scene: &Scene) -> Result<Vec<f64>, JudgeError> {
        let objects = objects_of(scene, Part::Glass);
        let tracer = Tracer::new(&objects);
        let surfaces =
            Surfaces { tracer: &tracer, objects: &objects, outside: 1.0, top_m: f64::INFINITY };
        let [width, height] = self.view.size_px.to_array();
        let rays = PixelRays::new(&self.view.camera, width, height);
        let count = self.params.refraction.count;
        let shown = found.iter().flatten().count();
        let step = even_step(shown, MOST_PIXELS);
        let seen = (0..).zip(found).filter_map(|(pixel, exit)| Some((pixel, exit.as_ref()?)));
        let seen: Vec<(u32, &Exit)> = seen.step_by(step).collect();
        let angle = |(pixel, exit): &(u32, &Exit)| {
            let (origin, direction, _) = rays.ray(pixel % width, pixel / width);
            let exact = surfaces.behind(surfaces.sight(origin, direction), count)?;
            Some(exit.direction.angle_between(exact.direction).to_degrees())
        };
        Ok(seen.par_iter().filter_map(angle).collect())
    }
}
