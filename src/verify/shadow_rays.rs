//! `transfer/shadow` and `shadow/compose`: which pixels' rays start, and the picture that rays make.

use crate::prelude::*;
use fathom_stages::photon::{MISSED, OUTSIDE};
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
        Ok(ShadowScene { fixture, hits })
    }
}

/// Rays start where pixels show what faces the light, of all objects or of receivers alone.
fn starts(rig: &Rig<'_>, kind: LightKind) -> Checks {
    let seen = ShadowScene::new(rig, kind)?;
    let Fixture { shared, scene, geometry, .. } = &seen.fixture;
    let peel = peel::new(rig, shared, scene, geometry, Objects::Opaque, SIZE, 1)?;
    rig.run(&[&peel])?;
    let started = |receivers: bool| -> Result<Vec<bool>> {
        let stage = shadow::new(rig, &seen.fixture.shared, &peel, receivers)?;
        rig.run(&[&stage])?;
        let rays: Vec<Transfer> = rig.read(&stage.buffer)?;
        Ok(rays.iter().map(|ray| ray.state != NEVER).collect())
    };
    let (all, receivers) = (started(false)?, started(true)?);
    let light = seen.fixture.light();
    let facing = |sign: f64| {
        share(seen.hits.iter().zip(&all).filter_map(|(hit, starts)| {
            let hit = hit.as_ref()?;
            // On the side of the vertices' normals.
            let outwards = hit.normal * hit.normal.dot(hit.shading_normal).signum();
            let cosine = sign * outwards.dot(light.to_light(hit.position));
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

/// The picture of surfaces of noise whose rays end by turns.
fn composed(rig: &Rig<'_>, kind: LightKind) -> Result<Check> {
    const EXPOSURE: f64 = 0.25;
    let seen = ShadowScene::new(rig, kind)?;
    let known = NoisySurfaces::new(rig, &seen.fixture, |_| DVec3::ZERO)?;
    // In turns the pixels' rays end half way to the light, behind it, nowhere, and on the place's own triangle. Behind a directional light, which
    // stands nowhere, they are in shadow too.
    let case = |(x, y): (u32, u32)| (x + SIZE[0] * y) % 4;
    let photon = |at: (u32, u32)| {
        let place = known.seen(at).map_or(DVec3::ZERO, |seen| seen.position);
        let light_m = known.light.lamp_m.map_or(4e3, |lamp| lamp.distance(place));
        let end = rig::photon(place, place, [0.5, 1.5, 0.0, 0.0][case(at) as usize] * light_m);
        match case(at) {
            2 => Photon { fate: OUTSIDE, ..end },
            3 => Photon { fate: MISSED, ..end },
            _ => end,
        }
    };
    let photons = rig.photons(&pixels(SIZE).map(photon).collect::<Vec<_>>());
    let stage = compose::new(rig, &seen.fixture.shared, &known.gbuffer, &photons, EXPOSURE)?;
    let shown = Texels::draw(rig, &stage)?;
    let light = &known.light;
    let error = |sky: f64| {
        largest_excess(&shown, |at| {
            let radiance = known.seen(at).map_or(light.sky(known.sight(at)), |place| {
                let is_lit = case(at) == 2 || case(at) == 1 && kind == LightKind::Point;
                let cosine = place.normal.dot(light.to_light(place.position)).max(0.0);
                let sun = if is_lit { light.irradiance * cosine } else { 0.0 };
                place.lit(DVec3::splat(sun + sky * light.dry_ambient(place.normal)))
            });
            vec![displayed(radiance, EXPOSURE)]
        })
    };
    Ok(Check::new(rig, format!("{kind:?}: largest error of the picture"))
        .within((DISPLAY_STEP, "1"), error(1.0))
        .control("2 % more of the sky", error(1.02)))
}
