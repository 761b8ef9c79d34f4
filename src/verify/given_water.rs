//! `caustics/trace` through water that is given: a list of waves, and a height map.

use std::sync::Arc;

use glam::DVec3;

use super::photons::{Family, exact, settings, trace, with_rates};
use super::{Case, Check, Checks, Random, Result, Rig, VerifyError, rig};
use fathom_reference::photons::Landing;
use fathom_reference::quantities::{StoredPhoton, photon_errors, quantile};
use fathom_reference::rays::Tracer;
use fathom_scene::{HeightMap, LightKind, Scene, Tile, Water, WaterModel, Wave};
use fathom_stages::caustics;

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
        let (sin, cos) = random.within(0.0, std::f64::consts::TAU).sin_cos();
        let length_m = random.within(0.7, 3.0);
        let k = std::f64::consts::TAU / length_m;
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
fn tile(origin_m: [f64; 2]) -> Result<Tile> {
    let [columns, rows] = SAMPLES;
    let height = |j: usize, i: usize| {
        let (u, v) = (i as f64 / columns as f64, j as f64 / rows as f64);
        let wave = |a: f64, k: f64, l: f64, phase: f64| {
            a * (std::f64::consts::TAU * (k * u + l * v) + phase).cos()
        };
        wave(0.04, 1.0, 0.0, 0.3)
            + wave(0.03, 1.0, 2.0, 1.0)
            + wave(0.02, -2.0, 3.0, 2.0)
            + wave(0.006, 5.0, 4.0, 0.0)
    };
    let heights = (0..rows).flat_map(|j| (0..columns).map(move |i| height(j, i)));
    let map = HeightMap { tile_m: TILE_M, origin_m, ..HeightMap::default() };
    Tile::new(columns, heights.collect(), &map)
        .map_err(|what| VerifyError::Invalid { stage: STAGE, what })
}

fn waves(rig: &Rig<'_>) -> Checks {
    let water = |factor: f64| {
        let mut waves = wave_list();
        waves.iter_mut().for_each(|wave| wave.amplitude_m *= factor);
        move |water: &Water| Water {
            model: WaterModel::Waves,
            waves: waves.clone(),
            ..water.clone()
        }
    };
    compare(rig, "list of waves", water(1.0), ("amplitudes 10 % higher", water(1.1)))
}

fn height_map(rig: &Rig<'_>) -> Checks {
    let water = |origin_m: [f64; 2]| -> Result<_> {
        let tile = Arc::new(tile(origin_m)?);
        Ok(move |water: &Water| Water {
            model: WaterModel::HeightMap,
            height_map: HeightMap { tile_m: TILE_M, origin_m, ..HeightMap::default() },
            tile: Some(Arc::clone(&tile)),
            ..water.clone()
        })
    };
    let spacing_m = TILE_M[0] / SAMPLES[0] as f64;
    let (given, shifted) = (water([0.3, -0.2])?, water([0.3 + spacing_m, -0.2])?);
    compare(rig, "height map", given, ("tile shifted by a sample", shifted))
}

/// Photons through given water over a plane against the exact answers, and against those of perturbed water.
fn compare(
    rig: &Rig<'_>,
    what: &str,
    given: impl Fn(&Water) -> Water,
    (perturbed, other): (&str, impl Fn(&Water) -> Water),
) -> Checks {
    let mut scene: Scene = rig::flat_plane(LightKind::Directional)?;
    let flat = scene.water.clone();
    scene.water = given(&flat);
    let (photons, frame) = trace(rig, &scene, Family::Caustics, settings(GRID, 2), false)?;
    let tracer = Tracer::new(&scene.objects)?;
    let landings = exact(&frame, &scene.water, &tracer, [GRID, 4])?;
    let others = exact(&frame, &other(&flat), &tracer, [GRID, 4])?;
    let errors = photon_errors(&photons, &landings);
    let entry = Check::of(STAGE, format!("{what}: 99th percentile of |entry − exact|"))
        .within((ENTRY_P99_M, "m"), errors.entry_p99_m)
        .control(perturbed, photon_errors(&photons, &others).entry_p99_m);
    let direction =
        Check::of(STAGE, format!("{what}: 99th percentile of the angle to the exact direction"))
            .within((DIRECTION_P99, "rad"), direction_p99(&photons, &landings))
            .control(perturbed, direction_p99(&photons, &others));
    Ok(vec![with_rates(entry, &errors), direction])
}

/// Angle between the path under water and the exact one.
fn direction_p99(photons: &[StoredPhoton], landings: &[Landing]) -> f64 {
    let angle = |(photon, landing): (&StoredPhoton, &Landing)| {
        let exact = landing.landed().filter(|_| photon.landed())?;
        let path: DVec3 = (photon.hit - photon.entry).try_normalize()?;
        Some(path.cross(exact.direction).length().asin())
    };
    let mut angles: Vec<f64> = photons.iter().zip(landings).filter_map(angle).collect();
    quantile(&mut angles, 0.99)
}
