//! `transfer/map`: weights of photons against the solid angle of their share of the light's screen and Fresnel's transmittance.

use crate::prelude::*;
use fathom_reference::photons::place_in_grid;

const GRID: [u32; 2] = [48, 40];
/// Where photons start within the cells of the grid: off the middle.
const IN_CELL: [f64; 2] = [0.375, 0.625];

pub fn cases() -> Vec<Case> {
    let kinds = [LightKind::Directional, LightKind::Point];
    Case::each(map::INFO.name, kinds, |kind| format!("weights, {kind:?} light"), weights).collect()
}

fn weights(rig: &Rig<'_>, kind: LightKind) -> Result<Check> {
    let mut scene = rig::flat_plane(kind)?;
    (scene.water.amplitude_m, scene.water.fresnel) = (0.05, true);
    let fixture = rig.fixture(scene, [64, 48])?;
    let depth = shadow::depth::new(rig, &fixture.shared, &fixture.geometry, 512)?;
    let mask = shadow::mask::new(rig, &fixture.shared, depth.texture(), 64)?;
    let settings = map::MapUniforms { grid: GRID.into(), offset: DVec2::from(IN_CELL).as_vec2() };
    let map = map::new(rig, &fixture.shared, mask.texture(), &settings)?;
    rig.run(&[&depth, &mask, &map])?;
    let stored: Vec<Transfer> = rig.read(&map.transfers.buffer)?;
    let weights: Vec<f32> = rig.read(&map.weights)?;
    let (frame, water) = (fixture.view.light_frame(), &fixture.scene.water);
    let alive = || (0..).zip(stored.iter().zip(&weights)).filter(|(_, (to, _))| to.state > NEVER);
    let error = |fresnel: bool| {
        percentile::<99>(alive().filter_map(|(number, (_, weight))| {
            let (origin, incident) = frame.photon_ray(place_in_grid(number, GRID, IN_CELL));
            let normal = enter(water, origin, incident, f64::MAX)?.normal;
            let cosine = incident.dot(normal).abs();
            let passes = fresnel_transmittance(cosine, 1.0, water.refractive_index);
            let angular = match kind {
                LightKind::Directional => 1.0,
                LightKind::Point => incident.dot(frame.forward).powi(3),
            };
            let exact = angular * if fresnel { passes } else { 1.0 };
            Some(relative_error(f64::from(*weight), exact))
        }))
    };
    Ok(Check::new(rig, format!("{kind:?}: 99th percentile of the weight's relative error"))
        .within((2e-3, "1"), error(true))
        .control("without Fresnel's transmittance", error(false)))
}
