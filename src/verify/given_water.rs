//! `caustics/trace` through water that is given: a list of waves, and a height map.

use super::photons::{Traced, settings, with_rates};
use crate::prelude::*;
use fathom_scene::{HeightMap, Tile, Wave};
use fathom_stages::caustics;
use std::sync::Arc;

const STAGE: &str = caustics::trace::INFO.name;
/// 99th percentile of |entry − exact|: places some 50 m from the light's near plane in f32, and the sines of an adapter; measured:
/// 7e-7 on lavapipe, 1.8e-5 on SwiftShader.
const ENTRY_P99_M: f64 = 5e-5;
/// 99th percentile of the angle between refracted directions, radians; measured: 2e-7 on lavapipe, 1.1e-5 on SwiftShader.
const DIRECTION_P99: f64 = 1e-4;
const GRID: u32 = 32;
/// Samples of the height map along x and z, and its tile.
const SAMPLES: [usize; 2] = [48, 64];
const TILE_M: [f64; 2] = [3.0, 4.0];

pub fn cases() -> Vec<Case> {
    vec![
        Case::new(STAGE, "water from a list of waves", waves),
        Case::new(STAGE, "water from a height map", height_map),
    ]
}

/// Eight waves of different directions, lengths and phases, in both forms.
fn wave_list() -> Vec<Wave> {
    let mut random = Random::new(41);
    let wave = |i: u32| {
        let (sin, cos) = random.within(0.0, TAU).sin_cos();
        let length_m = random.within(0.7, 3.0);
        let k = TAU / length_m;
        let as_vector = i.is_multiple_of(2);
        Wave {
            direction: (!as_vector).then_some([2.0 * cos, 2.0 * sin]),
            wavelength_m: (!as_vector).then_some(length_m),
            vector_rad_m: as_vector.then_some([k * cos, k * sin]),
            amplitude_m: 0.012 * length_m,
            phase_rad: random.within(-10.0, 10.0),
        }
    };
    (0..8).map(wave).collect()
}

/// Heights without symmetry: four waves that fit the tile.
fn tile(map: &HeightMap) -> Result<Tile> {
    let [columns, rows] = SAMPLES;
    let height = |j: usize, i: usize| {
        let (u, v) = (i as f64 / columns as f64, j as f64 / rows as f64);
        let wave = |a: f64, k: f64, l: f64, phase: f64| a * (TAU * (k * u + l * v) + phase).cos();
        wave(0.04, 1.0, 0.0, 0.3)
            + wave(0.03, 1.0, 2.0, 1.0)
            + wave(0.02, -2.0, 3.0, 2.0)
            + wave(0.006, 5.0, 4.0, 0.0)
    };
    let heights = (0..rows).flat_map(|j| (0..columns).map(move |i| height(j, i)));
    Tile::new(columns, heights.collect(), map)
        .map_err(|what| VerifyError::Invalid { stage: STAGE, what })
}

fn waves(rig: &Rig<'_>) -> Checks {
    let water = |factor: f64, flat: Water| {
        let mut waves = wave_list();
        waves.iter_mut().for_each(|wave| wave.amplitude_m *= factor);
        Ok(Water { model: WaterModel::Waves, waves, ..flat })
    };
    compare(rig, "list of waves", water, 1.0, ("amplitudes 10 % higher", 1.1))
}

fn height_map(rig: &Rig<'_>) -> Checks {
    let water = |shifted: f64, flat: Water| {
        let origin_m = [0.3 + shifted * TILE_M[0] / SAMPLES[0] as f64, -0.2];
        let height_map = HeightMap { tile_m: TILE_M, origin_m, ..HeightMap::default() };
        let tile = Some(Arc::new(tile(&height_map)?));
        Ok(Water { model: WaterModel::HeightMap, height_map, tile, ..flat })
    };
    compare(rig, "height map", water, 0.0, ("tile shifted by a sample", 1.0))
}

/// Photons through given water over a plane against the exact answers, and against those of perturbed water.
fn compare(
    rig: &Rig<'_>,
    what: &str,
    water: impl Fn(f64, Water) -> Result<Water>,
    given: f64,
    (perturbed, other): (&str, f64),
) -> Checks {
    let mut scene = rig::flat_plane(LightKind::Directional)?;
    let other = water(other, scene.water.clone())?;
    scene.water = water(given, scene.water)?;
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
    let entry = Check::of(rig, format!("{what}: 99th percentile of |entry − exact|"))
        .within((ENTRY_P99_M, "m"), errors.entry_p99_m)
        .control(perturbed, traced.errors(&other).entry_p99_m);
    let direction =
        Check::of(rig, format!("{what}: 99th percentile of the angle to the exact direction"))
            .within((DIRECTION_P99, "rad"), direction_p99(&traced.stand.scene.water))
            .control(perturbed, direction_p99(&other));
    Ok(vec![with_rates(entry, &errors), direction])
}
