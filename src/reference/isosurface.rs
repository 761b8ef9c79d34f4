//! Isosurfaces of any field, by marching it finely.

use glam::DVec3;

use super::bisected;
use super::media::interpolated;
use super::occlusion::{Obscurity, over_hemisphere};
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
    pub fn entry(&self, origin: DVec3, direction: DVec3, max_m: f64) -> Option<f64> {
        let step_m = self.edge_m() / STEPS_PER_CELL;
        let at = |d: f64| origin + direction * d;
        let steps = (max_m / step_m).ceil() as u32;
        let k = (0..=steps).find(|&k| self.inside(at((f64::from(k) * step_m).min(max_m))))?;
        let high = (f64::from(k) * step_m).min(max_m);
        let low = (high - step_m).max(0.0);
        Some(bisected([low, high], HALVINGS, |d| self.inside(at(d)))[1])
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
