//! A head as magnetic resonance shows it: bright skin and brain, dark bone and liquid.

use glam::DVec3;

use super::super::{Args, SEED, param};
use super::distance::{ellipsoid, limb, share};
use super::{Field, FieldGenerator};
use crate::noise::fractal_noise;

pub const GENERATORS: &[FieldGenerator] = &[FieldGenerator {
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
}];

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
