//! Where the first sample of a ray lies beyond another surface: points near the edge of two half planes. VAO §6.1, Fig. 10.

use super::orientations::{Body, TurnedBody, defaults, half_planes, orientation, shift};
use crate::prelude::*;
use fathom_stages::ao::query::INFO;

/// Distances from the edge, voxels.
const VOXELS: [f64; 5] = [1.0, 1.5, 2.5, 4.0, 8.0];
/// Angle of the half planes, degrees, and how much too small A is at most at each of the distances: docs/volume-ao.md.
const TOO_SMALL: [(f64, [f64; 5]); 4] = [
    (30.0, [0.75, 0.62, 0.17, 0.01, 0.0]),
    (45.0, [0.46, 0.21, 0.05, 0.03, 0.01]),
    (60.0, [0.36, 0.16, 0.03, 0.0, 0.0]),
    (90.0, [0.14, 0.06, 0.02, 0.0, 0.0]),
];
/// Points at each distance.
const POINTS: u32 = 16;
/// Axis-aligned and turned by 45°, towards (1, 1, 1) and at random.
const ORIENTATIONS: u32 = 10;
/// By which a driver's rounding may exceed a figure of the table.
const ROUNDING: f64 = 0.03;

pub fn cases() -> Vec<Case> {
    Case::each(INFO.name, TOO_SMALL, |(angle_deg, _)| title(angle_deg), check).collect()
}

fn title(angle_deg: f64) -> String {
    format!("orientations, near the edge of half planes at {angle_deg}°")
}

fn check(rig: &Rig<'_>, (angle_deg, bounds): (f64, [f64; 5])) -> Result<Check> {
    let worst = worst(rig, angle_deg)?;
    let beyond = |nearer: usize| {
        let bounds = bounds.iter().skip(nearer);
        largest(worst.iter().zip(bounds).map(|(error, bound)| -error - bound))
    };
    let check = Check::new(rig, title(angle_deg) + ": A less than documented")
        .within((ROUNDING, "1"), beyond(0))
        .control("held against the figures of the next distance", beyond(1));
    let with = |check: Check, (error, voxels): (&f64, f64)| {
        check.with(format!("largest_error_at_{voxels}_voxels"), *error)
    };
    Ok(worst.iter().zip(VOXELS).fold(check, with))
}

/// The error of A, the mean of points, in the orientation in which A is least, at each distance.
fn worst(rig: &Rig<'_>, angle_deg: f64) -> Result<Vec<f64>> {
    let mesh = half_planes(angle_deg);
    let params = defaults()?;
    let at = |voxels: f64| {
        let mut random = Random::new(5);
        let mut least = f64::INFINITY;
        for number in 0..ORIENTATIONS {
            let (turn, shift) = (orientation(number, &mut random), shift(&mut random));
            let body = |points| Body { mesh: mesh.clone(), points };
            let voxel_m = TurnedBody::new(&body(Vec::new()), turn, shift)?.voxel_m(&params)?;
            let point = |_| (DVec3::new(voxels * voxel_m, 0.0, random.within(-0.6, 0.6)), DVec3::Y);
            let points = (0..POINTS).map(point).collect();
            let errors = TurnedBody::new(&body(points), turn, shift)?.errors(rig, &params)?;
            least = least.min(mean(errors));
        }
        Ok(least)
    };
    VOXELS.into_iter().map(at).collect()
}
