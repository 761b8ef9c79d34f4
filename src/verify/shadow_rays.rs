//! `transfer/shadow` and `shadow/compose`: which pixels' rays start, and the picture that rays make.

use crate::prelude::*;
use fathom_pipelines::shadow_rays::{direction_to_light, light_m};
use fathom_stages::photon::OUTSIDE;
use fathom_stages::shadow::compose;
use fathom_stages::transfer::shadow;

const SIZE: [u32; 2] = [240, 180];

pub fn cases() -> Vec<Case> {
    let kinds = [LightKind::Directional, LightKind::Point];
    let what = |kind| format!("{kind:?} light");
    let starts = Case::each(shadow::INFO.name, kinds, what, starts);
    starts.chain(Case::each(compose::INFO.name, kinds, what, composed)).collect()
}

/// Scene ball seen by a turned camera, under a light at a slant.
struct ShadowScene {
    fixture: Fixture,
    /// What each pixel shows exactly, row by row.
    hits: Vec<Option<Hit>>,
    /// The way of a directional light.
    sun: DVec3,
}

impl ShadowScene {
    fn new(rig: &Rig<'_>, kind: LightKind) -> Result<ShadowScene> {
        let mut scene = Scene::load("ball")?;
        scene.objects[0].material.receiver = true;
        // They shade the floor as if it faced away from the light; its triangles face it.
        scene.objects[0].mesh.normals.fill([-0.8, 0.6, 0.0]);
        scene.camera.up = [0.2, 1.0, 0.1];
        scene.light.kind = kind;
        scene.light.position_m = [2.5, 1.0, 1.5];
        let fixture = rig.fixture(scene, SIZE)?;
        let hits = pixels(SIZE).map(|at| fixture.hit(at)).collect();
        let sun = fixture.view.light_frame().forward;
        Ok(ShadowScene { fixture, hits, sun })
    }

    fn to_light(&self, place: DVec3) -> DVec3 {
        direction_to_light(&self.fixture.view, self.sun, place)
    }

    fn light_m(&self, place: DVec3) -> f64 {
        light_m(&self.fixture.view, place)
    }
}

/// Rays start where pixels show what faces the light, of all objects or of receivers alone.
fn starts(rig: &Rig<'_>, kind: LightKind) -> Checks {
    let seen = ShadowScene::new(rig, kind)?;
    let opaque = (&seen.fixture.geometry, Objects::Opaque);
    let peel = peel::new(rig, &seen.fixture.shared, &seen.fixture.scene, opaque, SIZE, 1)?;
    rig.run(&[&peel])?;
    let started = |receivers: bool| -> Result<Vec<bool>> {
        let stage = shadow::new(rig, &seen.fixture.shared, &peel, receivers)?;
        rig.run(&[&stage])?;
        let rays: Vec<Transfer> = rig.read(&stage.buffer)?;
        Ok(rays.iter().map(|ray| ray.state != NEVER).collect())
    };
    let (all, receivers) = (started(false)?, started(true)?);
    let facing = |sign: f64| {
        share(seen.hits.iter().zip(&all).filter_map(|(hit, starts)| {
            let hit = hit.as_ref()?;
            // On the side of the vertices' normals.
            let outwards = hit.normal * hit.normal.dot(hit.shading_normal).signum();
            let cosine = sign * outwards.dot(seen.to_light(hit.position));
            // At the terminator either is right.
            (cosine.abs() > 0.02).then_some((cosine > 0.0) != *starts)
        }))
    };
    let unlike = |object: usize| {
        share(seen.hits.iter().zip(all.iter().zip(&receivers)).filter_map(|(hit, (all, own))| {
            let is_asked = hit.as_ref()?.object == object;
            Some(*own != (is_asked && *all))
        }))
    };
    Ok(vec![
        Check::new(rig, format!("{kind:?}: share of pixels that face the light wrongly"))
            .within((0.01, "1"), facing(1.0))
            .control("normals reversed", facing(-1.0)),
        Check::new(rig, format!("{kind:?}: share of pixels unlike those that show the receiver"))
            .within((0.01, "1"), unlike(0))
            .control("another object's", unlike(1)),
    ])
}

/// The picture of a floor whose rays end by turns.
fn composed(rig: &Rig<'_>, kind: LightKind) -> Result<Check> {
    const EXPOSURE: f64 = 0.4;
    const SKY_SHARE: f64 = 0.15;
    const GREEN: usize = 1;
    let seen = ShadowScene::new(rig, kind)?;
    // Every third pixel's ray ends half way to the light, every third behind a point light, every third nowhere.
    let photon = |(number, hit): (usize, &Option<Hit>)| {
        let place = hit.map_or(DVec3::ZERO, |hit| hit.position);
        let light_m = seen.light_m(place);
        let far_m = [0.5, 1.5, 0.0][number % 3] * if light_m.is_finite() { light_m } else { 4e3 };
        let end = rig::photon(place, place, far_m);
        if number % 3 == 2 { Photon { fate: OUTSIDE, ..end } } else { end }
    };
    let photons: Vec<Photon> = seen.hits.iter().enumerate().map(photon).collect();
    let (photons, gbuffer) = (rig.photons(&photons), rig.gbuffer(&seen.fixture)?);
    let stage = compose::new(rig, &seen.fixture.shared, &gbuffer, &photons, EXPOSURE)?;
    let shown = rig.draw(&[&stage], stage.texture(), GREEN)?;
    let albedo = rig.channel(&gbuffer.albedo, GREEN)?;
    let light = seen.fixture.view.irradiance();
    let in_shadow = |number: usize| match number % 3 {
        0 => true,
        1 => kind == LightKind::Directional,
        _ => false,
    };
    let error = |shift: usize| {
        percentile::<90>(seen.hits.iter().enumerate().filter_map(|(number, hit)| {
            let hit = hit.as_ref()?;
            let normal = hit.shading_normal;
            let cosine = normal.dot(seen.to_light(hit.position)).max(0.0);
            let sky = SKY_SHARE * (0.6 + 0.4 * normal.y);
            let sun = if in_shadow(number + shift) { 0.0 } else { cosine };
            let exact = albedo.data()[number] / PI * light * (sky + sun);
            Some((radiance_of(shown.data()[number], EXPOSURE) - exact).abs() / exact)
        }))
    };
    // Steps of an 8-bit display, and of the normals' 16-bit floats.
    Ok(Check::new(rig, format!("{kind:?}: 90th percentile of the radiance's relative error"))
        .within((0.07, "1"), error(0))
        .control("shadows moved by a pixel", error(1)))
}
