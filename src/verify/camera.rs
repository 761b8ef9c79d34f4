//! `scene/gbuffer`, `water/reflection` and `water/refraction` against rays from the camera.

use std::iter::successors;

use crate::prelude::*;
use fathom_stages::lit_scene;

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
/// Geometry this far past the resting water is still drawn by reflection and refraction, as a share of half the water's side.
const OVERLAP: f64 = 0.02;

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
    let fixture = rig.fixture(scene, SIZE)?;
    let textures = rig.gbuffer(&fixture)?;
    let depth = rig.channel(&textures.depth, 0)?;
    let normals = rig.vectors(&textures.normal)?;
    let speculars = rig.channel(&textures.normal, 3)?;
    let colors = rig.vectors(&textures.albedo)?;

    let exact_hits = |rays: &PixelRays| -> Vec<Option<Hit>> {
        pixels(SIZE).map(|(x, y)| Some(rays.cast(&fixture.tracer, x, y)?.0)).collect()
    };
    let wider =
        Camera { fov_y_deg: 1.01 * fixture.view.camera.fov_y_deg, ..fixture.view.camera.clone() };
    let aside = PixelRays::new(&wider, SIZE[0], SIZE[1]);
    let (hits, hits_aside) = (exact_hits(&fixture.rays), exact_hits(&aside));
    let depth_error = |rays: &PixelRays, hits: &[Option<Hit>]| {
        percentile::<99>(pixels(SIZE).zip(hits).filter_map(|((x, y), hit)| {
            let seen = Some(depth.get((x, y))).filter(|depth| *depth < 1.0)?;
            let position = rays.unproject(f64::from(x) + 0.5, f64::from(y) + 0.5, seen);
            hit.map(|hit| position.distance(hit.position) / hit.distance_m)
        }))
    };
    let coverage = hits.iter().zip(depth.data()).map(|(hit, z)| hit.is_some() != (*z < 1.0));
    // Index in rows and hit of every covered pixel.
    let covered = || hits.iter().enumerate().filter_map(|(i, hit)| Some((i, (*hit)?)));
    let material = |hit: &Hit| &fixture.scene.objects[hit.object].material;
    // The exact normals turned about the view's x axis.
    let normal_error = |turned_deg: f64| {
        let turn = DQuat::from_rotation_x(turned_deg.to_radians());
        percentile::<90>(
            covered()
                .filter(|(i, hit)| normals[*i].length() > 0.5 && hit.shading_normal.length() > 0.5)
                .map(|(i, hit)| normals[i].angle_between(turn * hit.shading_normal).to_degrees()),
        )
    };
    let specular_error = |factor: f64| {
        let expected = |hit: &Hit| factor * f64::from(material(hit).specular);
        percentile::<97>(covered().map(|(i, hit)| (speculars.data()[i] - expected(&hit)).abs()))
    };
    let albedo_error = |factor: f64| {
        let albedo = |hit: &Hit| factor * DVec3::from(material(hit).albedo.map(f64::from));
        percentile::<99>(
            covered()
                .filter(|(_, hit)| material(hit).tile_m <= 0.0)
                .map(|(i, hit)| (colors[i] - albedo(&hit)).abs().max_element()),
        )
    };
    Ok(vec![
        Check::new(rig, "99th percentile of |depth − ray|, of the distance")
            .within((DEPTH_P99, "1"), depth_error(&fixture.rays, &hits))
            .control("field of view 1 % wider", depth_error(&aside, &hits_aside))
            .with("coverage_disagreement", share(coverage)),
        Check::new(rig, "90th percentile of the normal's angle")
            .within((NORMAL_P90_DEG, "deg"), normal_error(0.0))
            .control("normals turned by 1 degree", normal_error(1.0)),
        Check::new(rig, "99th percentile of the albedo's error, plain materials")
            .within((2.0 / 255.0, "1"), albedo_error(1.0))
            .control("albedo 5 % higher", albedo_error(1.05)),
        Check::new(rig, "97th percentile of the specular coefficient's error")
            .within((SPECULAR_P97, "1"), specular_error(1.0))
            .control("coefficients 1 % higher", specular_error(1.01)),
    ])
}

fn reflection(rig: &Rig<'_>) -> Result<Check> {
    let shore = Shore::new(rig, &lit_scene::REFLECTION)?;
    // The picture of the world mirrored about `level`, kept on the camera's own side.
    let unlike = |level: f64| {
        let mirror = |v: DVec3, level: f64| DVec3::new(v.x, 2.0 * level - v.y, v.z);
        shore.unlike(
            |(origin, direction)| (mirror(origin, level), mirror(direction, 0.0)),
            |y| y >= -shore.overlap_m(),
        )
    };
    Ok(Check::new(rig, "share of pixels unlike exact rays")
        .within((0.01, "1"), unlike(0.0))
        .control("mirror raised by 0.3 m", unlike(0.3))
        .with("covered_share", shore.covered.mean()))
}

fn refraction(rig: &Rig<'_>) -> Result<Check> {
    let shore = Shore::new(rig, &lit_scene::REFRACTION)?;
    let unlike = |level: f64| shore.unlike(|ray| ray, |y| y <= level + shore.overlap_m());
    Ok(Check::new(rig, "share of pixels unlike exact rays")
        .within((0.01, "1"), unlike(0.0))
        .control("water lowered by 1 m", unlike(-1.0))
        .with("covered_share", shore.covered.mean()))
}

/// The shore seen from above the water.
struct Shore {
    fixture: Fixture,
    /// 1 where the stage draws the scene.
    covered: Image,
}

impl Shore {
    fn new(rig: &Rig<'_>, info: &'static StageInfo) -> Result<Self> {
        let mut scene = Scene::load(SHORE)?;
        scene.camera.position_m[1] = scene.camera.position_m[1].abs().max(1.5);
        scene.camera.target_m[1] = 0.0;
        let fixture = rig.fixture(scene, SIZE)?;
        let stage = lit_scene::new(rig, info, &fixture.shared, &fixture.geometry, SIZE)?;
        let covered = rig.draw(&[&stage], stage.texture(), 3)?;
        Ok(Self { fixture, covered })
    }

    fn overlap_m(&self) -> f64 {
        OVERLAP * self.fixture.scene.water.half_size_m[0]
    }

    /// Share of pixels whose coverage differs from that of exact rays, changed by a rule, which pass through geometry at heights that
    /// are not `kept`.
    fn unlike(
        &self,
        change: impl Fn((DVec3, DVec3)) -> (DVec3, DVec3),
        kept: impl Fn(f64) -> bool,
    ) -> f64 {
        share(pixels(SIZE).map(|(x, y)| {
            let (origin, direction, length) = self.fixture.rays.ray(x, y);
            let (origin, direction) = change((origin, direction));
            let next = |from: f64| self.fixture.tracer.cast(origin, direction, from, length);
            let mut hits = successors(next(0.0), |hit| next(hit.distance_m * (1.0 + 1e-12)));
            hits.any(|hit| kept(hit.position.y)) != (self.covered.get((x, y)) > 0.5)
        }))
    }
}
