//! `caustics/filter` and `godrays/filter`: the spread of a point of light against that of a disc, and what is left of noise.

use crate::prelude::*;
use fathom_gpu::Column;
use fathom_stages::caustics::filter::{self as caustics, GuidedUniforms};
use fathom_stages::godrays::filter::{self as godrays, FilterUniforms};
use fathom_stages::splatting::SplatSums;

const SIZE: [u32; 2] = [96, 64];
const TAPS: u32 = 16;
/// Default of `caustics.filter_depth_share`.
const DEPTH_SHARE: f64 = 0.05;
const RADIUS_PX: f64 = 3.0;
/// Distance of points of light, more than twice the radius.
const APART_PX: u32 = 16;
/// Weighted mean of noise that was filtered, from when each pixel agreed with an f64 copy of the algorithm: 0.50186 on lavapipe (Mesa 22.3), 0.50190
/// on SwiftShader.
const MEAN: f64 = 0.50188;

pub fn cases() -> Vec<Case> {
    let [caustics, godrays] = [caustics::INFO.name, godrays::INFO.name];
    vec![
        Case::new(caustics, "points of light and noise", |rig| plain(rig, caustics_alone)),
        Case::new(godrays, "points of light and noise", |rig| plain(rig, godrays_alone)),
        Case::new(caustics, "edges of surfaces", edges),
    ]
}

pub fn sums(rig: &Rig<'_>, image: &Image) -> SplatSums {
    SplatSums { texture: rig.grey(image), column: Column::new("light", "1", "light") }
}

fn guided(
    rig: &Rig<'_>,
    (image, radius_px): (&Image, f64),
    (view, depth): (&View, &wgpu::Texture),
    share: f64,
) -> Result<Image> {
    let settings =
        GuidedUniforms { taps: TAPS, radius_px: radius_px as f32, depth_share: share as f32 };
    let (sums, shared) = (sums(rig, image), Shared::new(rig, view));
    let stage = caustics::new(rig, &sums, &shared, depth, &settings)?;
    rig.draw(&[&stage], stage.texture(), 0)
}

/// One surface only: all taps count.
fn caustics_alone(rig: &Rig<'_>, image: &Image, radius_px: f64) -> Result<Image> {
    let view = rig::synthetic_view(SIZE, 0.0)?;
    guided(rig, (image, radius_px), (&view, &rig.depth(SIZE, 0.9)?), DEPTH_SHARE)
}

fn godrays_alone(rig: &Rig<'_>, image: &Image, radius_px: f64) -> Result<Image> {
    let settings = FilterUniforms { taps: TAPS, radius_px: radius_px as f32 };
    let stage = godrays::new(rig, &sums(rig, image), &settings)?;
    rig.draw(&[&stage], stage.texture(), 0)
}

type Filtering = fn(&Rig<'_>, &Image, f64) -> Result<Image>;

fn plain(rig: &Rig<'_>, filtered: Filtering) -> Checks {
    let middle = |k: u32| k % APART_PX == APART_PX / 2;
    let points = Image::from_fn(SIZE, |x, y| f64::from(u8::from(middle(x) && middle(y))));
    let spread = filtered(rig, &points, RADIUS_PX)?;
    // Mean square distance from the point: half the radius's square, and that of two places in a pixel.
    let off = |k: u32| f64::from(k % APART_PX) - f64::from(APART_PX / 2);
    let squares = pixels(SIZE).map(|(x, y)| spread.get((x, y)) * (off(x).powi(2) + off(y).powi(2)));
    let found = squares.sum::<f64>() / spread.sum();
    let disc = |radius_px: f64| relative_error(found, radius_px * radius_px / 2.0 + 1.0 / 6.0);
    // A weighted mean shows what a mean would not, light that is elsewhere.
    let [noise, weights] = [7, 71].map(|seed| noise(SIZE, seed));
    let left = |radius_px: f64| -> Result<f64> {
        let found = filtered(rig, &noise, radius_px)?;
        let weighted =
            found.data().iter().zip(weights.data()).map(|(value, weight)| 2.0 * value * weight);
        Ok((mean(weighted) - MEAN).abs())
    };
    Ok(vec![
        Check::new(rig, "mean square distance from points of light: relative error")
            .within((0.05, "1"), disc(RADIUS_PX))
            .control("a disc 10 % wider", disc(1.1 * RADIUS_PX)),
        Check::new(rig, "weighted mean of filtered noise against that of an f64 copy")
            .within((5e-5, "1"), left(RADIUS_PX)?)
            .control("a disc 2 % wider", left(1.02 * RADIUS_PX)?),
    ])
}

/// White on one of two walls: the other gets nothing of it where it is farther away than the share of the depth, and all where it is nearer.
fn edges(rig: &Rig<'_>) -> Checks {
    let filtered = |far: f64, share: f64| -> Result<[Image; 2]> {
        let (fixture, middle) = rig.two_walls(SIZE, [3.0, 3.0 * far], [DVec3::Z; 2])?;
        let drawn = rig.gbuffer(&fixture)?.depth;
        let white = rig.channel(&drawn, 0)?.map(|z| f64::from(u8::from(z > middle)));
        Ok([guided(rig, (&white, RADIUS_PX), (&fixture.view, &drawn), share)?, white])
    };
    let leak = |share: f64| filtered(1.053, share).map(|[found, white]| apart(&found, &white));
    let [all, _] = filtered(1.047, 1e6)?;
    let less = |share: f64| filtered(1.047, share).map(|[found, _]| apart(&found, &all));
    Ok(vec![
        Check::new(rig, "a wall 5.3 % farther away: largest leak")
            .within((0.0, "1"), leak(DEPTH_SHARE)?)
            .control("a share of 0.055", leak(0.055)?),
        Check::new(rig, "a wall 4.7 % farther away: largest difference from taps that all count")
            .within((0.0, "1"), less(DEPTH_SHARE)?)
            .control("a share of 0.045", less(0.045)?),
    ])
}
