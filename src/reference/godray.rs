//! Intensity along a godray from the water's surface to the hit (UW §3.4).

use glam::DVec3;

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
    /// World point at a share 0…1 of the way from entry to hit.
    pub fn point(&self, share: f64) -> DVec3 {
        self.entry.lerp(self.hit, share)
    }

    /// `I · p(θ) · exp(−γ d_viewer) · exp(−γ d_surface)` at a point of the ray (UW §3.4).
    ///
    /// d_surface is the distance along the ray from the entry. The scattering angle lies between the
    /// ray's direction and the direction from the point to the viewer.
    pub fn intensity(&self, point: DVec3, viewer: DVec3, medium: Medium) -> f64 {
        let direction = (self.hit - self.entry).normalize_or_zero();
        let to_viewer = viewer - point;
        let cos_alpha = direction.dot(to_viewer.normalize_or_zero());
        self.photon
            * phase_schlick(cos_alpha, medium.phase_k)
            * transmittance(medium.gamma_per_m, to_viewer.length())
            * transmittance(medium.gamma_per_m, (point - self.entry).dot(direction))
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    const RAY: Godray = Godray { entry: DVec3::ZERO, hit: DVec3::new(0.0, -4.0, 0.0), photon: 9.2 };

    #[test]
    fn seen_from_the_side_without_anisotropy() {
        let medium = Medium { gamma_per_m: 0.13, phase_k: 0.0 };
        for share in [0.0, 0.25, 1.0] {
            let p = RAY.point(share);
            let viewer = p + DVec3::new(3.0, 0.0, 0.0);
            let closed = 9.2 / (4.0 * PI) * (-0.13 * (3.0 + 4.0 * share)).exp();
            assert!((RAY.intensity(p, viewer, medium) - closed).abs() < 1e-14);
        }
    }

    #[test]
    fn looking_into_the_light_is_brighter_than_with_it() {
        let medium = Medium { gamma_per_m: 0.0, phase_k: 0.5 };
        let p = RAY.point(0.5);
        let into = RAY.intensity(p, p - DVec3::Y, medium);
        let with = RAY.intensity(p, p + DVec3::Y, medium);
        // ((1 + k) / (1 − k))² for Schlick's phase function.
        assert!((into / with - 9.0).abs() < 1e-12);
    }

    #[test]
    fn a_ray_without_length_is_finite() {
        let ray = Godray { hit: DVec3::ZERO, ..RAY };
        let medium = Medium { gamma_per_m: 0.1, phase_k: 0.5 };
        assert!(ray.intensity(DVec3::ZERO, DVec3::X, medium).is_finite());
    }
}
