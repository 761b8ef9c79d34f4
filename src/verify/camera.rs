//! `scene/gbuffer`, `water/reflection` and `water/refraction` against rays from the camera.

use std::iter::successors;

use glam::DVec3;

use super::{Case, Check, Checks, Result, Rig, rig};
use fathom_gpu::StageInfo;
use fathom_reference::image::{Image, pixels};
use fathom_reference::quantities::quantile;
use fathom_reference::rays::{Hit, PixelRays, Tracer};
use fathom_scene::{Camera, Scene};
use fathom_stages::lit_scene;
use fathom_stages::water;

/// Scene with columns, curved objects and walls.
const SCENE: &str = "tank";
/// Scene with geometry on both sides of the water.
const SHORE: &str = "port";
const SIZE: [u32; 2] = [160, 120];
/// Vulkan lets a rasterizer move corners by 1/32 pixel. The view spans 1.3 of the distance over 120
/// pixels, so that is 3e-4 of the distance beside the ray, and some ten times that along it where
/// surfaces are seen at a slant.
const DEPTH_P99: f64 = 5e-3;
/// On coarse curved meshes the same shift turns normals by more than a degree, so that the largest
/// angles say nothing.
const NORMAL_P90_DEG: f64 = 0.5;
/// A step of 16-bit floats below 1: drivers may cut off what they cannot store. Silhouettes, where another object may be
/// seen, are the rest.
const SPECULAR_P97: f64 = 5e-4;
/// Geometry this far past the resting water is still drawn by reflection and refraction, metres.
const OVERLAP_M: f64 = 0.1;

pub fn cases() -> Vec<Case> {
    vec![
        Case::new("scene/gbuffer", "depth, normal and albedo", gbuffer),
        Case::new("water/reflection", "coverage from the mirrored camera", reflection),
        Case::new("water/refraction", "coverage beyond the water", refraction),
    ]
}

fn gbuffer(rig: &Rig<'_>) -> Checks {
    let mut scene = Scene::load(SCENE)?;
    let count = scene.objects.len() as f32;
    for (object, i) in scene.objects.iter_mut().zip(1u8..) {
        object.material.specular = f32::from(i) / count;
    }
    let textures = rig.gbuffer(&rig.stand(&scene, SIZE))?;
    let depth = rig.channel(&textures.depth, 0)?;
    let normals = rig.vectors(&textures.normal)?;
    let speculars = rig.channel(&textures.normal, 3)?;
    let colors = rig.vectors(&textures.albedo)?;

    let tracer = Tracer::new(&scene.objects)?;
    let seen = ExactHits::cast(&scene.camera, &tracer);
    let aside = Camera { fov_y_deg: scene.camera.fov_y_deg * 1.01, ..scene.camera.clone() };
    let aside = ExactHits::cast(&aside, &tracer);
    Ok(vec![
        Check::of("scene/gbuffer", "99th percentile of |depth − ray|, of the distance")
            .within((DEPTH_P99, "1"), seen.depth_p99(&depth))
            .control("field of view 1 % wider", aside.depth_p99(&depth))
            .with("coverage_disagreement", seen.coverage_disagreement(&depth)),
        Check::of("scene/gbuffer", "90th percentile of the normal's angle")
            .within((NORMAL_P90_DEG, "deg"), seen.normal_p90_deg(&normals, 0.0))
            .control("normals turned by 1 degree", seen.normal_p90_deg(&normals, 1.0)),
        Check::of("scene/gbuffer", "99th percentile of the albedo's error, plain materials")
            .within((2.0 / 255.0, "1"), seen.albedo_p99(&scene, &colors, 1.0))
            .control("albedo 5 % higher", seen.albedo_p99(&scene, &colors, 1.05)),
        Check::of("scene/gbuffer", "97th percentile of the specular coefficient's error")
            .within((SPECULAR_P97, "1"), seen.specular_p97(&scene, &speculars, 1.0))
            .control("coefficients 1 % higher", seen.specular_p97(&scene, &speculars, 1.01)),
    ])
}

/// Exact hits of a camera's pixels.
struct ExactHits {
    rays: PixelRays,
    hits: Vec<Option<Hit>>,
}

impl ExactHits {
    fn cast(camera: &Camera, tracer: &Tracer) -> ExactHits {
        let rays = PixelRays::new(camera, SIZE[0], SIZE[1]);
        let pixels = pixels(SIZE);
        let hits = pixels.map(|(x, y)| rays.cast(tracer, x, y).map(|(hit, _)| hit));
        ExactHits { hits: hits.collect(), rays }
    }

    /// Index in rows and hit of every covered pixel.
    fn covered(&self) -> impl Iterator<Item = (usize, &Hit)> {
        let numbered = self.hits.iter().enumerate();
        numbered.filter_map(|(i, hit)| hit.as_ref().map(|hit| (i, hit)))
    }

    fn depth_p99(&self, depth: &Image) -> f64 {
        let mut errors: Vec<f64> = self
            .covered()
            .filter(|(i, _)| depth.data()[*i] < 1.0)
            .map(|(i, hit)| {
                let (x, y) = (i as u32 % SIZE[0], i as u32 / SIZE[0]);
                let (x_px, y_px) = (f64::from(x) + 0.5, f64::from(y) + 0.5);
                let position = self.rays.unproject(x_px, y_px, depth.data()[i]);
                (position - hit.position).length() / hit.distance_m
            })
            .collect();
        quantile(&mut errors, 0.99)
    }

