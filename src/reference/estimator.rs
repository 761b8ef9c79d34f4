//! Where a ray under water meets what the light sees, over an exact surface, to tell the methods' own failures from those of a
//! depth map's resolution: the iteration of Shah and Konttinen (UW §3.3), and the first crossing.

use glam::DVec3;

use super::bisected;
use super::rays::Tracer;
use fathom_scene::LightFrame;

#[derive(Clone, Debug, PartialEq)]
pub struct Estimate {
    /// Distance of p_e from the entry after the last iteration, metres.
    pub distance_m: f64,
    /// |p_e − p_proj|, metres: 0 where the estimate lies on the surface.
    pub residual_m: f64,
}

/// Iterates `p_e = p_s + d r_t`, `d ← |p_proj(p_e) − p_s|`, from `d = start_m`.
///
/// `surface` gives the point stored where p_e projects to; `None` where nothing is stored, which
/// ends the iteration without an estimate.
pub fn estimate(
    entry: DVec3,
    direction: DVec3,
    start_m: f64,
    iterations: u32,
    surface: impl Fn(DVec3) -> Option<DVec3>,
) -> Option<Estimate> {
    let mut distance_m = start_m;
    for _ in 0..iterations {
        let stored = surface(entry + direction * distance_m)?;
        distance_m = (stored - entry).length();
    }
    let point = entry + direction * distance_m;
    Some(Estimate { distance_m, residual_m: (point - surface(point)?).length() })
}

/// Halvings of a step about a crossing: below f64 resolution.
const HALVINGS: u32 = 60;
/// Two places this near to each other that lie before and behind what the light sees by more are at an edge, metres.
const EDGE_M: f64 = 1e-6;

/// The least distance at which a ray meets what the light sees, of those where it passes from before to behind it. At edges the ray goes
/// on: it passes behind what the light sees there. The way up to `reach_m` is searched in equal `steps`.
///
/// `behind` gives by how far the place at a distance lies behind what the light sees there; `None` where it sees nothing.
pub fn first_crossing(
    reach_m: f64,
    steps: u32,
    behind: impl Fn(f64) -> Option<f64>,
) -> Option<f64> {
    let depth = |d: f64| behind(d).unwrap_or(f64::NEG_INFINITY);
    let place = |step: u32| reach_m * f64::from(step) / f64::from(steps);
    (0..steps).map(|step| [place(step), place(step + 1)]).find_map(|[low, high]| {
        if depth(low) >= 0.0 || depth(high) < 0.0 {
            return None;
        }
        let [low, high] = bisected([low, high], HALVINGS, |d| depth(d) >= 0.0);
        (depth(high) - depth(low) < EDGE_M).then_some(high)
    })
}

/// By how far a point lies behind what a depth map of unlimited resolution and precision stores for it, metres.
pub fn behind_seen(frame: &LightFrame, tracer: &Tracer, point: DVec3) -> Option<f64> {
    let seen = exact_depth(frame, tracer, point)?;
    let ndc = frame.view_projection.project_point3(point);
    let (_, direction) = frame.ray(ndc.x, ndc.y);
    Some((point - seen).dot(direction))
}

/// The surface point that a depth map of unlimited resolution and precision stores for a world
/// point: the first hit of the light's ray through it.
pub fn exact_depth(frame: &LightFrame, tracer: &Tracer, point: DVec3) -> Option<DVec3> {
    let ndc = frame.view_projection.project_point3(point);
    let inside = ndc.x.abs() <= 1.0 && ndc.y.abs() <= 1.0;
    let (origin, direction) = frame.ray(ndc.x, ndc.y);
    let hit = inside.then(|| tracer.cast(origin, direction, 0.0, f64::MAX))?;
    hit.map(|hit| hit.position)
}

#[cfg(test)]
mod tests {
    use super::*;

    const DEPTH_M: f64 = 3.0;

    /// A floor lit from straight above: a depth map stores the point below.
    fn floor(p: DVec3) -> Option<DVec3> {
        Some(DVec3::new(p.x, -DEPTH_M, p.z))
    }

    #[test]
    fn over_a_flat_floor_the_residual_shrinks_by_the_squared_sine() {
        let sin: f64 = 0.4;
        let direction = DVec3::new(sin, -(1.0 - sin * sin).sqrt(), 0.0);
        let exact = DEPTH_M / (1.0 - sin * sin).sqrt();
        let after = |i| estimate(DVec3::ZERO, direction, 1.0, i, floor).unwrap();
        assert!((after(12).distance_m - exact).abs() < 1e-9);
        let ratio = after(6).residual_m / after(5).residual_m;
        assert!((ratio - sin * sin).abs() < 1e-2, "{ratio}");
    }

    #[test]
    fn a_step_between_two_depths_can_keep_the_estimate_swinging() {
        // Shallow to the left of x = 1, deep to the right; the ray passes the edge so that each
        // estimate lands on the other side.
        let step = |p: DVec3| Some(DVec3::new(p.x, if p.x < 1.0 { -3.0 } else { -1.0 }, p.z));
        let direction = DVec3::new(0.5, -(0.75f64).sqrt(), 0.0);
        let found = estimate(DVec3::ZERO, direction, 0.5, 50, step).unwrap();
        assert!(found.residual_m > 0.1, "residual {}", found.residual_m);
        assert_eq!(estimate(DVec3::ZERO, DVec3::NEG_Y, 1.0, 3, |_| None), None, "beside the map");
    }

    #[test]
    fn the_first_crossing_of_slanted_light_is_where_the_ray_meets_the_floor() {
        for degrees in [0.0f64, 50.0, 80.0] {
            let light = DVec3::new(degrees.to_radians().sin(), -degrees.to_radians().cos(), 0.0);
            let sin = light.x / 1.33;
            let ray = DVec3::new(sin, -(1.0 - sin * sin).sqrt(), 0.0);
            // Along the light from a point of the ray to the floor.
            let behind = |d: f64| Some((-DEPTH_M - ray.y * d) / -light.y);
            let found = first_crossing(10.0, 16, behind).unwrap();
            assert!((found - DEPTH_M / -ray.y).abs() < 1e-9, "{degrees}: {found}");
        }
    }

    #[test]
    fn a_ray_that_passes_behind_an_edge_lands_where_it_is_seen_again() {
        // In steep light a plate hides the ray from 1 m to 2 m of its way; the floor comes at 4 m.
        let behind = |d: f64| Some(if (1.0..2.0).contains(&d) { 0.5 } else { d - 4.0 });
        let found = first_crossing(5.0, 50, behind).unwrap();
        assert!((found - 4.0).abs() < 1e-9, "{found}");
        assert_eq!(first_crossing(3.9, 50, behind), None, "the floor lies beyond");
        assert_eq!(first_crossing(5.0, 50, |_| None), None);
    }
}
