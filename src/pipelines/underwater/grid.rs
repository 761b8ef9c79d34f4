//! The photon grids of caustics and godrays: what they have in common, and the iterations of their estimators by the light.

use glam::{DVec3, Vec2};

use super::SubdivisionMode;
use fathom_base::parameter::ParamError;
use fathom_scene::LightFrame;
use fathom_stages::photon::{PhotonEstimator, TraceUniforms};
use fathom_stages::uniforms::View;

/// Steps of regula falsi: enough to find an edge of the light's depth within a quarter of a texel in a step of four.
const SECANT_ITERATIONS: u32 = 8;
/// Fewest and most iterations of the paper's estimator that are chosen for it: 6 hold on level floors in steep light under waves as high as
/// those of the scenes, and 64 reach a millimetre in 4 m up to 69°.
const PAPER_ITERATIONS: [u32; 2] = [6, 64];
/// Error that the paper's estimator is to reach, as a share of the depth.
const REACHED: f64 = 2.5e-4;
/// How far below the scene's lowest point a search goes on, as a share of its depth: more than the light's depth is rounded by.
const BELOW: f64 = 1e-3;
/// Share of the scene's size that counts as the depth of a shallower one.
const MIN_DEPTH: f64 = 0.1;

/// The photon-grid part that caustics and godrays share.
#[derive(Clone, Debug, PartialEq)]
pub struct GridSettings {
    pub grid: u32,
    pub subdivision: u32,
    pub mode: SubdivisionMode,
    pub offset: [f64; 2],
    pub jitter: f64,
    pub estimator: PhotonEstimator,
    /// 0: chosen from the light.
    pub iterations: u32,
    pub step_px: f64,
    pub start_m: f64,
    pub tolerance_m: f64,
    pub mask: bool,
}

impl GridSettings {
    pub fn photons(&self) -> u64 {
        u64::from(self.grid) * u64::from(self.grid) * u64::from(self.subdivision)
    }

    /// Photons per side of a cell.
    pub fn side(&self) -> u32 {
        self.subdivision.isqrt()
    }

    /// In a view whose light's depth has `shadow_px` texels a side.
    pub fn uniforms(&self, view: &View, shadow_px: u32) -> TraceUniforms {
        let iterations = self.iterations_in(view);
        let across_px = across_px(view, shadow_px);
        TraceUniforms {
            grid: self.grid,
            side: self.side(),
            estimator: self.estimator as u32,
            iterations,
            masked: u32::from(self.mask),
            offset: Vec2::new(self.offset[0] as f32, self.offset[1] as f32),
            start_m: self.start_m as f32,
            tolerance_m: self.tolerance_m as f32,
            jitter: self.jitter as f32,
            step_px: self.step_px as f32,
            bottom_m: bottom_m(view) as f32,
            lookups: self.estimator.lookups(iterations, across_px, self.step_px),
            search_iterations: 0,
        }
    }

    /// Iterations as set, or chosen.
    pub fn iterations_in(&self, view: &View) -> u32 {
        match (self.iterations, self.estimator) {
            (0, PhotonEstimator::Secant) => SECANT_ITERATIONS,
            (0, PhotonEstimator::Paper) => paper_iterations(view, self.start_m),
            (set, _) => set,
        }
    }

    pub(super) fn consistent(&self, name: &str) -> Result<(), ParamError> {
        let side = self.side();
        if side == 0 || side * side != self.subdivision {
            return Err(ParamError::Unfit(format!(
                "{name}.subdivision is {}: it must be a square number (1, 4, 9, 16 …)",
                self.subdivision
            )));
        }
        if self.photons() > u64::from(u32::MAX / 8) {
            return Err(ParamError::Unfit(format!(
                "{name}.grid² × {name}.subdivision is {}: more photons than can be indexed",
                self.photons()
            )));
        }
        Ok(())
    }
}

