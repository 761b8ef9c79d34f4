//! `ldi/peel`: peeled depths against all hits along each pixel's ray, sorted.

use std::iter::successors;

use crate::prelude::*;

/// Scenes with columns and curved objects; with an open shore, seen from above; with many boxes and barrels.
const SCENES: [&str; 3] = ["tank", "port", "storage"];
const SIZE: [u32; 2] = [320, 240];
const LAYERS: usize = 8;
/// A ray goes on so far behind a surface, metres.
const OFF_M: f64 = 1e-6;

pub fn cases() -> Vec<Case> {
    Case::each(peel::INFO.name, SCENES, |name| format!("scene {name}"), layers).collect()
}

fn layers(rig: &Rig<'_>, name: &str) -> Result<Check> {
    let fixture = rig.fixture(Scene::load(name)?, SIZE)?;
    let Fixture { shared, scene, geometry, .. } = &fixture;
    let peel = peel::new(rig, shared, scene, geometry, Objects::Solid, SIZE, LAYERS as u32)?;
    rig.run(&[&peel])?;
    let peeled = read_volume(rig.gpu, &peel.depths, 0)?;
    let texel = |(x, y): (u32, u32), layer: usize| {
        let row = y as usize + layer * SIZE[1] as usize;
        f64::from(peeled.data[x as usize + row * SIZE[0] as usize])
    };
    // The nearest first, one more than there are layers at most.
    let exact = |(x, y): (u32, u32)| -> Vec<f64> {
        let (origin, direction, _) = fixture.rays.ray(x, y);
        let next = |from_m: f64| fixture.tracer.cast(origin, direction, from_m, f64::MAX);
        let hits = successors(next(0.0), |hit| next(hit.distance_m + OFF_M)).take(LAYERS + 1);
        hits.filter_map(|hit| Some(fixture.rays.project(hit.position)?.depth)).collect()
    };
    let chosen = pixels(SIZE).filter(|(x, y)| x % 7 == 3 && y % 7 == 3);
    let chosen: Vec<_> = chosen.map(|at| (at, exact(at))).collect();
    let view_m = |z: f64| fixture.view.camera.view_depth_m(z);
    let errors = |behind: usize| {
        percentile::<90>(chosen.iter().flat_map(|(at, exact)| {
            (0..LAYERS).filter_map(move |layer| {
                let z = texel(*at, layer);
                match (z < 1.0, exact.get(layer + behind).filter(|z| **z < 1.0)) {
                    (true, Some(exact)) => Some(relative_error(view_m(z), view_m(*exact))),
                    (false, None) => None,
                    _ => Some(1.0),
                }
            })
        }))
    };
    let what = "90th percentile of the layers' depth errors, of the distance";
    // At silhouettes, and where surfaces touch, another one may be next.
    Ok(Check::new(rig, format!("scene {name}: {what}"))
        .within((5e-3, "1"), errors(0))
        .control("each layer held against the next", errors(1)))
}
