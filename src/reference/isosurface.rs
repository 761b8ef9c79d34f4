//! Isosurfaces: of any field by marching it finely, and of fields whose shape is known, a ball and a slab, exactly.

use glam::DVec3;

use super::bisected;
use super::media::interpolated;
use super::occlusion::{Obscurity, cosine_direction, over_hemisphere, tangent_frame};
use fathom_scene::Volume;

/// Where the values of a field, interpolated trilinearly, reach one from outside.
pub struct FieldSurface<'a> {
    pub field: &'a Volume,
    pub iso: f64,
}

/// Steps of a march along a cell's shortest edge.
const STEPS_PER_CELL: f64 = 2.0;
/// Halvings of the step that holds a crossing.
const HALVINGS: u32 = 24;
/// How far along the normal rays begin, share of a cell's shortest edge: rounding and the bumps of interpolated values.
const CLEAR: f64 = 0.1;

impl FieldSurface<'_> {
    fn inside(&self, p: DVec3) -> bool {
        interpolated(self.field, p) >= self.iso
    }

    fn edge_m(&self) -> f64 {
        self.field.spacing_m.min_element()
    }

    /// Distance at which a ray first comes to the value; 0 where it begins within.
    fn entry(&self, origin: DVec3, direction: DVec3, most_m: f64) -> Option<f64> {
        let step_m = self.edge_m() / STEPS_PER_CELL;
        let at = |d: f64| origin + direction * d;
        let steps = (most_m / step_m).ceil() as u32;
        let k = (0..=steps).find(|&k| self.inside(at((f64::from(k) * step_m).min(most_m))))?;
        let high = (f64::from(k) * step_m).min(most_m);
        let low = (high - step_m).max(0.0);
        Some(bisected([low, high], HALVINGS, |d| self.inside(at(d)))[1])
    }

    /// The first point of the surface on a ray from outside.
    pub fn first_hit(&self, origin: DVec3, direction: DVec3, most_m: f64) -> Option<DVec3> {
        let distance_m = self.entry(origin, direction, most_m)?;
        (distance_m > 0.0).then(|| origin + direction * distance_m)
    }

    /// Unit vector down the gradient, by central differences over two cells; none where the field is flat.
    pub fn normal(&self, p: DVec3) -> Option<DVec3> {
        let slope = |axis: DVec3| {
            let step = axis.dot(self.field.spacing_m);
            let [ahead, behind] =
                [1.0, -1.0].map(|s| interpolated(self.field, p + axis * step * s));
            (ahead - behind) / (2.0 * step)
        };
        (-DVec3::new(slope(DVec3::X), slope(DVec3::Y), slope(DVec3::Z))).try_normalize()
    }

    /// A of VAO Eq. 1 at a point of the surface by `rays` cosine-distributed low-discrepancy rays; none where the gradient does
    /// not lead outside.
    pub fn occlusion(
        &self,
        p: DVec3,
        r_max_m: f64,
        attenuation: Obscurity,
        rays: u32,
    ) -> Option<f64> {
        let normal = self.normal(p)?;
        let origin = p + normal * (CLEAR * self.edge_m());
        if self.inside(origin) {
            return None;
        }
        Some(over_hemisphere(normal, rays, |direction| {
            Some(attenuation.value_at(self.entry(origin, direction, r_max_m)? / r_max_m))
        }))
    }
}

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
    attenuation: Obscurity,
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
        .map(|(_, distance_m)| attenuation.value_at(distance_m / r_max_m))
        .sum();
    sum / f64::from(side * side)
}
