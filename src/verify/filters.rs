//! `caustics/filter` and `godrays/filter` against the f64 twin.

use super::{Case, Check, Result, Rig, largest, noise, rig};
use fathom_gpu::{Column, Stage, StageInfo};
use fathom_reference::filter::Disc;
use fathom_reference::image::{Image, pixels};
use fathom_reference::plane::CameraDepth;
use fathom_scene::Scene;
use fathom_stages::frame::{Shared, View};
use fathom_stages::low_pass::{self, FilterUniforms, GuidedUniforms};
use fathom_stages::splatting::Sums;
use fathom_stages::{caustics, godrays};

const SIZE: [u32; 2] = [96, 64];
/// Of the camera's depth: the buffer's pixels lie at no whole multiple of its texels.
const VIEW: [u32; 2] = [150, 100];
const SEED: u32 = 7;
const TAPS: u32 = 16;
/// Default of `caustics.filter_depth_share`.
const DEPTH_SHARE: f64 = 0.05;
/// Pixels with a tap this near to the bound are left out: a view depth of 10 m in f32 is known to a few parts in 10⁵.
const AMBIGUOUS_SHARE: f64 = 2e-4;
const RADIUS_PX: f64 = 3.0;
/// Pixels with a tap this near to a texel's edge are left out: in f32 it may fall on the other side.
/// WGSL bounds the error of sine and cosine by 2⁻¹¹; at this radius that is 0.0015 px.
const AMBIGUOUS_PX: f64 = 2e-3;
/// Largest difference relative to the image's mean: f32 sums of 16 taps.
const TOLERANCE: f64 = 1e-5;

pub fn cases() -> Vec<Case> {
    vec![
        Case::new(caustics::filter::INFO.name, "noise through the low-pass", |rig| {
            // One surface only: all taps count.
            let depth = rig.depth(SIZE, 0.9)?;
            let view = rig::synthetic_view(SIZE, 0.0)?;
            plain(&caustics::filter::INFO, rig, &caustics_filter(rig, &view, &depth)?)
        }),
        Case::new(caustics::filter::INFO.name, "edges of surfaces", edges),
        Case::new(godrays::filter::INFO.name, "noise through the low-pass", |rig| {
            let settings = FilterUniforms { taps: TAPS, radius_px: RADIUS_PX as f32 };
            let info = &godrays::filter::INFO;
            let image = rig.grey(&noise(SIZE, SEED));
            let source = Sums { texture: image, column: Column::new("noise", "1", "noise") };
            let filter = low_pass::new(&rig.resources, info, &source, &settings)?;
            plain(info, rig, &filter)
        }),
    ]
}

/// `caustics/filter` over noise, guided by a depth.
fn caustics_filter(
    rig: &Rig<'_>,
    view: &View,
    depth: &wgpu::Texture,
) -> Result<Stage<wgpu::Texture>> {
    let shared = Shared::new(&rig.resources, view);
    let settings =
        GuidedUniforms { taps: TAPS, radius_px: RADIUS_PX as f32, depth_share: DEPTH_SHARE as f32 };
    let image = rig.grey(&noise(SIZE, SEED));
    let source = Sums { texture: image, column: Column::new("noise", "1", "noise") };
    let info = &caustics::filter::INFO;
    Ok(low_pass::guided(&rig.resources, info, &source, (&shared, depth), &settings)?)
}

/// Noise over a scene with many edges: taps beyond them do not count.
fn edges(rig: &Rig<'_>) -> Result<Check> {
    let stage = caustics::filter::INFO.name;
    let scene = Scene::load("tank")?;
    let stand = rig.stand(&scene, VIEW);
    let drawn = rig.gbuffer(&stand)?;
    let filter = caustics_filter(rig, &stand.view, &drawn.depth)?;
    rig.run(&[&filter])?;
    let (filtered, image) = (rig.channel(filter.texture(), 0)?, noise(SIZE, SEED));
    let depth = rig.channel(&drawn.depth, 0)?;
    let seen = CameraDepth { depth: &depth, camera: &stand.view.camera };

    let disc = Disc::vogel(TAPS, RADIUS_PX);
    let guide = (&seen, DEPTH_SHARE);
    let plain = |x, y| {
        disc.edge_distance(x, y) >= AMBIGUOUS_PX
            && disc.decision_distance(&image, guide, x, y) >= AMBIGUOUS_SHARE
    };
    let judged: Vec<(u32, u32)> = pixels(SIZE).filter(|(x, y)| plain(*x, *y)).collect();
    let error = |share: f64| {
        let off = |(x, y): &(u32, u32)| {
            let twin = disc.within_surface(&image, (&seen, share), *x, *y);
            (filtered.clamped((*x).into(), (*y).into()) - twin).abs() / image.mean()
        };
        largest(judged.iter().map(off))
    };
    let left_out = 1.0 - judged.len() as f64 / image.data().len() as f64;
    Ok(Check::of(stage, "edges of scene tank: largest difference from the f64 twin, of the mean")
        .within((TOLERANCE, "1"), error(DEPTH_SHARE))
        .control("taps beyond edges count", error(f64::INFINITY))
        .with("pixels_left_out_share", left_out))
}

fn plain(info: &'static StageInfo, rig: &Rig<'_>, filter: &Stage<wgpu::Texture>) -> Result<Check> {
    let image = noise(SIZE, SEED);
    rig.run(&[filter])?;
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