    fn coverage_disagreement(&self, depth: &Image) -> f64 {
        let pairs = self.hits.iter().zip(depth.data());
        let unlike = pairs.filter(|(hit, depth)| hit.is_some() != (**depth < 1.0));
        unlike.count() as f64 / self.hits.len() as f64
    }

    /// `turned_deg` turns the exact normals about the view's x axis.
    fn normal_p90_deg(&self, normals: &[DVec3], turned_deg: f64) -> f64 {
        let turn = glam::DQuat::from_rotation_x(turned_deg.to_radians());
        let mut angles: Vec<f64> = self
            .covered()
            .filter(|(i, hit)| normals[*i].length() > 0.5 && hit.shading_normal.length() > 0.5)
            .map(|(i, hit)| normals[i].angle_between(turn * hit.shading_normal).to_degrees())
            .collect();
        quantile(&mut angles, 0.90)
    }

    fn specular_p97(&self, scene: &Scene, speculars: &Image, factor: f64) -> f64 {
        let expected = |hit: &Hit| factor * f64::from(scene.objects[hit.object].material.specular);
        let pairs = self.covered();
        let mut errors: Vec<f64> =
            pairs.map(|(i, hit)| (speculars.data()[i] - expected(hit)).abs()).collect();
        quantile(&mut errors, 0.97)
    }

    fn albedo_p99(&self, scene: &Scene, colors: &[DVec3], factor: f64) -> f64 {
        let mut errors: Vec<f64> = self
            .covered()
            .filter(|(_, hit)| scene.objects[hit.object].material.tile_m <= 0.0)
            .map(|(i, hit)| {
                let albedo = scene.objects[hit.object].material.albedo.map(f64::from);
                (colors[i] - DVec3::from(albedo) * factor).abs().max_element()
            })
            .collect();
        quantile(&mut errors, 0.99)
    }
}

fn reflection(rig: &Rig<'_>) -> Result<Check> {
    let scene = above_water()?;
    let covered = covered(rig, &scene, &water::reflection::INFO)?;
    let tracer = Tracer::new(&scene.objects)?;
    let rays = PixelRays::new(&scene.camera, SIZE[0], SIZE[1]);
    // The picture of the world mirrored about `level`, kept on the camera's own side.
    let unlike = |level: f64| {
        let ray = |x, y| {
            let (origin, direction, length) = rays.ray(x, y);
            let mirror = |v: DVec3, level: f64| DVec3::new(v.x, 2.0 * level - v.y, v.z);
            (mirror(origin, level), mirror(direction, 0.0), length)
        };
        coverage_disagreement(&covered, &tracer, ray, |y| y >= -OVERLAP_M)
    };
    Ok(Check::of("water/reflection", "share of pixels unlike exact rays")
        .within((0.01, "1"), unlike(0.0))
        .control("mirror raised by 0.3 m", unlike(0.3))
        .with("covered_share", covered.mean()))
}

fn refraction(rig: &Rig<'_>) -> Result<Check> {
    let scene = above_water()?;
    let covered = covered(rig, &scene, &water::refraction::INFO)?;
    let tracer = Tracer::new(&scene.objects)?;
    let rays = PixelRays::new(&scene.camera, SIZE[0], SIZE[1]);
    let unlike = |level: f64| {
        coverage_disagreement(&covered, &tracer, |x, y| rays.ray(x, y), |y| y <= level + OVERLAP_M)
    };
    Ok(Check::of("water/refraction", "share of pixels unlike exact rays")
        .within((0.01, "1"), unlike(0.0))
        .control("water lowered by 1 m", unlike(-1.0))
        .with("covered_share", covered.mean()))
}

/// The shore seen from above the water.
fn above_water() -> Result<Scene> {
    let mut scene = Scene::load(SHORE)?;
    let height = scene.camera.position_m[1].abs().max(1.5);
    scene.camera.position_m[1] = height;
    scene.camera.target_m[1] = 0.0;
    Ok(scene)
}

/// 1 where a stage draws the scene.
fn covered(rig: &Rig<'_>, scene: &Scene, info: &'static StageInfo) -> Result<Image> {
    let rig::Stand { shared, geometry, .. } = rig.stand(scene, SIZE);
    let stage = lit_scene::new(&rig.resources, info, &shared, &geometry, SIZE)?;
    rig.run(&[&stage])?;
    rig.channel(stage.texture(), 3)
}

/// Share of pixels whose coverage differs from that of exact rays which pass through geometry at
/// heights that are not `kept`.
fn coverage_disagreement(
    covered: &Image,
    tracer: &Tracer,
    ray: impl Fn(u32, u32) -> (DVec3, DVec3, f64),
    kept: impl Fn(f64) -> bool,
) -> f64 {
    let mut unlike = 0u32;
    for (x, y) in pixels(covered.size()) {
        let (origin, direction, length) = ray(x, y);
        let next = |from: f64| tracer.cast(origin, direction, from, length);
        let mut hits = successors(next(0.0), |hit| next(hit.distance_m * (1.0 + 1e-12)));
        let seen = hits.any(|hit| kept(hit.position.y));
        unlike += u32::from(seen != (covered.clamped(x.into(), y.into()) > 0.5));
    }
    f64::from(unlike) / covered.data().len() as f64
}
