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
