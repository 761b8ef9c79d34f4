//! Moving geometry in f64. Positions are the motions' definitions; normals come from how the motion carries two small steps
//! along the surface, not from a formula.

use glam::{DQuat, DVec3};

use std::f64::consts::TAU;

use fathom_scene::{Mesh, Motion};

/// Length of the steps relative to the object's height: the error of central differences is its square.
const STEP: f64 = 1e-5;

/// An object's motion at a moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moment {
    pub motion: Motion,
    /// Middle of the object's foot at rest, metres.
    pub foot_m: DVec3,
    /// Of the object at rest; 0 for a flat one, which only spins.
    pub height_m: f64,
    /// Time × frequency.
    pub cycles: f64,
    pub amplitude: f64,
}

impl Moment {
    pub fn new(rest: &Mesh, motion: Motion, cycles: f64, amplitude: f64) -> Self {
        let bounds = rest.bounds();
        let (foot_m, height_m) = (bounds.center().with_y(bounds.min.y), bounds.size().y);
        Self { motion, foot_m, height_m, cycles, amplitude }
    }
    /// Where a point of the surface goes, metres; `normal` has unit length.
    pub fn position(&self, rest_m: DVec3, normal: DVec3) -> DVec3 {
        let from_foot = rest_m - self.foot_m;
        let turned = |angle: f64| self.foot_m + DQuat::from_rotation_y(angle) * from_foot;
        let share = from_foot.y / self.height_m;
        match self.motion {
            Motion::Spin => turned(TAU * self.cycles),
            _ if self.height_m <= 0.0 => rest_m,
            Motion::Twist => turned(TAU * self.amplitude * share * (TAU * self.cycles).sin()),
            Motion::Wave => {
                let reach = self.amplitude * self.height_m;
                rest_m + normal * reach * (TAU * (share - self.cycles)).sin()
            }
        }
    }

    /// The unit normal there, for a surface that is flat around the point.
    pub fn normal(&self, rest_m: DVec3, normal: DVec3) -> DVec3 {
        let step = STEP * self.height_m.max(STEP);
        let along = normal.any_orthonormal_vector();
        let [u, v] = [along, normal.cross(along)].map(|tangent| {
            let at = |steps: f64| self.position(rest_m + tangent * (steps * step), normal);
            at(1.0) - at(-1.0)
        });
        u.cross(v).normalize()
    }
}
