//! `photons/query`: photons from given starts against exact refraction and ray casting.

use crate::prelude::*;
use fathom_pipelines::underwater::{Params, photons_at, view};
use fathom_reference::photons::land_ray;
use fathom_stages::photons::query::{Answer, INFO, Start};

/// As of the tracing stages over a plane: what is left is f32 and the depth map's bits.
const RELATIVE: f64 = 1e-4;
const COUNT: u32 = 1000;
/// Starts lie so far above the water, metres.
const HEIGHT_M: f64 = 2.0;

pub fn cases() -> Vec<Case> {
    vec![
        Case::new(INFO.name, "starts on the light's rays", |rig| {
            landings(rig, LightKind::Directional, false, "the light's rays")
        }),
        Case::new(INFO.name, "starts under a point light", |rig| {
            landings(rig, LightKind::Point, false, "a point light's rays")
        }),
        Case::new(INFO.name, "starts with directions of their own", |rig| {
            landings(rig, LightKind::Directional, true, "given directions")
        }),
        Case::new(INFO.name, "Fresnel transmittance, normal to grazing", energy_law),
    ]
}

/// Scene `plane` under flat water, and its parameters.
fn subject(kind: LightKind) -> Result<(Scene, Params)> {
    let scene = rig::flat_plane(kind)?;
    let mut params = Params::from(&SceneFile::load("plane")?);
    params.light = scene.light.clone();
    params.water = scene.water.clone();
    params.caustics.iterations = 12;
    Ok((scene, params))
}

/// Starts above the middle of the plane, with directions within 30° of straight down where they are their own.
fn starts(aimed: bool) -> Vec<Start> {
    let mut random = Random::new(3);
    let start = |_| {
        let mut within = |half: f64| random.within(-half, half) as f32;
        let direction = Vec3::new(within(0.4), -1.0, within(0.4)).normalize();
        Start {
            position_m: Vec3::new(within(0.5), HEIGHT_M as f32, within(0.5)),
            aimed: u32::from(aimed),
            direction: if aimed { direction } else { Vec3::ZERO },
        }
    };
    (0..COUNT).map(start).collect()
}

fn landings(rig: &Rig<'_>, kind: LightKind, aimed: bool, what: &str) -> Result<Check> {
    let (scene, params) = subject(kind)?;
    let starts = starts(aimed);
    let answers = photons_at(rig.gpu, &scene, &params, &starts)?;
    let light = view(&params, &scene).light_frame();
    let tracer = Tracer::new(&scene.objects);
    let error = |refractive_index: f64| {
        let water = Water { refractive_index, ..scene.water.clone() };
        largest(answers.iter().zip(&starts).filter_map(|(answer, start)| {
            let origin = start.position_m.as_dvec3();
            let incident = match (aimed, kind) {
                (true, _) => start.direction.as_dvec3(),
                (false, LightKind::Directional) => light.forward,
                (false, LightKind::Point) => (origin - light.position).normalize(),
            };
            let exact = land_ray(&water, &tracer, origin, incident).landed()?.hit;
            let apart = answer.photon.hit_m.as_dvec3().distance(exact.position);
            // Not a number where a photon is lost that lands exactly.
            let landed = answer.photon.residual_m >= 0.0;
            Some(if landed { apart / exact.distance_m } else { f64::NAN })
        }))
    };
    Ok(Check::of(rig, format!("{what}: largest |hit − exact| / path"))
        .within((RELATIVE, "1"), error(1.33))
        .control("refractive index 1.34", error(1.34)))
}

/// Weights and directions over flat water from 0° to 89°: T + R = 1 with the exact R, and Snell's law.
fn energy_law(rig: &Rig<'_>) -> Checks {
    let (scene, mut params) = subject(LightKind::Directional)?;
    params.water.fresnel = true;
    let angles: Vec<f64> = (0..90).map(|degrees| f64::from(degrees).to_radians()).collect();
    let incident = |angle: f64| DVec3::new(0.6 * angle.sin(), -angle.cos(), 0.8 * angle.sin());
    let start = |angle: &f64| {
        let direction = incident(*angle).as_vec3();
        Start { position_m: -direction, aimed: 1, direction }
    };
    let starts: Vec<Start> = angles.iter().map(start).collect();
    let answers = photons_at(rig.gpu, &scene, &params, &starts)?;
    let pairs = || answers.iter().zip(&angles);
    let energy = |n: f64| {
        largest(pairs().map(|(answer, angle)| {
            (f64::from(answer.weight) + fresnel_reflectance(angle.cos(), 1.0, n) - 1.0).abs()
        }))
    };
    let bent = |n: f64| {
        largest(pairs().map(|(answer, angle)| {
            let exact = refract(incident(*angle), DVec3::Y, 1.0, n).unwrap_or(DVec3::NAN);
            answer.direction.as_dvec3().distance(exact)
        }))
    };
    let weight = |answer: Option<&Answer>| answer.map_or(f64::NAN, |answer| answer.weight.into());
    Ok(vec![
        Check::of(rig, "Fresnel over 0° to 89°: largest |T + R − 1|")
            .within((1e-4, "1"), energy(1.33))
            .control("refractive index 1.34", energy(1.34))
            .with("transmittance_at_0_deg", weight(answers.first()))
            .with("transmittance_at_89_deg", weight(answers.last())),
        Check::of(rig, "refraction over 0° to 89°: largest |direction − exact|")
            .within((1e-4, "1"), bent(1.33))
            .control("refractive index 1.34", bent(1.34)),
    ])
}
