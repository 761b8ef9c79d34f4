//! `caustics/filter` and `godrays/filter` against the f64 twin.

use super::{Case, Check, Result, Rig, noise};
use crate::gpu::{Column, StageInfo};
use crate::reference::filter::Disc;
use crate::reference::image::{Image, pixels};
use crate::stages::low_pass::{FilterUniforms, LowPass};
use crate::stages::{caustics, godrays};

const SIZE: [u32; 2] = [96, 64];
const TAPS: u32 = 16;
const RADIUS_PX: f64 = 3.0;
/// Pixels with a tap this near to a texel's edge are left out: in f32 it may fall on the other side.
/// WGSL bounds the error of sine and cosine by 2⁻¹¹; at this radius that is 0.0015 px.
const AMBIGUOUS_PX: f64 = 2e-3;
/// Largest difference relative to the image's mean: f32 sums of 16 taps.
const TOLERANCE: f64 = 1e-5;

pub fn cases() -> Vec<Case> {
    let case = |info: &'static StageInfo| {
        Case::new(info.name, "noise through the low-pass", move |rig| check(info, rig))
    };
    [&caustics::filter::INFO, &godrays::filter::INFO].map(case).into()
}

fn check(info: &'static StageInfo, rig: &Rig<'_>) -> Result<Check> {
    let image = noise(SIZE, 7);
    let settings = FilterUniforms { taps: TAPS, radius_px: RADIUS_PX as f32 };
    let source = (&rig.grey(&image), Column::new("noise", "1", "noise"));
    let filter = LowPass::new(&rig.resources, info, source, &settings)?;
    rig.run(&[&filter])?;
    let filtered = rig.channel(filter.texture(), 0)?;

    let disc = Disc::vogel(TAPS, RADIUS_PX);
    let mut moved = disc.clone();
    moved.taps[0][0] += 1.0;
    let (measured, left_out) = largest_difference(&filtered, &image, &disc, &disc);
    let (control, _) = largest_difference(&filtered, &image, &moved, &disc);
    let sums = (filtered.sum() / image.sum() - 1.0).abs();
    let check = Check::of(info.name, "largest difference from the f64 twin, of the mean")
        .within((TOLERANCE, "1"), measured)
        .control("one tap moved by a pixel", control);
    Ok(check.with("pixels_left_out_share", left_out).with("energy_change", sums))
}

/// Largest difference between the GPU's result and `twin` over the pixels where `judge` has no
/// ambiguous tap, relative to the mean, and the share of the pixels left out.
fn largest_difference(gpu: &Image, source: &Image, twin: &Disc, judge: &Disc) -> (f64, f64) {
    let mean = source.mean();
    let (mut largest, mut left_out) = (0.0f64, 0);
    for (x, y) in pixels(gpu.size()) {
        if judge.edge_distance(x, y) < AMBIGUOUS_PX {
            left_out += 1;
            continue;
        }
        let difference = gpu.clamped(x.into(), y.into()) - twin.at(source, x, y);
        largest = largest.max(difference.abs() / mean);
    }
    (largest, f64::from(left_out) / source.data().len() as f64)
}
