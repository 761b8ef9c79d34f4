//! Rays from pixels to the light against exact ones, and the picture that they make.

use crate::prelude::*;
use fathom_pipelines::shadow_rays::{light_m, to_light};
use fathom_stages::photon::OUTSIDE;
use fathom_stages::rays::march;
use fathom_stages::shadow::compose;
use fathom_stages::transfer::shadow;

const SIZE: [u32; 2] = [240, 180];
const LAYERS: u32 = 8;
/// The pipeline's defaults: SPT §5's tolerance, and three times that.
const TOLERANCE_M: f64 = 0.01;
const START_M: f64 = 0.03;
/// A ray cast from a surface starts this far from it, metres.
const OFF_M: f64 = 1e-4;

pub fn cases() -> Vec<Case> {
    let mut cases = Vec::new();
    for kind in [LightKind::Directional, LightKind::Point] {
        let what = format!("{kind:?} light");
        cases.push(Case::new(shadow::INFO.name, what.clone(), move |rig| starts(rig, kind)));
        for (name, tolerance) in [("ball", 0.01), ("glass", 0.025)] {
            let what = format!("scene {name}, {what}");
            cases.push(Case::new(shadow::INFO.name, what, move |rig| {
                shadows(rig, (name, tolerance), kind)
            }));
        }
        cases.push(Case::new(compose::INFO.name, what, move |rig| composed(rig, kind)));
    }
    cases
}

/// A scene with a turned camera and a light at a slant.
struct Setup {
    stand: Stand,
    gbuffer: GbufferTextures,
    layers: Layers,
    starts: Stage<Transfers>,
    /// What each pixel shows exactly, row by row.
    hits: Vec<Option<Hit>>,
    /// The way of a directional light.
    sun: DVec3,
}

impl Setup {
    fn new(rig: &Rig<'_>, name: &str, kind: LightKind) -> Result<Setup> {
        let mut scene = Scene::load(name)?;
        scene.objects.retain(|object| object.material.is_opaque());
        scene.objects[0].material.receiver = true;
        scene.camera.up = [0.2, 1.0, 0.1];
        scene.light.kind = kind;
        scene.light.position_m = [2.5, 1.0, 1.5];
        let stand = rig.stand(scene, SIZE)?;
        let gbuffer = rig.gbuffer(&stand)?;
        let opaque = (&stand.geometry, Part::Opaque);
        let peel = peel::new(rig, &stand.shared, &stand.scene, opaque, SIZE, LAYERS)?;
        rig.run(&[&peel])?;
        let layers = peel.left;
        let starts = shadow::new(rig, &stand.shared, &layers, false)?;
        let hits = pixels(SIZE).map(|at| stand.hit(at)).collect();
        let sun = stand.view.light_frame().forward;
        Ok(Setup { stand, gbuffer, layers, starts, hits, sun })
    }

    fn to_light(&self, place: DVec3) -> DVec3 {
        to_light(&self.stand.view, self.sun, place)
    }

    fn light_m(&self, place: DVec3) -> f64 {
        light_m(&self.stand.view, place)
    }

    /// Rays as the stage has left them.
    fn stored(&self, rig: &Rig<'_>) -> Result<Vec<Transfer>> {
        Ok(rig.read(&self.starts.buffer)?)
    }
}

/// Starts and directions of rays.
fn starts(rig: &Rig<'_>, kind: LightKind) -> Checks {
    let setup = Setup::new(rig, "ball", kind)?;
    rig.run(&[&setup.starts])?;
    let stored = setup.stored(rig)?;
    let pairs = || stored.iter().zip(&setup.hits).filter_map(|(ray, hit)| Some((ray, (*hit)?)));
    let alive = || pairs().filter(|(ray, _)| ray.state != NEVER);
    let places = |moved: DVec3| {
        percentile::<95>(
            alive().map(|(ray, hit)| ray.position_m.as_dvec3().distance(hit.position + moved)),
        )
    };
    let directions = |turned: f64| {
        percentile::<95>(alive().map(|(ray, hit)| {
            let exact = (setup.to_light(hit.position) + turned * DVec3::X).normalize();
            ray.direction.as_dvec3().distance(exact)
        }))
    };
    let facing = |sign: f64| {
        share(pairs().filter_map(|(ray, hit)| {
            // On the side of the vertices' normals.
            let outwards = hit.normal * hit.normal.dot(hit.shading_normal).signum();
            let cosine = sign * outwards.dot(setup.to_light(hit.position));
            // At the terminator either is right.
            (cosine.abs() > 0.02).then_some((cosine > 0.0) != (ray.state != NEVER))
        }))
    };
    let receivers = shadow::new(rig, &setup.stand.shared, &setup.layers, true)?;
    rig.run(&[&receivers])?;
    let of_receivers: Vec<Transfer> = rig.read(&receivers.buffer)?;
    let unlike = |object: usize| {
        let starts = of_receivers.iter().zip(&stored).zip(&setup.hits);
        share(starts.filter_map(|((of_receiver, of_all), hit)| {
            let is_asked = hit.as_ref()?.object == object;
            Some((of_receiver.state != NEVER) != (is_asked && of_all.state != NEVER))
        }))
    };
    Ok(vec![
        Check::of(rig, format!("{kind:?}: share of pixels unlike those that show the receiver"))
            .within((0.01, "1"), unlike(0))
            .control("another object's", unlike(1)),
        Check::of(rig, format!("{kind:?}: 95th percentile of |start − surface|"))
            .within((0.01, "m"), places(DVec3::ZERO))
            .control("surface moved by 2 cm", places(0.02 * DVec3::Y)),
        Check::of(rig, format!("{kind:?}: 95th percentile of |direction − exact|"))
            .within((5e-3, "1"), directions(0.0))
            .control("light turned by a degree", directions(0.0175)),
        Check::of(rig, format!("{kind:?}: share of pixels that face the light wrongly"))
            .within((0.01, "1"), facing(1.0))
            .control("normals reversed", facing(-1.0)),
    ])
}

