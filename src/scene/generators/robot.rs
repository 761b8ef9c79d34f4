//! A robot with joints.

use std::f64::consts::{FRAC_PI_2, TAU};

use glam::{DMat4, DVec3};

use crate::Mesh;
use crate::shapes::{
    block, cylinder, grounded, merged, moved, scaled, smooth_solid, sphere, torus,
};

/// Swing of the left leg forward and the right one back, of the right arm forward and the left one back, bend of the elbows, angle
/// of the arms away from the body, and turn of the head to its left, degrees.
const STRIDE: f64 = 22.0;
const SWING: f64 = 35.0;
const ELBOW: f64 = 55.0;
const SPREAD: f64 = 12.0;
const HEAD_TURN: f64 = 20.0;
/// Height when it stands upright, metres, and rings of a ball joint.
const HEIGHT: f64 = 1.8;
const ROWS: usize = 16;

/// Lengths below are shares of the height.
const HIP: DVec3 = DVec3::new(0.075, 0.5, 0.0);
const SHOULDER: DVec3 = DVec3::new(0.15, 0.77, 0.0);
const THIGH: f64 = 0.22;
const SHIN: f64 = 0.23;
const UPPER_ARM: f64 = 0.17;
const FOREARM: f64 = 0.15;

/// The knee that swings back bends by this much of the stride.
const KNEE: f64 = 1.2;

pub fn robot() -> Mesh {
    let [stride, swing, elbow, spread, angle] =
        [STRIDE, SWING, ELBOW, SPREAD, HEAD_TURN].map(f64::to_radians);
    let rows = ROWS;
    let mut mesh = merged([torso(rows), head(rows, angle)]);
    for side in [-1.0, 1.0] {
        let forward = side * stride;
        let hip = DMat4::from_translation(HIP * DVec3::new(side, 1.0, 1.0))
            * DMat4::from_rotation_x(-forward);
        let knee = KNEE * (-forward).max(0.0) + 0.1;
        mesh.append(&leg(rows, knee, forward).transformed(&hip));
        let shoulder = DMat4::from_translation(SHOULDER * DVec3::new(side, 1.0, 1.0))
            * DMat4::from_rotation_z(side * spread)
            * DMat4::from_rotation_x(side * swing);
        mesh.append(&arm(rows, elbow).transformed(&shoulder));
    }
    scaled(grounded(mesh), HEIGHT)
}

/// A round limb that hangs down from the origin.
fn limb(radius: f64, length: f64, rows: usize) -> Mesh {
    let r = radius;
    let knots = [
        (0.6 * r, -length),
        (r, -0.85 * length),
        (0.8 * r, -0.5 * length),
        (1.05 * r, -0.2 * length),
        (0.7 * r, 0.0),
    ];
    smooth_solid(&knots, 4, 2 * rows)
}

fn torso(rows: usize) -> Mesh {
    let knots = [(0.07, 0.5), (0.09, 0.53), (0.075, 0.6), (0.125, 0.7), (0.13, 0.77), (0.07, 0.83)];
    let flat = DMat4::from_scale(DVec3::new(1.0, 1.0, 0.72));
    let body = smooth_solid(&knots, 5, 3 * rows).transformed(&flat);
    let pack = moved(block(0.15, 0.15, 0.07), 0.0, 0.65, -0.11);
    let towards = DMat4::from_rotation_x(FRAC_PI_2);
    let lens = cylinder(0.035, 0.03, 2 * rows).transformed(&towards);
    let rim = torus(0.038, 0.008, 2 * rows, rows).transformed(&towards);
    let belt = torus(0.085, 0.014, 3 * rows, rows).transformed(&flat);
    merged([
        body,
        pack,
        moved(lens, 0.0, 0.73, 0.08),
        moved(rim, 0.0, 0.73, 0.11),
        moved(belt, 0.0, 0.54, 0.0),
    ])
}

fn head(rows: usize, angle: f64) -> Mesh {
    let neck = moved(cylinder(0.025, 0.06, 2 * rows), 0.0, 0.81, 0.0);
    let skull = moved(block(0.12, 0.1, 0.11), 0.0, 0.86, 0.0);
    let visor = moved(block(0.1, 0.03, 0.02), 0.0, 0.905, 0.055);
    let ears = [-1.0, 1.0].map(|side| {
        let across = DMat4::from_rotation_z(FRAC_PI_2);
        let disc = cylinder(0.025, 0.02, 2 * rows).transformed(&across);
        moved(disc, side * 0.06 + 0.01, 0.91, 0.0)
    });
    let antenna = moved(cylinder(0.004, 0.035, 8), 0.035, 0.955, -0.02);
    let bulb = moved(sphere(0.009, rows), 0.035, 0.991, -0.02);
    let rotated = [skull, visor, antenna, bulb].into_iter().chain(ears);
    merged([neck, merged(rotated).transformed(&DMat4::from_rotation_y(angle))])
}

/// Hangs down from the hip at the origin; the foot stays level.
fn leg(rows: usize, knee: f64, forward: f64) -> Mesh {
    let ankle =
        DMat4::from_translation(DVec3::NEG_Y * SHIN) * DMat4::from_rotation_x(forward - knee);
    let foot = merged([
        sphere(0.03, rows),
        moved(block(0.075, 0.03, 0.15), 0.0, -0.05, 0.03),
        moved(block(0.06, 0.025, 0.06), 0.0, -0.025, 0.0),
    ]);
    let lower = merged([sphere(0.042, rows), limb(0.042, SHIN, rows), foot.transformed(&ankle)]);
    let bent = DMat4::from_translation(DVec3::NEG_Y * THIGH) * DMat4::from_rotation_x(knee);
    merged([sphere(0.05, rows), limb(0.05, THIGH, rows), lower.transformed(&bent)])
}

/// Hangs down from the shoulder at the origin, with a hand of three fingers.
fn arm(rows: usize, elbow: f64) -> Mesh {
    let fingers = (0..3).map(|i| {
        let (sin, cos) = (TAU * f64::from(i) / 3.0).sin_cos();
        let finger = merged([
            limb(0.009, 0.045, rows / 2 + 2),
            moved(sphere(0.008, rows / 2 + 2), 0.0, -0.045, 0.0),
        ]);
        moved(finger, 0.018 * cos, -FOREARM - 0.02, 0.018 * sin)
    });
    let palm = moved(cylinder(0.028, 0.025, 2 * rows), 0.0, -FOREARM - 0.025, 0.0);
    let lower = [sphere(0.033, rows), limb(0.032, FOREARM, rows), palm];
    let lower = merged(lower.into_iter().chain(fingers));
    let bent = DMat4::from_translation(DVec3::NEG_Y * UPPER_ARM) * DMat4::from_rotation_x(-elbow);
    merged([sphere(0.045, rows), limb(0.036, UPPER_ARM, rows), lower.transformed(&bent)])
}
