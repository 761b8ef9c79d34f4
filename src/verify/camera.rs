//! `scene/gbuffer`, `water/reflection` and `water/refraction` against rays from the camera.

use std::iter::successors;

use crate::prelude::*;
use fathom_reference::picture::PictureLight;
use fathom_stages::lit_scene;

/// Scene with columns, curved objects and walls.
const SCENE: &str = "tank";
const SIZE: [u32; 2] = [160, 120];
const SHORE_SIZE: [u32; 2] = [96, 72];
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
        Case::new("water/reflection", "from the mirrored camera, pixel by pixel", |rig| {
            lit_shore(rig, &lit_scene::REFLECTION, true)
        }),
        Case::new("water/refraction", "beyond the water, pixel by pixel", |rig| {
            lit_shore(rig, &lit_scene::REFRACTION, false)
        }),
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

/// The shore lit without photons, from above the water and from below it: colour and coverage.
fn lit_shore(rig: &Rig<'_>, info: &'static StageInfo, is_mirrored: bool) -> Checks {
    let views = [(LightKind::Directional, 1.5, "above"), (LightKind::Point, -1.2, "below")];
    let check = |(kind, height_m, side): (LightKind, f64, &str)| {
        let fixture = rig.fixture(rig::shore(kind, height_m)?, SHORE_SIZE)?;
        let stage = lit_scene::new(rig, info, &fixture.shared, &fixture.geometry, SHORE_SIZE)?;
        rig.run(&[&stage])?;
        let shown = Texels::read(rig, stage.texture())?;
        let Scene { camera, light, water, .. } = &fixture.scene;
        let light = PictureLight::new(camera, light, water);
        let shore = Shore { fixture: &fixture, light, is_mirrored };
        let unlike = |overlap: f64| {
            share(pixels(SHORE_SIZE).map(|at| {
                let allowed = SHIFTS_PX.map(|shift_px| shore.seen(at, shift_px, overlap));
                let greatest = allowed.into_iter().fold(DVec4::ZERO, DVec4::max);
                let outside = excess(shown.get(at), &allowed);
                !outside.cmple(rig::SHORT_STEP * greatest).all()
            }))
        };
        let covered = share(pixels(SHORE_SIZE).map(|at| shown.get(at).w > 0.5));
        Ok(Check::new(rig, format!("from {side}: share of pixels unlike exact rays around them"))
            .within((EDGES, "1"), unlike(OVERLAP))
            .control("cut half as far again past the water", unlike(1.5 * OVERLAP))
            .with("covered_share", covered))
    };
    views.into_iter().map(check).collect()
}

/// What lines of sight meet at the shore.
struct Shore<'a> {
    fixture: &'a Fixture,
    light: PictureLight,
    /// The camera sees what is on its own side of the water, mirrored about y = 0, and not what is beyond.
    is_mirrored: bool,
}

impl Shore<'_> {
    /// Radiance and coverage beside a pixel's middle.
    fn seen(&self, (x, y): (u32, u32), shift_px: DVec2, overlap: f64) -> DVec4 {
        let px = DVec2::new(x.into(), y.into()) + 0.5 + shift_px;
        let (origin, direction, length) = self.fixture.rays.ray_at(px.x, px.y);
        let mirror = DVec3::new(1.0, if self.is_mirrored { -1.0 } else { 1.0 }, 1.0);
        let tracer = &self.fixture.tracer;
        let next = |from: f64| tracer.cast(origin * mirror, direction * mirror, from, length);
        let mut hits = successors(next(0.0), |hit| next(hit.distance_m * (1.0 + 1e-12)));
        let side = if self.is_mirrored == self.light.is_under_water() { -1.0 } else { 1.0 };
        let reach_m = overlap * self.fixture.scene.water.half_size_m[0];
        let hit = hits.find(|hit| side * hit.position.y >= -reach_m);
        hit.map_or(DVec4::ZERO, |hit| self.radiance(&hit, mirror).extend(1.0))
    }

    fn radiance(&self, hit: &Hit, mirror: DVec3) -> DVec3 {
        let Self { light, fixture, .. } = self;
        let (place, normal) = (hit.position, hit.shading_normal);
        let albedo = DVec3::from(fixture.scene.objects[hit.object].material.albedo.map(f64::from));
        let lit = albedo / PI * (light.ambient(place, normal) + light.direct(place, normal));
        let path_m = match (self.is_mirrored, light.is_under_water()) {
            // All of the way to the mirror and from there is in water, or none of it.
            (true, true) => light.camera_m.distance(place * mirror),
            (true, false) => 0.0,
            (false, _) => light.wet_m(place),
        };
        light.fogged(lit, path_m)
    }
}