/// Height below which there is nothing to meet.
fn bottom_m(view: &View) -> f64 {
    let lowest_m = view.bounds.min.y;
    lowest_m - BELOW * lowest_m.abs().max(MIN_DEPTH * view.bounds.size().length())
}

/// Texels of the light's depth that the middle ray covers under level water, down to the scene's bottom.
fn across_px(view: &View, shadow_px: u32) -> f64 {
    let light = view.light_frame();
    let (origin, incident) = light.ray(0.0, 0.0);
    let entry = origin - incident * (origin.y / incident.y.min(-f64::EPSILON));
    let across = DVec3::new(incident.x, 0.0, incident.z) / view.water.refractive_index;
    let refracted = across - DVec3::Y * (1.0 - across.length_squared()).max(0.0).sqrt();
    let end = entry + refracted * (bottom_m(view) / refracted.y.min(-f64::EPSILON));
    let [begin, end] = [entry, end].map(|p| light.view_projection.project_point3(p).truncate());
    begin.distance(end) * f64::from(shadow_px) / 2.0
}

/// By how much an iteration of the paper's estimator multiplies the error under level water over a level floor, in light that comes at
/// this cosine to the vertical: sin ρ · sin(θ − ρ) / cos θ.
pub fn contraction(cosine: f64, refractive_index: f64) -> f64 {
    let angle = cosine.clamp(-1.0, 1.0).acos();
    let refracted = (angle.sin() / refractive_index).min(1.0).asin();
    refracted.sin() * (angle - refracted).sin().abs() / cosine
}

/// Cosines to the vertical of the light's rays that fall: at the corners of its frustum and in the middle.
fn cosines(light: &LightFrame) -> impl Iterator<Item = f64> + use<> {
    let places = [[0.0, 0.0], [-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]];
    places.map(|[x, y]| -light.ray(x, y).1.y).into_iter().filter(|cosine| *cosine > 0.0)
}

/// The largest factor of [`contraction`] in the light's frustum; from 1 on the paper's estimator diverges.
pub fn largest_contraction(view: &View) -> f64 {
    let factors = cosines(&view.light_frame()).map(|c| contraction(c, view.water.refractive_index));
    factors.fold(0.0, f64::max)
}

/// As many as bring the error from the first estimate to [`REACHED`] over the scene's lowest floor.
fn paper_iterations(view: &View, start_m: f64) -> u32 {
    let depth_m = -view.bounds.min.y;
    let n = view.water.refractive_index;
    let [fewest, max] = PAPER_ITERATIONS;
    let needed = |cosine: f64| {
        let factor = contraction(cosine, n);
        let fall = (1.0 - (1.0 - cosine * cosine).max(0.0) / (n * n)).max(0.0).sqrt();
        let reached_m = REACHED * depth_m;
        let error_m = (depth_m / fall - start_m).abs().max(reached_m);
        if factor < 1.0 { (reached_m / error_m).ln() / factor.ln() } else { f64::INFINITY }
    };
    let needed = cosines(&view.light_frame()).map(needed).fold(0.0, f64::max);
    (needed.ceil() as u32).clamp(fewest, max)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rate(degrees: f64) -> f64 {
        contraction(degrees.to_radians().cos(), 1.33)
    }

    #[test]
    fn the_papers_estimator_leaves_less_than_a_millimetre_up_to_50_degrees_and_diverges_from_72() {
        // From the first estimate of 1 m to the floor in 5 m.
        let left_m = |degrees: f64| {
            let sin = degrees.to_radians().sin() / 1.33;
            (5.0 / (1.0 - sin * sin).sqrt() - 1.0) * rate(degrees).powi(6)
        };
        assert!(left_m(50.0) < 1e-3 && left_m(55.0) > 4e-3 && left_m(65.0) > 0.2);
        assert!(rate(71.0) < 1.0 && rate(72.5) > 1.0, "{} {}", rate(71.0), rate(72.5));
        assert_eq!(rate(0.0), 0.0);
    }
}
