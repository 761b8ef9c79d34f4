//! The image-space intersection of Shah and Konttinen (UW §3.3) over an exact surface, to tell the
//! method's own failures from those of a depth map's resolution.

use glam::DVec3;

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
    }

    #[test]
    fn leaving_the_map_ends_without_an_estimate() {
        assert!(estimate(DVec3::ZERO, DVec3::NEG_Y, 1.0, 3, |_| None).is_none());
    }
}
