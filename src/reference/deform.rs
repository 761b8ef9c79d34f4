//! Moving geometry in f64. Positions are the motions' definitions; normals come from how the motion carries two small steps
//! along the surface, not from a formula.

use glam::{DQuat, DVec3};

use std::f64::consts::TAU;

use fathom_scene::Mesh;

/// Length of the steps relative to the object's height: the error of central differences is its square.
const STEP: f64 = 1e-5;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Motion {
    /// Turns about the vertical axis through the foot.
    Spin,
    /// Swings about it, the top by `amplitude` turns.
    Twist,
    /// Moves along the normal by `amplitude` of the height, one wave over the height.
    Wave,
}

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
    /// Of an object with this mesh at rest.
    pub fn of(rest: &Mesh, motion: Motion, cycles: f64, amplitude: f64) -> Self {
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

#[cfg(test)]
mod tests {
    use super::*;

    fn moment(motion: Motion, cycles: f64) -> Moment {
        let foot_m = DVec3::new(1.0, -2.0, 3.0);
        Moment { motion, foot_m, height_m: 2.0, cycles, amplitude: 0.25 }
    }

    #[test]
    fn a_quarter_turn_takes_x_to_minus_z() {
        let at = DVec3::new(2.0, 0.0, 3.0);
        // Also the top of a twist at its widest, by the amplitude of a quarter turn.
        for motion in [Motion::Spin, Motion::Twist] {
            let place = moment(motion, 0.25).position(at, DVec3::X);
            assert!(place.abs_diff_eq(DVec3::new(1.0, 0.0, 2.0), 1e-12), "{motion:?}");
        }
        let normal = moment(Motion::Spin, 0.25).normal(at, DVec3::X);
        assert!(normal.abs_diff_eq(-DVec3::Z, 1e-8));
    }

    #[test]
    fn a_wave_tilts_the_normal_of_a_wall_against_its_slope() {
        let wave = moment(Motion::Wave, 0.0);
        // At a quarter of the height the displacement is at its largest, and the wall is upright.
        let crest = wave.position(DVec3::new(1.0, -1.5, 3.0), DVec3::X);
        assert!(crest.abs_diff_eq(DVec3::new(1.5, -1.5, 3.0), 1e-12));
        let upright = wave.normal(DVec3::new(1.0, -1.5, 3.0), DVec3::X);
        assert!(upright.abs_diff_eq(DVec3::X, 1e-8));
        // At the foot the wall leans outward: its normal looks down.
        let foot = wave.normal(DVec3::new(1.0, -2.0, 3.0), DVec3::X);
        let slope = TAU * 0.25;
        assert!(foot.abs_diff_eq(DVec3::new(1.0, -slope, 0.0).normalize(), 1e-8));
    }
}
