//! A bottlenose dolphin.

use std::f64::consts::TAU;

use fathom_base::settings;
use glam::{DMat4, DVec3, DVec4};

use crate::Mesh;
use crate::shapes::{merged, moved, scaled, smooth_path, sphere, surface};

settings! {
    pub struct Dolphin {
        /// Length along its back when it is straight.
        length_m: f64 = 2.4 => 0.05 ..= 100.0, "m";
        /// Angle between snout and tail: leaping where positive, diving where negative.
        bend_deg: f64 = 40.0 => -120.0 ..= 120.0, "°";
    }
}

/// Sections of the body of a bottlenose dolphin, tuned by eye: distance from the snout, upper and lower edge against the straight
/// axis, half the width. Lengths are shares of the dolphin's.
const SECTIONS: [[f64; 4]; 19] = [
    [0.0, -0.018, -0.026, 0.004],
    [0.006, -0.014, -0.031, 0.011],
    [0.03, -0.008, -0.036, 0.017],
    [0.06, -0.003, -0.041, 0.021],
    [0.082, 0.003, -0.045, 0.026],
    [0.094, 0.02, -0.048, 0.034],
    [0.115, 0.038, -0.053, 0.046],
    [0.15, 0.053, -0.063, 0.06],
    [0.2, 0.066, -0.076, 0.074],
    [0.28, 0.08, -0.091, 0.088],
    [0.36, 0.088, -0.098, 0.095],
    [0.44, 0.09, -0.098, 0.095],
    [0.54, 0.084, -0.088, 0.085],
    [0.64, 0.069, -0.068, 0.067],
    [0.74, 0.05, -0.046, 0.045],
    [0.84, 0.034, -0.028, 0.025],
    [0.91, 0.025, -0.02, 0.014],
    [0.96, 0.017, -0.014, 0.01],
    [0.985, 0.009, -0.008, 0.007],
];

/// The sections of a fin from root to tip: leading edge, trailing edge and half the thickness. x is 0.5 at the snout.
type Fin = [([f64; 3], [f64; 3], f64); 5];

const DORSAL: Fin = [
    ([0.04, 0.07, 0.0], [-0.11, 0.065, 0.0], 0.012),
    ([0.012, 0.105, 0.0], [-0.103, 0.096, 0.0], 0.01),
    ([-0.03, 0.14, 0.0], [-0.108, 0.126, 0.0], 0.007),
    ([-0.074, 0.167, 0.0], [-0.124, 0.154, 0.0], 0.004),
    ([-0.122, 0.18, 0.0], [-0.136, 0.174, 0.0], 0.0015),
];

/// The fins on the side +z.
const FLIPPER: Fin = [
    ([0.265, -0.05, 0.06], [0.19, -0.058, 0.06], 0.012),
    ([0.25, -0.078, 0.095], [0.178, -0.078, 0.09], 0.01),
    ([0.22, -0.105, 0.13], [0.155, -0.102, 0.12], 0.007),
    ([0.18, -0.126, 0.155], [0.132, -0.122, 0.146], 0.004),
    ([0.132, -0.14, 0.168], [0.12, -0.139, 0.165], 0.0015),
];
const FLUKE: Fin = [
    ([-0.4, 0.0, 0.0], [-0.488, 0.0, 0.0], 0.011),
    ([-0.424, 0.0, 0.035], [-0.503, 0.0, 0.035], 0.009),
    ([-0.453, 0.0, 0.075], [-0.508, 0.0, 0.075], 0.006),
    ([-0.483, 0.0, 0.11], [-0.52, 0.0, 0.11], 0.004),
    ([-0.527, 0.0, 0.14], [-0.535, 0.0, 0.138], 0.0015),
];

/// Quads from section to section of the body, and around it; the same of a fin.
const BODY_STEPS: usize = 8;
const BODY_SIDES: usize = 32;
const FIN_STEPS: usize = 4;
const FIN_SIDES: usize = 16;

/// Place and radius of the right eye.
const EYE: (DVec3, f64) = (DVec3::new(0.362, -0.014, 0.056), 0.009);

pub fn dolphin(a: &Dolphin) -> Mesh {
    let sides = [1.0, -1.0];
    let fins = [&FLIPPER, &FLUKE].map(fin);
    let pairs = fins.iter().flat_map(|fin| {
        sides.map(|side| fin.clone().transformed(&DMat4::from_scale(DVec3::new(1.0, 1.0, side))))
    });
    let (eye, radius) = EYE;
    let eyes = sides.map(|side| moved(sphere(radius, 8), eye.x, eye.y, side * eye.z));
    let straight = [body(), fin(&DORSAL)];
    let whole = merged(straight.into_iter().chain(pairs).chain(eyes));
    scaled(bent(whole, a.bend_deg.to_radians()), a.length_m)
}

/// Ellipses through the sections, drawn together at both ends.
fn body() -> Mesh {
    let rings = smooth_path(&SECTIONS.map(DVec4::from), BODY_STEPS);
    let rows = rings.len() + 1;
    surface((BODY_SIDES, rows), (true, false), |u, v| {
        let row = (v * rows as f64).round() as usize;
        let is_end = row == 0 || row == rows;
        let [t, upper, lower, width] = rings[row.saturating_sub(1).min(rings.len() - 1)].to_array();
        let (sin, cos) = if is_end { (0.0, 0.0) } else { (TAU * u).sin_cos() };
        let (middle, half) = (0.5 * (upper + lower), 0.5 * (upper - lower));
        DVec3::new(0.5 - t, middle + half * cos, -width * sin)
    })
}

/// A closed fin, drawn together at its root, within the body, and at its tip.
fn fin(sections: &Fin) -> Mesh {
    let leading = smooth_path(&sections.map(|(p, ..)| DVec3::from(p)), FIN_STEPS);
    let trailing = smooth_path(&sections.map(|(_, p, _)| DVec3::from(p)), FIN_STEPS);
    let thickness = smooth_path(&sections.map(|(.., t)| t), FIN_STEPS);
    let last = leading.len() - 1;
    let rows = last + 2;
    let side = (leading[last] - leading[0]).cross(leading[0] - trailing[0]).normalize();
    surface((FIN_SIDES, rows), (true, false), |u, v| {
        let row = (v * rows as f64).round() as usize;
        let i = row.saturating_sub(1).min(last);
        let middle = 0.5 * (leading[i] + trailing[i]);
        if row == 0 || row == rows {
            return middle;
        }
        let (sin, cos) = (TAU * u).sin_cos();
        // Thickest before the middle, thin towards the trailing edge.
        let across = thickness[i] * sin * (0.65 + 0.35 * cos);
        middle + 0.5 * cos * (leading[i] - trailing[i]) + across * side
    })
}

/// The straight dolphin on an arc of this angle for a length of 1.
fn bent(mut mesh: Mesh, angle: f64) -> Mesh {
    // Below this the arc is straight to the last bit of f32.
    if angle.abs() < 1e-6 {
        return mesh;
    }
    for p in &mut mesh.positions {
        let [x, y, z] = p.map(f64::from);
        let (sin, cos) = (angle * x).sin_cos();
        let radius = y + 1.0 / angle;
        *p = DVec3::new(radius * sin, radius * cos - 1.0 / angle, z).as_vec3().to_array();
    }
    mesh.recompute_normals();
    mesh
}
