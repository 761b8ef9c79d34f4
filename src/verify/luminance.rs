//! `post/luminance` against sums in f64.

use crate::prelude::*;
use fathom_stages::post::luminance::{self, INFO};

/// Pictures of fewer texels than a workgroup sums, of some, and of many workgroups with a rest.
const SIZES: [[u32; 2]; 3] = [[7, 5], [33, 31], [301, 203]];
/// Sums of tens of thousands of logarithms in f32, each known to 3e-7 of about 2: relative to the average.
const TOLERANCE: f64 = 2e-5;
/// As in the shader.
const LEAST: f64 = 1e-4;

pub fn cases() -> Vec<Case> {
    let what = |[width, height]: [u32; 2]| format!("noise of {width}×{height}");
    Case::each(INFO.name, SIZES, what, check).collect()
}

fn check(rig: &Rig<'_>, size: [u32; 2]) -> Result<Check> {
    let picture = noise(size, 5);
    let stage = luminance::new(rig, &rig.grey(&picture))?;
    rig.run(&[&stage])?;
    let average = f64::from(rig.read::<f32>(&stage)?[0]);
    // Of a picture whose red channel alone is not 0.
    let exact = |least: f64| {
        let log = |shown: &f64| (least + 0.2126 * shown.powf(DISPLAY_GAMMA)).ln();
        mean(picture.data().iter().map(log)).exp()
    };
    let [width, height] = size;
    Ok(Check::of(rig, format!("{width}×{height}: relative error of the average"))
        .within((TOLERANCE, "1"), relative_error(average, exact(LEAST)))
        .control(
            "twice as much added to each luminance",
            relative_error(average, exact(2.0 * LEAST)),
        ))
}
