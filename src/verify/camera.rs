//! `scene/gbuffer`, `water/reflection` and `water/refraction` against rays from the camera.

use std::iter::successors;

use crate::prelude::*;
use fathom_reference::picture::PictureLight;
use fathom_stages::{lit_scene, water};

const SIZE: [u32; 2] = [160, 120];
const SHORE_SIZE: [u32; 2] = [96, 72];
/// Geometry this far past the resting water is still drawn by reflection and refraction, as a share of half the water's side.
const OVERLAP: f64 = 0.02;

pub fn cases() -> Vec<Case> {
    vec![
        Case::new("scene/gbuffer", "depth, normal and albedo", gbuffer),
        Case::new("water/reflection", "from the mirrored camera, pixel by pixel", |rig| {
            lit_shore(rig, &water::reflection::INFO, true)
        }),
        Case::new("water/refraction", "beyond the water, pixel by pixel", |rig| {
            lit_shore(rig, &water::refraction::INFO, false)
        }),
    ]
}

/// Columns, curved objects and walls, each object with a specular coefficient of its own.
fn gbuffer(rig: &Rig<'_>) -> Checks {
    let mut scene = Scene::load("tank")?;
    let count = scene.objects.len() as f32;
    for (object, i) in scene.objects.iter_mut().zip(1u8..) {
        object.material.specular = f32::from(i) / count;
    }
    let fixture = rig.fixture(scene, SIZE)?;
    let textures = rig.gbuffer(&fixture)?;
    let depth = rig.channel(&textures.depth, 0)?;
    let [normal, albedo] = [&textures.normal, &textures.albedo].map(|of| Texels::read(rig, of));
    let (normal, albedo) = (normal?, albedo?);
    // Distance along the view, normal and specular coefficient, albedo; zeros where nothing is seen.
    let exact = |at: (u32, u32), shift_px: [f64; 2]| {
        let px = rig::middle(at) + DVec2::from(shift_px);
        let (origin, sight, length) = fixture.rays.ray_at(px.x, px.y);
        let hit = fixture.tracer.cast(origin, sight, 0.0, length)?;
        let material = &fixture.scene.objects[hit.object].material;
        let plain = DVec3::from(material.albedo.map(f64::from)).extend(1.0);
        Some([
            DVec4::splat(fixture.rays.project(hit.position)?.w),
            hit.shading_normal.extend(material.specular.into()),
            // Tiles vary.
            if material.tile_m > 0.0 { albedo.get(at) } else { plain },
        ])
    };
    let unlike = |part: usize, factor: f64| {
        share(pixels(SIZE).map(|at| {
            let z = depth.get(at);
            let view_m = if z < 1.0 { fixture.view.camera.view_depth_m(z) } else { 0.0 };
            let shown = [DVec4::splat(view_m), normal.get(at), albedo.get(at)][part];
            let rounding = [1e-5 * view_m, rig::SHORT_STEP, DISPLAY_STEP][part];
            let allowed = SHIFTS_PX.map(|shift_px| {
                exact(at, shift_px).map_or(DVec4::ZERO, |parts| factor * parts[part])
            });
            !excess(shown, &allowed).cmple(DVec4::splat(rounding)).all()
        }))
    };
    // The grooves of columns are slits.
    let check = |(part, what): (usize, &str)| {
        Check::new(rig, format!("{what}: share of pixels unlike exact rays around them"))
            .within((2.0 * EDGES, "1"), unlike(part, 1.0))
            .control("1 % more", unlike(part, 1.01))
    };
    let parts = ["depth", "normal and specular coefficient", "albedo of plain materials"];
    Ok(parts.into_iter().enumerate().map(check).collect())
}

/// The shore lit without photons, from above the water and from below it: colour and coverage.
fn lit_shore(rig: &Rig<'_>, info: &'static StageInfo, is_mirrored: bool) -> Checks {
    let views = [(LightKind::Directional, 1.5, "above"), (LightKind::Point, -1.2, "below")];
    let check = |(kind, height_m, side): (LightKind, f64, &str)| {
        let fixture = rig.fixture(rig::shore(kind, height_m)?, SHORE_SIZE)?;
        let stage = lit_scene::new(rig, info, &fixture.shared, &fixture.geometry, SHORE_SIZE)?;
        rig.run(&[&stage])?;
        let shown = Texels::read(rig, stage.texture())?;
        let shore = Shore { fixture: &fixture, light: fixture.light(), is_mirrored };
        let unlike = |overlap: f64| {
            share(pixels(SHORE_SIZE).map(|at| {
                let allowed = SHIFTS_PX.map(|shift_px| shore.seen(at, shift_px, overlap));
                let greatest = allowed.into_iter().fold(DVec4::ZERO, DVec4::max);
                let outside = excess(shown.get(at), &allowed);
                !outside.cmple(rig::SHORT_STEP * greatest).all()
            }))
        };
        Ok(Check::new(rig, format!("from {side}: share of pixels unlike exact rays around them"))
            .within((EDGES, "1"), unlike(OVERLAP))
            .control("cut half as far again past the water", unlike(1.5 * OVERLAP)))
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
    fn seen(&self, at: (u32, u32), shift_px: [f64; 2], overlap: f64) -> DVec4 {
        let px = rig::middle(at) + DVec2::from(shift_px);
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
