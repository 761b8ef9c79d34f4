//! A small tree in a pot.

use std::f64::consts::TAU;

use glam::DVec3;

use super::super::Dice;
use super::distance::{cylinder, ellipsoid, limb, share, without};
use super::{FieldFn, FieldGenerator};
use crate::noise::fractal_noise;

pub const GENERATORS: &[FieldGenerator] = &[FieldGenerator {
    name: "bonsai",
    about: "a bonsai tree: dense pot and wood, thin leaves, VAO Fig. 7d",
    // Those of the data set that the paper shows.
    cells: [256, 256, 256],
    build: bonsai,
}];

/// Number of branches; opacity of the pot, of trunk and branches, and of the thickest leaves.
const BRANCHES: u32 = 9;
const POT: f64 = 0.6;
const WOOD: f64 = 0.85;
const LEAVES: f64 = 0.4;
/// Width of the borders, longest edge 1.
const BLUR: f64 = 0.008;
const SEED: u32 = 1;

/// A limb of the tree and its radii at both ends.
struct Limb {
    ends: [DVec3; 2],
    radii: [f64; 2],
}

/// Leaves about a point.
struct Cluster {
    middle: DVec3,
    radii: DVec3,
}

fn bonsai() -> FieldFn {
    let (limbs, clusters) = grow();
    Box::new(move |p| {
        let vessel = POT * share(vessel(p), BLUR);
        let soil = 0.5 * POT * share(cylinder(p - DVec3::Y * -0.36, 0.24, 0.025), BLUR);
        let bark = limbs.iter().map(|l| limb(p, l.ends, l.radii));
        let bark = WOOD * share(bark.fold(f64::INFINITY, f64::min), BLUR);
        vessel.max(soil).max(bark).max(LEAVES * foliage(&clusters, p))
    })
}

/// A shallow round pot on the ground of the box.
fn vessel(p: DVec3) -> f64 {
    let q = p - DVec3::Y * -0.41;
    let hollow = cylinder(q - DVec3::Y * 0.05, 0.25, 0.08);
    let rim = without(cylinder(q - DVec3::Y * 0.075, 0.3, 0.015), cylinder(q, 0.25, 1.0));
    without(cylinder(q, 0.27, 0.09), hollow).min(rim)
}

/// A trunk that winds upward, and branches around it, each with leaves at its end.
fn grow() -> (Vec<Limb>, Vec<Cluster>) {
    let mut dice = Dice::new(SEED);
    let start_angle = dice.between(0.0, TAU);
    let sway = |t: f64| {
        let (sin, cos) = (start_angle + 4.0 * t).sin_cos();
        DVec3::new(0.09 * t * cos, -0.36 + 0.66 * t, 0.09 * t * sin)
    };
    let radius = |t: f64| 0.05 * (1.0 - 0.8 * t);
    let segments = 8;
    let at = |i: i32| f64::from(i) / f64::from(segments);
    let mut limbs: Vec<Limb> = (0..segments)
        .map(|i| [at(i), at(i + 1)])
        .map(|ends| Limb { ends: ends.map(sway), radii: ends.map(radius) })
        .collect();
    let mut clusters =
        vec![Cluster { middle: sway(1.0) + DVec3::Y * 0.04, radii: DVec3::new(0.17, 0.1, 0.17) }];
    for i in (0..BRANCHES).map(f64::from) {
        let t = 0.4 + 0.5 * (i + 0.5) / f64::from(BRANCHES);
        let angle = start_angle + 2.4 * i + dice.between(-0.3, 0.3);
        let reach = (0.36 - 0.2 * t) * dice.between(0.8, 1.1);
        let tip = sway(t) + DVec3::new(reach * angle.cos(), 0.3 * reach, reach * angle.sin());
        let bend = sway(t).lerp(tip, 0.5) - DVec3::Y * (0.12 * reach);
        let thick = 0.45 * radius(t);
        limbs.push(Limb { ends: [sway(t), bend], radii: [thick, 0.8 * thick] });
        limbs.push(Limb { ends: [bend, tip], radii: [0.8 * thick, 0.4 * thick] });
        let spread = dice.between(0.11, 0.15);
        let radii = DVec3::new(spread, 0.5 * spread, spread);
        clusters.push(Cluster { middle: tip + DVec3::Y * 0.02, radii });
    }
    (limbs, clusters)
}

/// Leaves: noise in each cluster, thinner towards its border.
fn foliage(clusters: &[Cluster], p: DVec3) -> f64 {
    let inside = clusters.iter().map(|c| ellipsoid(p - c.middle, c.radii));
    let depth = -inside.fold(f64::INFINITY, f64::min);
    if depth <= 0.0 {
        return 0.0;
    }
    let speckle = 0.5 + 1.5 * fractal_noise(p * 28.0, 2, SEED);
    (depth / 0.03).min(1.0) * speckle.clamp(0.0, 1.0)
}
