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

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use glam::UVec2;

    use super::*;

    /// Middles of pixels within a line, counted one by one.
    fn counted([from, to]: [DVec2; 2], width_px: f64, size: [u32; 2]) -> f64 {
        let (length, along) = (from.distance(to), (to - from).normalize());
        let covers = |(x, y): &(u32, u32)| {
            let offset = DVec2::new(f64::from(*x) + 0.5, f64::from(*y) + 0.5) - from;
            let start = offset.dot(along);
            (0.0..length).contains(&start) && offset.perp_dot(along).abs() < 0.5 * width_px
        };
        crate::image::pixels(size).filter(covers).count() as f64
    }

    #[test]
    fn covered_pixels_are_those_within_the_image() {
        let size = [120, 90];
        let cases = [
            ([[10.3, 20.1], [70.8, 60.2]], 7.0),
            ([[-30.0, 40.0], [60.0, 45.0]], 20.0),
            ([[-50.0, -40.0], [200.0, 160.0]], 12.0),
            ([[100.0, 5.0], [140.0, 120.0]], 9.0),
        ];
        for ([from, to], width_px) in cases {
            let line = [DVec2::from(from), DVec2::from(to)];
            let (area, count) = (
                covered_px(line, width_px, UVec2::from(size).as_dvec2()),
                counted(line, width_px, size),
            );
            assert!((area / count - 1.0).abs() < 0.02, "{line:?}: {area} against {count}");
        }
        let outside = [DVec2::new(-40.0, -40.0), DVec2::new(-10.0, 200.0)];
        let size = UVec2::from(size).as_dvec2();
        assert_eq!(covered_px(outside, 5.0, size), 0.0);
        assert_eq!(covered_px([DVec2::ONE; 2], 5.0, size), 0.0);
    }

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
    fn looking_into_the_light_is_brighter_than_with_it_and_no_length_is_finite() {
        let medium = Medium { gamma_per_m: 0.0, phase_k: 0.5 };
        let p = RAY.point(0.5);
        let into = RAY.intensity(p, p - DVec3::Y, medium);
        let with = RAY.intensity(p, p + DVec3::Y, medium);
        // ((1 + k) / (1 − k))² for Schlick's phase function.
        assert!((into / with - 9.0).abs() < 1e-12);
        let point = Godray { hit: DVec3::ZERO, ..RAY };
        assert!(point.intensity(DVec3::ZERO, DVec3::X, medium).is_finite());
    }
}
