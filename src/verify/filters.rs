//! `caustics/filter` and `godrays/filter` against the f64 twin.

use crate::prelude::*;
use fathom_gpu::Column;
use fathom_reference::filter::Disc;
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
            let view = rig::synthetic_view(SIZE, 0.0)?;
            plain(rig, &caustics_filter(rig, &view, &rig.depth(SIZE, 0.9)?)?)
        }),
        Case::new(caustics::filter::INFO.name, "edges of surfaces", edges),
        Case::new(godrays::filter::INFO.name, "noise through the low-pass", |rig| {
            let settings = FilterUniforms { taps: TAPS, radius_px: RADIUS_PX as f32 };
            let source = Sums {
                texture: rig.grey(&noise(SIZE, SEED)),
                column: Column::new("noise", "1", "noise"),
            };
            plain(rig, &low_pass::new(rig, &godrays::filter::INFO, &source, &settings)?)
        }),
    ]
}

/// `caustics/filter` over noise, guided by a depth.
fn caustics_filter(
    rig: &Rig<'_>,
    view: &View,
    depth: &wgpu::Texture,
) -> Result<Stage<wgpu::Texture>> {
    let shared = Shared::new(rig, view);
    let settings =
        GuidedUniforms { taps: TAPS, radius_px: RADIUS_PX as f32, depth_share: DEPTH_SHARE as f32 };
    let source =
        Sums { texture: rig.grey(&noise(SIZE, SEED)), column: Column::new("noise", "1", "noise") };
    let info = &caustics::filter::INFO;
    Ok(low_pass::guided(rig, info, &source, (&shared, depth), &settings)?)
}

/// What a filter makes of noise over the pixels that are judged, and the noise.
struct Filtered {
    source: Image,
    result: Image,
    judged: Vec<(u32, u32)>,
}

impl Filtered {
    fn new(
        rig: &Rig<'_>,
        filter: &Stage<wgpu::Texture>,
        clear: impl Fn(&Image, u32, u32) -> bool,
    ) -> Result<Self> {
        let source = noise(SIZE, SEED);
        let result = rig.drawn(&[filter], filter.texture(), 0)?;
        let judged = pixels(SIZE).filter(|(x, y)| clear(&source, *x, *y)).collect();
        Ok(Self { source, result, judged })
    }

    /// Largest difference from a twin, relative to the mean.
    fn error(&self, twin: impl Fn(&Image, u32, u32) -> f64) -> f64 {
        let off = |&at: &(u32, u32)| (self.result.at(at) - twin(&self.source, at.0, at.1)).abs();
        largest(self.judged.iter().map(off)) / self.source.mean()
    }

    fn left_out(&self) -> f64 {
        1.0 - self.judged.len() as f64 / self.source.data().len() as f64
    }
}

/// Noise over a scene with many edges: taps beyond them do not count.
fn edges(rig: &Rig<'_>) -> Result<Check> {
    let stand = rig.stand(Scene::load("tank")?, VIEW)?;
    let drawn = rig.gbuffer(&stand)?.depth;
    let depth = rig.channel(&drawn, 0)?;
    let seen = CameraDepth { depth: &depth, camera: &stand.view.camera };
    let disc = Disc::vogel(TAPS, RADIUS_PX);
    let filter = caustics_filter(rig, &stand.view, &drawn)?;
    let filtered = Filtered::new(rig, &filter, |source, x, y| {
        disc.edge_distance(x, y) >= AMBIGUOUS_PX
            && disc.decision_distance(source, (&seen, DEPTH_SHARE), x, y) >= AMBIGUOUS_SHARE
    })?;
    let error = |share: f64| {
        filtered.error(|source, x, y| disc.within_surface(source, (&seen, share), x, y))
    };
    Ok(Check::of(rig, "edges of scene tank: largest difference from the f64 twin, of the mean")
        .within((TOLERANCE, "1"), error(DEPTH_SHARE))
        .control("taps beyond edges count", error(f64::INFINITY))
        .with("pixels_left_out_share", filtered.left_out()))
}

fn plain(rig: &Rig<'_>, filter: &Stage<wgpu::Texture>) -> Result<Check> {
    let disc = Disc::vogel(TAPS, RADIUS_PX);
    let mut moved = disc.clone();
    moved.taps[0][0] += 1.0;
    let filtered = Filtered::new(rig, filter, |_, x, y| disc.edge_distance(x, y) >= AMBIGUOUS_PX)?;
    let error = |disc: &Disc| filtered.error(|source, x, y| disc.at(source, x, y));
    Ok(Check::of(rig, "largest difference from the f64 twin, of the mean")
        .within((TOLERANCE, "1"), error(&disc))
        .control("one tap moved by a pixel", error(&moved))
        .with("pixels_left_out_share", filtered.left_out())
        .with("energy_change", relative_error(filtered.result.sum(), filtered.source.sum())))
}
