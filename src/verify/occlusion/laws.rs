//! `ao/query` against closed forms: a plane, a corner, a ceiling.

use super::*;
use fathom_reference::occlusion::occlusion_beside_wall;
use fathom_stages::ao::query::INFO;

/// Voxels a side: twice r_max and room around it.
const SIDE: u32 = 96;
/// r_max of these cases in voxels.
const R_MAX: f64 = 40.0;

pub fn cases() -> Vec<Case> {
    vec![
        Case::new(INFO.name, "plane", plane),
        Case::new(INFO.name, "corner", corner),
        Case::new(INFO.name, "ceiling of a voxel", ceiling),
    ]
}

/// Steps of half a voxel and hard attenuation: A is a solid angle. The threshold is one for shells that are a voxel thick at
/// every slant, as these are; the default's, for conservative volumes, is checked with volumes of its own in `orientations`.
fn settings(m: &mut Marching) {
    m.threshold = 0.55;
    m.offset_voxels = 0.25;
    m.r_max_m = R_MAX * VOXEL_M;
    m.rays = 256;
    m.step_voxels = 0.5;
    m.attenuation = Attenuation::Hard;
}

fn is_floor(p: DVec3) -> bool {
    (p.y - 0.03 * VOXEL_M).abs() < 0.5 * VOXEL_M
}

/// Points of the floor at a distance from the plane x = 0, in voxels.
fn floor_points(x_voxels: f64) -> Vec<(DVec3, DVec3)> {
    let point = |i| DVec3::new(x_voxels, 0.03, 0.37 * f64::from(i) - 3.0) * VOXEL_M;
    (0..16).map(|i| (point(i), DVec3::Y)).collect()
}

/// A of these points over a volume.
fn run_query(
    rig: &Rig<'_>,
    inside: impl Fn(DVec3) -> bool,
    points: &[(DVec3, DVec3)],
    settings: &Marching,
) -> Result<Vec<f64>> {
    query(rig, &volume(rig, SIDE, 255, inside)?, points, settings)
}

/// The largest A of a plane is 0 with a variable guard, of half a diagonal or a whole one. VAO Fig. 3: with a constant one it is not.
fn plane(rig: &Rig<'_>) -> Result<Check> {
    let run = |guard| {
        let settings = Marching { guard, ..marching(settings) };
        run_query(rig, is_floor, &floor_points(0.0), &settings)
    };
    Ok(Check::new(rig, "largest A of a plane")
        .within(
            (1e-6, "1"),
            largest(run(Guard::Variable)?).max(largest(run(Guard::VariableDiagonal)?)),
        )
        .control("constant guard of a voxel's diagonal", largest(run(Guard::Voxel)?))
        .with("mean_with_guard_of_seven_voxels", mean(run(Guard::SevenVoxels)?))
        .with("mean_without_guard", mean(run(Guard::None)?)))
}

fn corner(rig: &Rig<'_>) -> Checks {
    let is_wall = |p: DVec3| (p.x - 0.03 * VOXEL_M).abs() < 0.5 * VOXEL_M;
    let is_corner = |p| is_floor(p) || is_wall(p);
    let check = |(x_voxels, tolerance): (f64, f64)| {
        // Of a floor beside a wall that is far higher than r_max.
        let beside =
            |x_voxels: f64| occlusion_beside_wall(x_voxels / R_MAX, reference::Obscurity::Hard);
        let (expected, other) = (beside(x_voxels - 0.03), beside(x_voxels + 6.0));
        let measured =
            mean(run_query(rig, is_corner, &floor_points(x_voxels), &marching(settings))?);
        Ok(Check::new(rig, format!("A in a corner, {x_voxels} voxels from the wall"))
            .within((tolerance, "1"), (measured - expected).abs())
            .control("the wall six voxels away", (measured - other).abs())
            .with("expected", expected))
    };
    // Near the wall the guard passes it at grazing angles: the error shrinks with the distance. VAO §6.1.
    [(1.0, 0.05), (2.0, 0.04), (4.0, 0.03)].into_iter().map(check).collect()
}

/// A ceiling of one voxel along an axis, by the defaults: no ray passes through it, wherever between two voxels the points lie. Rays that
/// meet it within r_max, of hard attenuation, are those with cos θ > h / r_max: A = 1 − (h / r_max)².
fn ceiling(rig: &Rig<'_>) -> Result<Check> {
    /// Heights of the points within a voxel.
    const SHIFTS: u32 = 16;
    let layer = 12.5;
    let is_ceiling = |p: DVec3| (p.y - layer * VOXEL_M).abs() < 0.25 * VOXEL_M;
    let heights: Vec<f64> = (0..SHIFTS).map(|i| f64::from(i) / f64::from(SHIFTS)).collect();
    let points: Vec<_> =
        heights.iter().map(|y| (DVec3::new(0.3, *y, 0.7) * VOXEL_M, DVec3::Y)).collect();
    let errors = |hit: Option<HitPoint>| -> Result<f64> {
        let settings = marching(|m| {
            m.r_max_m = R_MAX * VOXEL_M;
            m.rays = 256;
            m.attenuation = Attenuation::Hard;
            m.hit = hit.unwrap_or(m.hit);
        });
        // V reaches the threshold before the layer's middle.
        let before = 1.0 - settings.threshold + settings.offset_voxels;
        let law = |y: &f64| 1.0 - ((layer - before - y) / R_MAX).powi(2);
        let found = run_query(rig, is_ceiling, &points, &settings)?;
        Ok(largest(found.iter().zip(&heights).map(|(a, y)| (a - law(y)).abs())))
    };
    Ok(Check::new(rig, "A below a ceiling of a voxel, largest error at 16 places within a voxel")
        .within((0.02, "1"), errors(None)?)
        .control("hits at whole steps only", errors(Some(HitPoint::Sample))?))
}
