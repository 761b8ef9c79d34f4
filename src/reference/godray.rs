//! Intensity along a godray from the water's surface to the hit (UW §3.4).

use glam::{DVec2, DVec3};

use super::optics::{phase_schlick, transmittance};

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
    let mut corners = vec![from + across, to + across, to - across, from - across];
    // Sutherland and Hodgman, Reentrant Polygon Clipping, 1974: at the four borders of the image.
    for (normal, place) in
        [(DVec2::X, 0.0), (DVec2::NEG_X, -size.x), (DVec2::Y, 0.0), (DVec2::NEG_Y, -size.y)]
    {
        let inside = |p: DVec2| p.dot(normal) - place;
        let next = corners.iter().cycle().skip(1);
        let pairs = corners.iter().zip(next).flat_map(|(&a, &b)| {
            let (da, db) = (inside(a), inside(b));
            let crossing = ((da < 0.0) != (db < 0.0)).then(|| a.lerp(b, da / (da - db)));
            (da >= 0.0).then_some(a).into_iter().chain(crossing)
        });
        corners = pairs.collect();
    }
    let next = corners.iter().cycle().skip(1);
    0.5 * corners.iter().zip(next).map(|(a, b)| a.perp_dot(*b)).sum::<f64>().abs()
}
