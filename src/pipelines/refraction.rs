//! Refraction through glass as the camera sees it: Krüger, Bürger and Westermann (SPT) §4 and Table 1, beside Wyman's approximation.

use std::collections::BTreeMap;
use std::iter::successors;

use glam::{DVec2, DVec3, DVec4, UVec2, Vec4Swizzles};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::screen_tracing::{self, Composition, LayeredDepth, MAX_TILES, ROWS};
use super::settings::{self, VIEWPORT};
use super::{Errors, Judging, Parameters, Pipeline, PipelineInstance};
use super::{even_step, objects_of, share, to_map};
use fathom_base::choices;
use fathom_base::parameter::ParamError;
use fathom_base::settings;
use fathom_gpu::kit::{Buffer, Resources};
use fathom_gpu::{Gpu, GpuError, read_texture};
use fathom_record::{Note, NoteKind};
use fathom_reference::quantities::quantile;
use fathom_reference::rays::{PixelRays, Projected, Tracer};
use fathom_reference::specular::Surfaces;
use fathom_scene::{Bounds, Camera, Light, Object, Scene, SceneFile};
use fathom_stages::geometry::{Geometry, Objects};
use fathom_stages::refraction::Exits;
use fathom_stages::refraction::trace;
use fathom_stages::refraction::two_interface;
use fathom_stages::screen_ray::{
    GlassSurface, HitTest, Layers, RayInputs, SightUniforms, WalkRules, WalkUniforms, walk_uniforms,
};
use fathom_stages::transfer::sight;
use fathom_stages::uniforms::{Shared, View};
use fathom_stages::{ldi, refraction, scene};

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ExitMethod {
    /// Through layers of depth. SPT §4.
    Trace,
    /// Through the nearest and the farthest surface. Wyman 2005.
    TwoInterface,
}

choices!(ExitMethod);

settings! {
    pub struct Params from file: SceneFile {
        // SPT §5: 800 × 600.
        view: settings::Viewport = settings::Viewport { width: 800, height: 600 };
        camera: Camera = file.camera.clone();
        light: Light = file.light.clone();
        ldi: LayeredDepth = LayeredDepth { layers: 2 };
        refraction: GlassSettings = GlassSettings::default();
        compose: Composition = Composition::default();
    }
}

settings! {
    /// How lines of sight pass through glass. SPT §4.
    pub struct GlassSettings {
        /// What finds where they leave it.
        method: ExitMethod = ExitMethod::Trace;
        /// What a ray inside is held against. `depth` is the paper's.
        surface: GlassSurface = GlassSurface::Plane;
        /// Surfaces that refract a ray; each needs a layer. SPT Table 1: 2.
        count: u32 = 2 => 1 ..= 16, "1";
        /// Fewest steps of a ray. SPT §2.1 enforces a minimum and does not give it.
        least_px: u32 = 8 => 1 ..= 4096, "px";
    }
}

impl GlassSettings {
    fn uses_lines(&self) -> bool {
        self.method == ExitMethod::Trace && self.surface != GlassSurface::Plane
    }
}

/// At most about this many pixels are compared with the reference.
const MAX_PIXELS: usize = 20_000;

