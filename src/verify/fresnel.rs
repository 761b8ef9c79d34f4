//! Fresnel transmission at entry: what `caustics/splat` and `godrays/lines` draw with it and without it.

use super::lines;
use super::splats::{RULES, draw_free, photon_at};
use crate::prelude::*;
use fathom_stages::caustics::splat;
use fathom_stages::godrays::lines as line;

/// Relative: directions come from places in f32, over paths of 0.6 m.
const TOLERANCE: f64 = 1e-4;
/// UW §4.1, and what controls take in its place.
const INDEX: f64 = 1.33;
const OTHER_INDEX: f64 = 1.34;
/// Cells per side of the picture, a photon in each.
const CELLS: u32 = 4;
/// Length of the photons' paths, metres: lines stay within their cells.
const PATH_M: f64 = 0.6;
/// Greatest angle of incidence, radians: 85°.
const STEEPEST: f64 = 1.48;

pub fn cases() -> Vec<Case> {
    vec![
        Case::new(splat::INFO.name, "Fresnel transmission of splats", |rig| {
            transmitted(rig, 512, |rig, view, photons| draw_free(rig, view, photons, &RULES))
        }),
        Case::new(line::INFO.name, "Fresnel transmission of lines", |rig| {
            transmitted(rig, 384, lines::draw)
        }),
    ]
}

/// A photon of a point light for each cell that was refracted by a surface of another slope, and its angle of incidence's cosine.
fn photons(view: &View, side_px: u32) -> Vec<(Photon, f64)> {
    let light = view.light_frame().position;
    let mut random = Random::new(7);
    let count = CELLS * CELLS;
    let photon = |i: u32| {
        let angle = STEEPEST * f64::from(i) / f64::from(count - 1);
        let cell_px = f64::from(side_px / CELLS);
        let at = [i % CELLS, i / CELLS].map(|cell| (f64::from(cell) + 0.5) * cell_px);
        let (_, (entry, _)) = photon_at(view, at, 6.0, 1.0);
        let incident = (entry - light).normalize();
        let across = incident.any_orthonormal_vector();
        let around = across.rotate_axis(incident, random.within(0.0, TAU));
        let normal = -incident * angle.cos() + around * angle.sin();
        let refracted = refract(incident, normal, 1.0, INDEX).unwrap_or(incident);
        (rig::photon(entry, entry + refracted * PATH_M, PATH_M), angle.cos())
    };
    (0..count).map(photon).collect()
}

/// Sums over the cells of a picture, row by row.
fn cell_sums(image: &Image) -> Vec<f64> {
    let side = i64::from(image.width() / CELLS);
    let sum = |cell: u32| {
        let (x, y) = (i64::from(cell % CELLS) * side, i64::from(cell / CELLS) * side);
        (0..side * side).map(|i| image.clamped(x + i % side, y + i / side)).sum()
    };
    (0..CELLS * CELLS).map(sum).collect()
}

/// What each photon adds to the picture with transmission over what it adds without, against the exact transmittance.
fn transmitted(
    rig: &Rig<'_>,
    side_px: u32,
    drawn: fn(&Rig<'_>, &View, &[Photon]) -> Result<Image>,
) -> Result<Check> {
    let mut view = rig::synthetic_view([side_px; 2], 0.0)?;
    view.light.kind = LightKind::Point;
    let (photons, cosines): (Vec<Photon>, Vec<f64>) = photons(&view, side_px).into_iter().unzip();
    let mut draw = |fresnel: bool| -> Result<Vec<f64>> {
        view.water.fresnel = fresnel;
        Ok(cell_sums(&drawn(rig, &view, &photons)?))
    };
    let (whole, passed) = (draw(false)?, draw(true)?);
    let error = |index: f64| {
        let shares = passed.iter().zip(&whole).map(|(a, b)| a / b);
        largest(shares.zip(&cosines).map(|(share, cosine)| {
            relative_error(share, fresnel_transmittance(*cosine, 1.0, index))
        }))
    };
    // A share of two sums.
    let short = rig.stage == line::INFO.name && rig.sums_are_short();
    let tolerance = if short { 2.0 * rig::SHORT_STEP } else { TOLERANCE };
    Ok(Check::new(rig, "Fresnel transmittance up to 85°: largest relative error")
        .within((tolerance, "1"), error(INDEX))
        .control("refractive index 1.34", error(OTHER_INDEX)))
}
