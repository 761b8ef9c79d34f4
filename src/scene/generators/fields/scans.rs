//! What stands in for scanned objects: an engine block, a casting with bores and cooling channels and denser steel in it; and a
//! head as magnetic resonance shows it, with bright skin and brain, dark bone and liquid.

use glam::DVec3;

use super::super::{Args, SEED, param};
use super::distance::{cuboid, cylinder, ellipsoid, limb, share, without};
use super::{Field, FieldGenerator};
use crate::noise::fractal_noise;

pub const GENERATORS: &[FieldGenerator] = &[
    FieldGenerator {
        name: "engine_like",
        about: "a block with bores and steel sleeves of higher density, a stand-in for the engine scan",
        params: &[
            param("casting", 0.55, 0.0, 1.0, "density of the casting"),
            param("steel", 0.95, 0.0, 1.0, "density of sleeves, guides and bolts"),
            param("blur", 0.006, 1e-4, 0.1, "width of the borders, longest edge 1"),
        ],
        // Those of the scan, standing upright.
        cells: [256, 128, 256],
        build: engine,
    },
    FieldGenerator {
        name: "head_like",
        about: "layers of skin, bone, liquid and folded brain, a stand-in for the scanned head",
        params: &[
            param("folds", 9.0, 1.0, 64.0, "folds of the brain along the longest side"),
            param("blur", 0.01, 1e-4, 0.1, "width of the borders, longest edge 1"),
            SEED,
        ],
        // Those of the scan, standing upright.
        cells: [181, 181, 217],
        build: head,
    },
];

/// Half edges of the casting: it fills as much of its box as the scanned one.
const HALF: DVec3 = DVec3::new(0.28, 0.2, 0.38);

/// Distance of each of the two bores from the middle, along z.
const BORE_Z: f64 = 0.19;

fn engine(a: &Args) -> Field {
    let (casting, steel, width) = (a.get("casting"), a.get("steel"), a.get("blur"));
    Box::new(move |p| {
        let cast = share(self::casting(p), width);
        let hard = share(self::steel(p), width);
        hard * steel + (1.0 - hard) * cast * casting
    })
}

/// The block without its bores, cooling channels, ports and bolt holes, on a foot.
fn casting(p: DVec3) -> f64 {
    let foot = cuboid(p - DVec3::new(0.0, -0.185, 0.0), DVec3::new(0.36, 0.02, HALF.z));
    let mut block = cuboid(p, HALF).min(foot);
    let mirrored = DVec3::new(p.x, p.y, p.z.abs() - BORE_Z);
    let bore = cylinder(mirrored, 0.125, 1.0);
    let jacket = without(cylinder(mirrored, 0.18, 0.13), cylinder(mirrored, 0.15, 1.0));
    // Between the bores the jackets would meet.
    let jacket = jacket.max(0.01 - p.z.abs());
    let port = DVec3::new(mirrored.y - 0.08, mirrored.x - 0.2, mirrored.z);
    for hole in [bore, jacket, cylinder(port, 0.045, 0.1)] {
        block = without(block, hole);
    }
    let gallery = DVec3::new(p.x + 0.235, p.z, p.y + 0.1);
    block = without(block, cylinder(gallery, 0.02, 1.0));
    without(block, cylinder(bolt(p), 0.02, 0.15))
}

/// Sleeves in the bores, guides in the ports, bolts in every other hole.
fn steel(p: DVec3) -> f64 {
    let mirrored = DVec3::new(p.x, p.y, p.z.abs() - BORE_Z);
    let sleeve = without(cylinder(mirrored, 0.125, 0.2), cylinder(mirrored, 0.112, 1.0));
    let port = DVec3::new(mirrored.y - 0.08, mirrored.x - 0.28, mirrored.z);
    let guide = without(cylinder(port, 0.05, 0.02), cylinder(port, 0.035, 1.0));
    let bolts = cylinder(bolt(p), 0.016, 0.15).max(-p.z);
    sleeve.min(guide).min(bolts)
}

/// The point seen from the nearest of the four holes near the corners of the upper side.
fn bolt(p: DVec3) -> DVec3 {
    DVec3::new(p.x.abs() - 0.235, p.y - 0.12, p.z.abs() - 0.335)
}

/// Radii of the scalp; the layers below it are this much smaller.
const SCALP: DVec3 = DVec3::new(0.36, 0.38, 0.45);

fn head(a: &Args) -> Field {
    let (folds, width, seed) = (a.get("folds"), a.get("blur"), a.get("seed") as u32);
    Box::new(move |p| {
        let scalp = ellipsoid(p, SCALP).min(neck_and_nose(p));
        if scalp > width {
            return 0.0;
        }
        let skull = ellipsoid(p, SCALP - 0.03);
        let inner = ellipsoid(p, SCALP - 0.055);
        let fold = fractal_noise(p * folds, 2, seed).abs();
        let gyri = ellipsoid(p, SCALP - 0.07).max(0.03 - fold * 0.35 - 0.5 * (-inner).max(0.0));
        let beside = DVec3::new(p.x.abs() - 0.03, p.y - 0.03, p.z);
        let ventricle = ellipsoid(beside, DVec3::new(0.025, 0.05, 0.12));
        let brain = gyri.max(-ventricle);
        let soft = share(scalp, width) * (1.0 - share(skull, width));
        let marrow = share(inner, width) * (1.0 - share(brain, width));
        // Levels as in a T1 image: skin bright, bone dark, liquid dim, white matter brighter than the cortex.
        let white = share(ellipsoid(p, SCALP - 0.13), 0.06);
        0.55 * soft + 0.12 * marrow + share(brain, width) * (0.45 + 0.2 * white)
    })
}

/// The face looks to −z, as the scanned one does once it stands.
fn neck_and_nose(p: DVec3) -> f64 {
    let neck = [DVec3::new(0.0, -0.2, 0.05), DVec3::new(0.0, -0.6, 0.12)];
    let nose = [DVec3::new(0.0, -0.05, -0.43), DVec3::new(0.0, -0.15, -0.47)];
    limb(p, neck, [0.2, 0.18]).min(limb(p, nose, [0.02, 0.04]))
}
