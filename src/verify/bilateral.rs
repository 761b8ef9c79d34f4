//! `ao/bilateral` and `hsao/filter` against the f64 twin, guided by the depth of a rendered scene.

use crate::prelude::*;
use fathom_pipelines::settings;
use fathom_reference::bilateral::Bilateral;
use fathom_reference::quantities::quantile;
use fathom_stages::bilateral::{self, BilateralUniforms};
use fathom_stages::{ao, hsao};

/// Columns, curved objects, walls at a slant, and background between them.
const SCENE: &str = "tank";
const SIZE: [u32; 2] = [96, 64];
/// Sizes of the buffer that is filtered: the viewport's, half of it, and one that does not divide it.
const SOURCES: [[u32; 2]; 3] = [SIZE, [48, 32], [37, 29]];
/// Pixels with a tap this near to a texel's edge are left out: in f32 it may fall on the other side.
const AMBIGUOUS_PX: f64 = 2e-3;
/// Counts normals: scenes have corners and curved surfaces. And counts none, as VAO §6.
const NORMAL_SIGMAS: [f64; 2] = [0.3, 1e3];
/// The result is stored in 16 bits, a step of which is 4.9e-4 below 1; view depth in f32 adds as much again.
const TOLERANCE: f64 = 1e-3;

pub fn cases() -> Vec<Case> {
    let what = "noise guided by a scene's depth";
    let stages = [&ao::bilateral::INFO, &hsao::filter::INFO];
    stages.map(|info| Case::new(info.name, what, move |rig| check(info, rig))).into()
}

fn check(info: &'static StageInfo, rig: &Rig<'_>) -> Checks {
    let stand = rig.stand(Scene::load(SCENE)?, SIZE)?;
    let textures = rig.gbuffer(&stand)?;
    let depth = rig.channel(&textures.depth, 0)?;
    let normals = rig.vectors(&textures.normal)?;
    let filtered = |visibility: &Image, uniforms: &BilateralUniforms| {
        let inputs = (&rig.grey(visibility), &textures.depth, &textures.normal);
        let stage = bilateral::new(rig, info, &stand.shared, inputs, uniforms)?;
        rig.drawn(&[&stage], stage.texture(), 0)
    };
    let mut checks = Vec::new();
    let each = SOURCES.into_iter().flat_map(|source| NORMAL_SIGMAS.map(|sigma| (source, sigma)));
    for (source, normal_sigma) in each {
        let settings = settings::Filter { normal_sigma, ..settings::Filter::default() };
        let settings::Filter { taps, radius_px, sigma_px, depth_sigma, .. } = settings;
        let twin = Bilateral { taps, radius_px, sigma_px, depth_sigma, normal_sigma };
        let blunt = Bilateral { depth_sigma: depth_sigma * 1.2, ..twin.clone() };
        let round = Bilateral { normal_sigma: 0.45, ..twin.clone() };
        let input = noise(source, 11);
        let result = filtered(&input, &settings.uniforms(&stand.view, source))?;
        // |GPU − twin| over the pixels without an ambiguous tap.
        let against = |twin: &Bilateral| -> Vec<f64> {
            let guided = twin.over(&input, (&depth, &normals), &stand.scene.camera);
            pixels(SIZE)
                .filter(|(x, y)| guided.edge_distance(*x, *y) >= AMBIGUOUS_PX)
                .map(|(x, y)| (result.at((x, y)) - guided.at(x, y)).abs())
                .collect()
        };
        let mut off = against(&twin);
        let left_out = 1.0 - off.len() as f64 / result.data().len() as f64;
        let (error, most) = (quantile(&mut off, 0.999), largest(off));
        let what = |of: &str| {
            let [w, h] = source;
            Check::of(
                rig,
                format!("{w}×{h} to the viewport{of}, normal_sigma {normal_sigma}: 99.9th percentile of |GPU − f64 twin|"),
            )
            .within((TOLERANCE, "1"), error)
        };
        checks.push(
            what(", normals").control("normal_sigma 0.45", quantile(&mut against(&round), 0.999)),
        );
        let check =
            what("").control("depth_sigma 1.2 times", quantile(&mut against(&blunt), 0.999));
        checks.push(check.with("largest", most).with("pixels_left_out_share", left_out));
    }

    // Black on the geometry, white beside it: nothing of either may come to the other.
    let input = depth.map(|z| f64::from(u32::from(z >= 1.0)));
    let result = filtered(&input, &settings::Filter::default().uniforms(&stand.view, SIZE))?;
    let leak = |shifted: i64| {
        let beside = |x: u32, y: u32| input.clamped(i64::from(x) + shifted, y.into());
        largest(pixels(SIZE).map(|(x, y)| (result.at((x, y)) - beside(x, y)).abs()))
    };
    checks.push(
        Check::of(rig, "largest leak between geometry and background")
            .within((0.0, "1"), leak(0))
            .control("compared a pixel aside", leak(1))
            .with("background_share", input.mean()),
    );
    Ok(checks)
}
