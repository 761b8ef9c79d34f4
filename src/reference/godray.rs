//! Intensity along a godray from the water's surface to the hit (UW §3.4).

use glam::{DVec2, DVec3, DVec4};

use super::optics::{phase_schlick, transmittance};
use fathom_scene::clip_polygon;

/// A photon's path through the water.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Godray {
    /// Point of entry p_s.
    pub entry: DVec3,
    /// Hit p_i.
    pub hit: DVec3,
    pub photon: f64,
}

/// The medium that scatters and attenuates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Medium {
    /// γ, per metre.
    pub gamma_per_m: f64,
    /// k of Schlick's phase function.
    pub phase_k: f64,
}

impl Godray {
    /// `I · p(θ) · exp(−γ d_viewer) · exp(−γ d_surface)` at a point of the ray (UW §3.4).
    ///
    /// d_surface is the distance along the ray from the entry. The scattering angle lies between the
    /// ray's direction and the direction from the point to the viewer. UW's viewers are in the water; of the way to one above it only the
    /// part below y = 0 counts.
    pub fn intensity(&self, point: DVec3, viewer: DVec3, medium: Medium) -> f64 {
        let direction = (self.hit - self.entry).normalize_or_zero();
        let to_viewer = viewer - point;
        let wet = if viewer.y > 0.0 { (-point.y).max(0.0) / to_viewer.y } else { 1.0 };
        let cos_alpha = direction.dot(to_viewer.normalize_or_zero());
        self.photon
            * phase_schlick(cos_alpha, medium.phase_k)
            * transmittance(medium.gamma_per_m, to_viewer.length() * wet)
            * transmittance(medium.gamma_per_m, (point - self.entry).dot(direction))
    }
}

/// Area in pixels of a line of this width within an image, in pixels: what it covers, hidden or not.
pub fn covered_px([from, to]: [DVec2; 2], width_px: f64, size: DVec2) -> f64 {
    let Some(along) = (to - from).try_normalize() else {
        return 0.0;
    };
    let across = along.perp() * (0.5 * width_px);
    let corners = [from + across, to + across, to - across, from - across];
    let within = |axis: DVec4, side: f64| [axis, DVec4::W * side - axis];
    let borders = [within(DVec4::X, size.x), within(DVec4::Y, size.y)].concat();
    let corners = clip_polygon(corners.map(|p| p.extend(0.0)).into(), &borders);
    let next = corners.iter().cycle().skip(1);
    0.5 * corners.iter().zip(next).map(|(a, b)| a.cross(*b).z).sum::<f64>().abs()
}