/// Shadows by marching against ray casting. A tolerance is for what a tangent plane does beside silhouettes, and for contacts within the start.
fn shadows(rig: &Rig<'_>, (name, tolerance): (&str, f64), kind: LightKind) -> Result<Check> {
    let setup = Setup::new(rig, name, kind)?;
    let Stand { shared, scene, tracer, .. } = &setup.stand;
    let walking = Walking {
        test: HitTest::Crossing,
        in_glass: None,
        tolerance_m: TOLERANCE_M,
        start_m: START_M,
        least: 8,
        rows: 1,
        ways: 1,
        within_px: None,
    };
    let rays = Rays {
        transfers: &setup.starts,
        layers: &setup.layers,
        bounds: scene.solid_bounds(),
        walking,
    };
    let march = march::new(rig, shared, &rays)?;
    rig.run(&[&setup.starts, &march])?;
    let ends = rig.read_photons(&march)?;
    let stored = setup.stored(rig)?;
    let shadowed = |end: &StoredPhoton| end.landed() && end.distance_m < setup.light_m(end.entry);
    let wrong = |turned: f64| {
        let rays = stored.iter().zip(&setup.hits).zip(&ends);
        share(rays.filter(|((ray, _), _)| ray.state != NEVER).filter_map(|((_, hit), end)| {
            let place = hit.as_ref()?.position;
            let along = (setup.to_light(place) + turned * DVec3::X).normalize();
            let exact = tracer.cast(place, along, OFF_M, setup.light_m(place)).is_some();
            Some(exact != shadowed(end))
        }))
    };
    Ok(Check::of(rig, format!("scene {name}, {kind:?}: share of pixels whose shadow is wrong"))
        .within((tolerance, "1"), wrong(0.0))
        .control("light turned", wrong(1.0))
        .with("shadowed_share", share(ends.iter().map(shadowed))))
}

/// The picture of a floor whose rays end by turns.
fn composed(rig: &Rig<'_>, kind: LightKind) -> Result<Check> {
    const EXPOSURE: f64 = 0.4;
    const SKY_SHARE: f64 = 0.15;
    const GREEN: usize = 1;
    let setup = Setup::new(rig, "ball", kind)?;
    // Every third pixel's ray ends half way to the light, every third behind a point light, every third nowhere.
    let photon = |(number, hit): (usize, &Option<Hit>)| {
        let place = hit.map_or(DVec3::ZERO, |hit| hit.position);
        let light_m = setup.light_m(place);
        let far_m = [0.5, 1.5, 0.0][number % 3] * if light_m.is_finite() { light_m } else { 4.0 };
        let end = rig::photon(place, place, far_m);
        if number % 3 == 2 { Photon { residual_m: OUTSIDE, ..end } } else { end }
    };
    let photons: Vec<Photon> = setup.hits.iter().enumerate().map(photon).collect();
    let photons = rig.photons(&photons);
    let stage = compose::new(rig, &setup.stand.shared, &setup.gbuffer, &photons, EXPOSURE)?;
    let shown = rig.drawn(&[&stage], stage.texture(), GREEN)?;
    let albedo = rig.channel(&setup.gbuffer.albedo, GREEN)?;
    let light = setup.stand.view.irradiance();
    let in_shadow = |number: usize| match number % 3 {
        0 => true,
        1 => kind == LightKind::Directional,
        _ => false,
    };
    let error = |shift: usize| {
        percentile::<90>(setup.hits.iter().enumerate().filter_map(|(number, hit)| {
            let hit = hit.as_ref()?;
            let normal = hit.shading_normal;
            let cosine = normal.dot(setup.to_light(hit.position)).max(0.0);
            let sky = SKY_SHARE * (0.6 + 0.4 * normal.y);
            let sun = if in_shadow(number + shift) { 0.0 } else { cosine };
            let exact = albedo.data()[number] / PI * light * (sky + sun);
            Some((radiance_of(shown.data()[number], EXPOSURE) - exact).abs() / exact)
        }))
    };
    // Steps of an 8-bit display, and of the normals' 16-bit floats.
    Ok(Check::of(rig, format!("{kind:?}: 90th percentile of the radiance's relative error"))
        .within((0.07, "1"), error(0))
        .control("shadows moved by a pixel", error(1)))
}
