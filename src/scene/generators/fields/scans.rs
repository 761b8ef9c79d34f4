//! What stands in for a scanned engine block: a casting with bores and cooling channels and denser steel in it.

use glam::DVec3;

use super::distance::{cuboid, cylinder, share, without};
use super::{FieldFn, FieldGenerator};

pub const GENERATORS: &[FieldGenerator] = &[FieldGenerator {
    name: "engine_like",
    about: "a block with bores and steel sleeves of higher density, a stand-in for the engine scan",
    // Those of the scan, standing upright.
    cells: [256, 128, 256],
    build: engine,
}];

/// Density of the casting, and of sleeves, guides and bolts.
const CASTING: f64 = 0.55;
const STEEL: f64 = 0.95;
/// Width of the borders, longest edge 1.
const BLUR: f64 = 0.006;

/// Half edges of the casting: it fills as much of its box as the scanned one.
const HALF: DVec3 = DVec3::new(0.28, 0.2, 0.38);

/// Distance of each of the two bores from the middle, along z.
const BORE_Z: f64 = 0.19;

fn engine() -> FieldFn {
    Box::new(|p| {
        let cast = share(casting(p), BLUR);
        let hard = share(steel(p), BLUR);
        hard * STEEL + (1.0 - hard) * cast * CASTING
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
