//! `caustics/trace` through water that is given as a list of waves.

use super::photons::{Traced, settings, with_rates};
use crate::prelude::*;
use fathom_scene::Wave;
use fathom_stages::caustics;

const STAGE: &str = caustics::trace::INFO.name;
/// 99th percentile of |entry − exact|: places some 50 m from the light's near plane in f32, and the sines of an adapter; measured:
/// 7e-7 on lavapipe, 1.8e-5 on SwiftShader.
const ENTRY_P99_M: f64 = 5e-5;
/// 99th percentile of the angle between refracted directions, radians; measured: 2e-7 on lavapipe, 1.1e-5 on SwiftShader.
const DIRECTION_P99: f64 = 1e-4;
const GRID: u32 = 32;

pub fn cases() -> Vec<Case> {
    vec![Case::new(STAGE, "water from a list of waves", waves)]
}

/// Eight waves of different directions, lengths and phases.
fn wave_list() -> Vec<Wave> {
    let mut random = Random::new(41);
    let wave = |_| {
        let (sin, cos) = random.within(0.0, TAU).sin_cos();
        let wavelength_m = random.within(0.7, 3.0);
        Wave {
            direction: [2.0 * cos, 2.0 * sin],
            wavelength_m,
            amplitude_m: 0.012 * wavelength_m,
            phase_rad: random.within(-10.0, 10.0),
        }
    };
    (0..8).map(wave).collect()
}

/// Photons through the waves over a plane against the exact answers, and against those of higher waves.
fn waves(rig: &Rig<'_>) -> Checks {
    let mut scene = rig::flat_plane(LightKind::Directional)?;
    let [given, other] = [1.0, 1.1].map(|factor| {
        let mut waves = wave_list();
        waves.iter_mut().for_each(|wave| wave.amplitude_m *= factor);
        Water { model: WaterModel::Waves, waves, ..scene.water.clone() }
    });
    scene.water = given;
    let perturbed = "amplitudes 10 % higher";
    let traced = Traced::new(rig, scene, settings(GRID, 2))?;
    let errors = traced.errors(&traced.stand.scene.water);
    // Angle between the path under water and the exact one.
    let direction_p99 = |water: &Water| {
        let landings = traced.exact(water, &traced.stand.tracer);
        percentile::<99>(traced.photons.iter().zip(&landings).filter_map(|(photon, landing)| {
            let exact = landing.landed().filter(|_| photon.landed())?;
            let path = (photon.hit - photon.entry).try_normalize()?;
            Some(path.cross(exact.direction).length().asin())
        }))
    };
    let entry = Check::of(rig, "list of waves: 99th percentile of |entry − exact|")
        .within((ENTRY_P99_M, "m"), errors.entry_p99_m)
        .control(perturbed, traced.errors(&other).entry_p99_m);
    let direction =
        Check::of(rig, "list of waves: 99th percentile of the angle to the exact direction")
            .within((DIRECTION_P99, "rad"), direction_p99(&traced.stand.scene.water))
            .control(perturbed, direction_p99(&other));
    Ok(vec![with_rates(entry, &errors), direction])
}
