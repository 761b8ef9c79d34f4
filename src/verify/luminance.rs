//! `post/luminance` against sums in f64.

use super::{Case, Check, Result, Rig, noise};
use fathom_reference::image::Image;
use fathom_stages::post::luminance::{self, INFO};

/// Pictures of fewer texels than a workgroup sums, of some, and of many workgroups with a rest.
const SIZES: [[u32; 2]; 3] = [[7, 5], [33, 31], [301, 203]];
/// Sums of tens of thousands of logarithms in f32, each known to 3e-7 of about 2: relative to the average.
const TOLERANCE: f64 = 2e-5;
/// As in the shader.
const LEAST: f64 = 1e-4;

pub fn cases() -> Vec<Case> {
    let case = |[width, height]: [u32; 2]| {
        let what = format!("noise of {width}×{height}");
        Case::new(INFO.name, what, move |rig| check(rig, [width, height]))
    };
    SIZES.map(case).into()
}

fn check(rig: &Rig<'_>, size: [u32; 2]) -> Result<Check> {
    let picture = noise(size, 5);
    let stage = luminance::new(&rig.resources, &rig.grey(&picture))?;
    rig.run(&[&stage])?;
    let average = f64::from(rig.read::<f32>(&stage)?[0]);
    let error = |least: f64| (average / log_average(&picture, least) - 1.0).abs();
    let [width, height] = size;
    Ok(Check::of(INFO.name, format!("{width}×{height}: relative error of the average"))
        .within((TOLERANCE, "1"), error(LEAST))
        .control("twice as much added to each luminance", error(2.0 * LEAST)))
}

/// Of a picture whose red channel alone is not 0.
fn log_average(picture: &Image, least: f64) -> f64 {
    let logs = picture.data().iter().map(|shown| (least + 0.2126 * shown.powf(2.2)).ln());
    (logs.sum::<f64>() / picture.data().len() as f64).exp()
}
