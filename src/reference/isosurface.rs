//! Isosurfaces of fields whose shape is known: a ball and a slab, exactly.

use glam::DVec3;

use super::occlusion::{Attenuation, cosine_direction, tangent_frame};

/// A solid with an exact boundary.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Solid {
    Ball {
        centre: DVec3,
        radius_m: f64,
    },
    /// All below a height.
    Slab {
        top_m: f64,
    },
}

impl Solid {
    /// Distance to the boundary, positive outside, metres.
    pub fn distance(&self, p: DVec3) -> f64 {
        match self {
            Solid::Ball { centre, radius_m } => p.distance(*centre) - radius_m,
            Solid::Slab { top_m } => p.y - top_m,
        }
    }

    /// Unit normal at a point of the boundary.
    pub fn normal(&self, p: DVec3) -> DVec3 {
        match self {
            Solid::Ball { centre, .. } => (p - centre).normalize(),
            Solid::Slab { .. } => DVec3::Y,
        }
    }

    /// Distance at which a ray from outside enters.
    pub fn entry(&self, origin: DVec3, direction: DVec3) -> Option<f64> {
        match self {
            Solid::Ball { centre, radius_m } => {
                let to = centre - origin;
                let nearest = to.dot(direction);
                let square = radius_m * radius_m - (to.length_squared() - nearest * nearest);
                let distance = nearest - square.max(0.0).sqrt();
                (square > 0.0 && distance > 0.0).then_some(distance)
            }
            Solid::Slab { top_m } => {
                let distance = (top_m - origin.y) / direction.y;
                (direction.y < 0.0 && distance > 0.0).then_some(distance)
            }
        }
    }
}

/// The first of the solids along a ray, and where.
pub fn first(solids: &[Solid], origin: DVec3, direction: DVec3) -> Option<(&Solid, f64)> {
    solids
        .iter()
        .filter_map(|solid| Some((solid, solid.entry(origin, direction)?)))
        .min_by(|a, b| a.1.total_cmp(&b.1))
}

/// A of VAO Eq. 1 at a point of a solid's boundary, over a square grid of `side`² cosine-distributed rays.
pub fn occlusion(
    solids: &[Solid],
    position: DVec3,
    normal: DVec3,
    r_max_m: f64,
    attenuation: Attenuation,
    side: u32,
) -> f64 {
    let frame = tangent_frame(normal);
    // Clears the rounding of the position.
    let origin = position + normal * (1e-9 * r_max_m);
    let place = |i: u32| (f64::from(i) + 0.5) / f64::from(side);
    let sum: f64 = (0..side * side)
        .filter_map(|i| {
            let direction = frame * cosine_direction([place(i % side), place(i / side)]);
            first(solids, origin, direction)
        })
        .map(|(_, distance_m)| attenuation.at(distance_m / r_max_m))
        .sum();
    sum / f64::from(side * side)
}

#[cfg(test)]
mod tests {
    use super::*;

    const BALL: Solid = Solid::Ball { centre: DVec3::new(0.0, 2.0, 0.0), radius_m: 1.0 };
    const SLAB: Solid = Solid::Slab { top_m: 0.0 };

    #[test]
    fn rays_meet_the_nearer_solid() {
        let solids = [BALL, SLAB];
        let (solid, distance) = first(&solids, DVec3::Y * 5.0, DVec3::NEG_Y).unwrap();
        assert_eq!((*solid, distance), (BALL, 2.0));
        let (solid, distance) = first(&solids, DVec3::new(2.0, 5.0, 0.0), DVec3::NEG_Y).unwrap();
        assert_eq!((*solid, distance), (SLAB, 5.0));
        assert!(first(&solids, DVec3::Y * 5.0, DVec3::Y).is_none());
        assert_eq!(BALL.distance(DVec3::Y * 4.0), 1.0);
        assert_eq!(BALL.normal(DVec3::Y * 3.0), DVec3::Y);
    }

    /// A ball straight above a patch covers (radius / distance)² of its cosine-weighted hemisphere.
    #[test]
    fn a_ball_above_a_plane_covers_its_form_factor() {
        let at =
            |r_max| occlusion(&[BALL, SLAB], DVec3::ZERO, DVec3::Y, r_max, Attenuation::Hard, 256);
        assert!((at(4.0) - 0.25).abs() < 2e-3, "{}", at(4.0));
        assert_eq!(at(0.9), 0.0);
        let linear = occlusion(&[BALL, SLAB], DVec3::ZERO, DVec3::Y, 4.0, Attenuation::Linear, 256);
        assert!(linear > 0.25 * (1.0 - 1.75 / 4.0) && linear < 0.25 * (1.0 - 1.0 / 4.0));
    }
}