impl Parameters for Params {
    fn check_consistent(&self) -> Result<(), ParamError> {
        let (count, layers) = (self.refraction.count, self.ldi.layers);
        if self.refraction.method == ExitMethod::Trace && count > layers {
            return Err(ParamError::Unfit(format!(
                "refraction.count = {count} needs as many layers: ldi.layers is {layers}"
            )));
        }
        let tiles = self.view.width.saturating_mul(self.view.height).div_ceil(ROWS);
        if self.refraction.uses_lines() && u64::from(tiles) > MAX_TILES {
            let max = MAX_TILES * u64::from(ROWS);
            return Err(ParamError::Unfit(format!("{VIEWPORT}: at most {max} pixels have lines")));
        }
        if self.refraction.uses_lines() && count != 2 {
            return Err(ParamError::Unfit(format!(
                "refraction.count = {count}: refraction.surface depth and all_depths refract twice"
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
    /// Half of the lines are at most so long, pixels; none where none is drawn.
    line_median_px: Option<f64>,
    image: wgpu::Texture,
}

impl Pipeline for ScreenRefraction {
    const NAME: &'static str = "refraction";
    const ABOUT: &'static str =
        "refraction through glass in screen space (SPT §4), and by Wyman's two interfaces";
    type Params = Params;

    fn new(resources: &Resources<'_>, scene: &Scene, params: &Params) -> Result<Self, GpuError> {
        if !scene.objects.iter().any(|object| Objects::Glass.holds(&object.material)) {
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
        let of_view = &resources.with_size_hint(VIEWPORT);
        let gbuffer = of_view.push(scene::gbuffer::new(of_view, shared, geometry, size_px)?);
        let (exits, line_median_px) = match params.refraction.method {
            ExitMethod::Trace => traced(resources, &view, shared, scene, geometry, params)?,
            ExitMethod::TwoInterface => {
                let thickness_m = thickness(resources, scene);
                let stage = two_interface::new(of_view, shared, geometry, size_px, &thickness_m)?;
                (of_view.push(stage), None)
            }
        };
        let exposure = params.compose.exposure;
        let opaque = opaque_bounds(scene);
        let compose =
            refraction::compose::new(of_view, shared, &gbuffer, &exits, opaque, exposure)?;
        let image = of_view.push(compose);
        Ok(Self { params: params.clone(), view, exits, line_median_px, image })
    }
}

impl PipelineInstance for ScreenRefraction {
    fn image(&self) -> &wgpu::Texture {
        &self.image
    }

    /// Share of the pixels that show glass, and of these whose ray is totally reflected at the last surface; how long lines are.
    fn quantities(&self, gpu: &Gpu) -> Result<BTreeMap<String, f64>, GpuError> {
        let found = self.read_exits(gpu)?;
        let glass = found.iter().flatten().count();
        let inside = found.iter().flatten().filter(|exit| exit.inside).count();
        let rates = [
            ("glass_rate", share(glass, found.len())),
            ("totally_reflected_rate", share(inside, glass)),
        ];
        let line = self.line_median_px.map(|px| ("line_median_px", px));
        Ok(to_map(rates.into_iter().chain(line)))
    }

    fn judge(&self, gpu: &Gpu) -> Result<Judging, GpuError> {
        let found = self.read_exits(gpu)?;
        let (settings, layers) = (self.params.refraction.clone(), self.params.ldi.layers as usize);
        let size_px = self.view.size_px.to_array();
        Ok(Box::new(move |judge| Ok(judged(&found, judge.scene, size_px, &settings, layers))))
    }
}

/// Of the rays that pixels' lines of sight leave the glass by.
fn judged(
    found: &[Option<Exit>],
    scene: &Scene,
    size_px: [u32; 2],
    settings: &GlassSettings,
    layers: usize,
) -> Errors {
    let GlassSettings { method, surface, count, .. } = *settings;
    let (mut angles_deg, surfaces) = angles_deg(found, scene, size_px, count);
    let stage = match method {
        ExitMethod::Trace => &trace::INFO,
        ExitMethod::TwoInterface => &two_interface::INFO,
    };
    let errors = [
        ("refraction_error_median_deg", quantile(&mut angles_deg, 0.5), "°"),
        ("refraction_error_p90_deg", quantile(&mut angles_deg, 0.9), "°"),
    ];
    // The paper's method takes two layers whatever is set.
    if method == ExitMethod::TwoInterface || surface == GlassSurface::Depth {
        return Errors::new(stage.name, errors, []);
    }
    let over = surfaces.iter().filter(|count| **count > layers).count();
    let rate = ("layers_overflow_rate", share(over, surfaces.len()));
    let mut judged = Errors::new(stage.name, errors, [rate]);
    if let Some(max) = surfaces.iter().max().filter(|max| **max > layers) {
        let of = surfaces.len();
        let text = format!(
            "{over} of {of} pixels of glass have more surfaces than ldi.layers = {layers}: set it to {max}"
        );
        judged.notes.push(Note::new(NoteKind::LayersFull, text));
    }
    judged
}

/// The box of what is seen through glass; none where there is nothing.
fn opaque_bounds(scene: &Scene) -> Option<Bounds> {
    let opaque = scene.objects.iter().filter(|object| Objects::Opaque.holds(&object.material));
    opaque.map(|object| object.mesh.bounds()).reduce(Bounds::union)
}

/// Pushes the stages that trace lines of sight through layers.
fn traced(
    resources: &Resources<'_>,
    view: &View,
    shared: &Shared,
    scene: &Scene,
    geometry: &Geometry,
    params: &Params,
) -> Result<(Exits, Option<f64>), GpuError> {
    let of_layers = &resources.with_size_hint("view × ldi.layers");
    let (of, size_px, layers) = (Objects::Glass, view.size_px.to_array(), params.ldi.layers);
    let peel = ldi::peel::new(of_layers, shared, scene, geometry, of, size_px, layers)?;
    let layers = of_layers.push(peel);
    let of_view = &resources.with_size_hint(VIEWPORT);
    let GlassSettings { count, surface, least_px, .. } = params.refraction;
    let bounds = scene.solid_bounds();
    if params.refraction.uses_lines() {
        return trace_by_lines(of_view, (view, scene), shared, &layers, bounds, surface, least_px);
    }
    let walk: WalkUniforms = walk_uniforms(&layers, bounds, least_px);
    Ok((of_view.push(trace::new(of_view, shared, &layers, &walk, count, None)?), None))
}

/// Pushes the stages that trace lines of sight through glass as lines of pixels, refracted twice: SPT §4. They are held against the first
/// two layers, or against all. With the exits the median length of a line, pixels.
fn trace_by_lines(
    of_view: &Resources<'_>,
    (view, scene): (&View, &Scene),
    shared: &Shared,
    layers: &Layers,
    bounds: Bounds,
    surface: GlassSurface,
    least_px: u32,
) -> Result<(Exits, Option<f64>), GpuError> {
    let size_px = view.size_px.as_vec2();
    let (first, end) = shown_px(view, bounds);
    let sight = SightUniforms { size_px, first, count: end - first };
    let (transfers, pairs) = of_view.push(sight::new(of_view, shared, layers, &sight)?);
    let walk = walk_uniforms(layers, bounds, least_px);
    let mut lines_px = lines_px(view, scene, &sight, &walk);
    let longest_px = lines_px.iter().copied().fold(1.0, f64::max);
    let walking = WalkRules {
        test: HitTest::Crossing,
        in_glass: Some(surface),
        tolerance_m: 0.0,
        start_m: 0.0,
        min_steps: least_px,
        rows: ROWS.min(of_view.gpu.limits.max_texture_dimension_2d),
        path_segments: 1,
        max_hits: 1,
        longest_px: Some((EDGE_PX + ROOM * longest_px).ceil() as u32),
    };
    let held = if surface == GlassSurface::AllDepths { layers } else { &pairs };
    let traced = RayInputs { transfers: &transfers, layers: held, bounds, walking };
    let ends = screen_tracing::trace(of_view, shared, &traced, screen_tracing::WalkMethod::Lines)?;
    let lines = Some(trace::SightLines { sight: &sight, ends: &ends });
    let exits = of_view.push(trace::new(of_view, shared, layers, &walk, 2, lines)?);
    Ok((exits, Some(quantile(&mut lines_px, 0.5))))
}

/// Rows are longer by this factor than the longest line of an exact ray: at silhouettes the rasterizer covers pixels that no ray meets.
const ROOM: f64 = 1.05;
/// The same in pixels: of a scene's box in f32.
const EDGE_PX: f64 = 1.0;

/// Length of the line of each pixel that shows glass, along the longer of its axes: from where the exact line of sight enters the glass to
/// where it leaves the scene's box. At most as long as the picture, at whose sides lines are cut.
fn lines_px(view: &View, scene: &Scene, sight: &SightUniforms, walk: &WalkUniforms) -> Vec<f64> {
    let [width, height] = view.size_px.to_array();
    let rays = PixelRays::new(&view.camera, width, height);
    let objects = objects_of(scene, Objects::Glass);
    let tracer = Tracer::new(&objects);
    let surfaces =
        Surfaces { tracer: &tracer, objects: &objects, outside: 1.0, top_m: f64::INFINITY };
    let (low_m, high_m) = (walk.low_m.as_dvec3(), walk.high_m.as_dvec3());
    let line_px = |number: u32| {
        let pixel = sight.first + UVec2::new(number % sight.count.x, number / sight.count.x);
        let (origin, direction, _) = rays.ray(pixel.x, pixel.y);
        let ray = surfaces.ray_behind(surfaces.sight(origin, direction), 1)?;
        let bound = DVec3::select(ray.direction.cmpgt(DVec3::ZERO), high_m, low_m);
        let end_m = ((bound - ray.origin) / ray.direction).min_element();
        let [from, to] = [0.0, end_m].map(|at_m| rays.project(ray.origin + at_m * ray.direction));
        let along = |from: Projected, to: Projected| {
            (from.x_px - to.x_px).abs().max((from.y_px - to.y_px).abs())
        };
        let longest_px = f64::from(width.max(height));
        Some(from.zip(to).map_or(longest_px, |(from, to)| along(from, to).min(longest_px)))
    };
    (0..sight.count.element_product()).into_par_iter().filter_map(line_px).collect()
}

/// The rectangle of pixels that holds what lies in a box: its first, and the one behind its last.
fn shown_px(view: &View, bounds: Bounds) -> (UVec2, UVec2) {
    let matrix = view.camera.view_projection(view.aspect());
    let size = view.size_px.as_dvec2();
    let corners: Vec<DVec4> = bounds.corners().map(|p| matrix * p.extend(1.0)).to_vec();
    if corners.iter().any(|clip| clip.w <= view.camera.z_near_m) {
        return (UVec2::ZERO, view.size_px);
    }
    let place = |clip: &DVec4| (clip.xy() / clip.w * DVec2::new(0.5, -0.5) + 0.5) * size;
    let places = || corners.iter().map(place);
    let low = places().fold(size, DVec2::min).floor() - 1.0;
    let high = places().fold(DVec2::ZERO, DVec2::max).ceil() + 1.0;
    let first = low.clamp(DVec2::ZERO, size - 1.0).as_uvec2();
    (first, high.clamp(DVec2::ZERO, size).as_uvec2().max(first + 1))
}

/// Way through the glass from each vertex against its normal, up to the nearest surface; 0 where there is none. Wyman's d_N, stored once.
fn thickness(resources: &Resources<'_>, scene: &Scene) -> Buffer {
    let count: usize = scene.objects.iter().map(|object| object.mesh.positions.len()).sum();
    let off_m = OFF_M * scene.solid_bounds().tank_scale();
    let ways = || -> Vec<f32> {
        let tracer = Tracer::new(&objects_of(scene, Objects::Glass));
        let way = |(p, n): (&[f32; 3], &[f32; 3])| {
            let [place, normal] = [p, n].map(|v| DVec3::from(v.map(f64::from)));
            let inwards = -normal.normalize_or_zero();
            tracer.cast(place, inwards, off_m, f64::MAX).map_or(0.0, |hit| hit.distance_m as f32)
        };
        let of = |object: &Object| -> Vec<f32> {
            let mesh = &object.mesh;
            if !Objects::Glass.holds(&object.material) {
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
    fn read_exits(&self, gpu: &Gpu) -> Result<Vec<Option<Exit>>, GpuError> {
        let positions = read_texture(gpu, &self.exits.positions)?;
        let directions = read_texture(gpu, &self.exits.directions)?;
        let exit = |(place, along): (&[f32], &[f32])| {
            let direction = DVec3::new(along[0].into(), along[1].into(), along[2].into());
            (place[3] > 0.0).then_some(Exit { direction, inside: along[3] > 0.0 })
        };
        Ok(positions.data.chunks_exact(4).zip(directions.data.chunks_exact(4)).map(exit).collect())
    }
}

/// Of an even selection of the pixels that show glass: angles between rays and exact ones, and how many surfaces of glass lie behind each.
fn angles_deg(
    found: &[Option<Exit>],
    scene: &Scene,
    [width, height]: [u32; 2],
    count: u32,
) -> (Vec<f64>, Vec<usize>) {
    let objects = objects_of(scene, Objects::Glass);
    let (tracer, off_m) = (Tracer::new(&objects), OFF_M * scene.solid_bounds().tank_scale());
    let surfaces =
        Surfaces { tracer: &tracer, objects: &objects, outside: 1.0, top_m: f64::INFINITY };
    let rays = PixelRays::new(&scene.camera, width, height);
    let shown = found.iter().flatten().count();
    let step = even_step(shown, MAX_PIXELS);
    let seen = (0..).zip(found).filter_map(|(pixel, exit)| Some((pixel, exit.as_ref()?)));
    let seen: Vec<(u32, &Exit)> = seen.step_by(step).collect();
    let angle = |(pixel, exit): &(u32, &Exit)| {
        let (origin, direction, _) = rays.ray(pixel % width, pixel / width);
        let next = |from_m| tracer.cast(origin, direction, from_m, f64::MAX);
        let hits = successors(next(0.0), |hit| next(hit.distance_m + off_m));
        let exact = surfaces.ray_behind(surfaces.sight(origin, direction), count)?;
        let angle_deg = exit.direction.angle_between(exact.direction).to_degrees();
        Some((angle_deg, hits.count()))
    };
    seen.par_iter().filter_map(angle).unzip()
}
