//! `ao/bilateral` and `hsao/filter` against the f64 twin, guided by the depth of a rendered scene.

use glam::DVec3;

use super::{Case, Check, Checks, Result, Rig, largest, noise, rig};
use fathom_gpu::StageInfo;
use fathom_pipelines::settings;
use fathom_reference::bilateral::Bilateral;
use fathom_reference::image::{Image, pixels};
use fathom_reference::quantities::quantile;
use fathom_scene::{Camera, Scene};
use fathom_stages::bilateral::{self, BilateralUniforms};
use fathom_stages::frame::{Shared, View};
use fathom_stages::gbuffer::GbufferTextures;
use fathom_stages::{ao, hsao};

/// Columns, curved objects, walls at a slant, and background between them.
const SCENE: &str = "tank";
const SIZE: [u32; 2] = [96, 64];
/// Sizes of the buffer that is filtered: the viewport's, half of it, and one that does not divide it.
const SOURCES: [[u32; 2]; 3] = [SIZE, [48, 32], [37, 29]];
/// Pixels with a tap this near to a texel's edge are left out: in f32 it may fall on the other side.
const AMBIGUOUS_PX: f64 = 2e-3;
/// Counts normals: scenes have corners and curved surfaces.
const NORMAL_SIGMA: f64 = 0.3;
/// The result is stored in 16 bits, a step of which is 4.9e-4 below 1; view depth in f32 adds as much again.
const TOLERANCE: f64 = 1e-3;

pub fn cases() -> Vec<Case> {
    let case = |info: &'static StageInfo| {
        Case::new(info.name, "noise guided by a scene's depth", move |rig| check(info, rig))
    };
    [&ao::bilateral::INFO, &hsao::filter::INFO].map(case).into()
}

fn check(info: &'static StageInfo, rig: &Rig<'_>) -> Checks {
    let scene = Scene::load(SCENE)?;
    let stand = rig.stand(&scene, SIZE);
    let textures = rig.gbuffer(&stand)?;
    let rig::Stand { view, shared, .. } = stand;
    let depth = rig.channel(&textures.depth, 0)?;
    let normals = rig.vectors(&textures.normal)?;
    let settings = settings::Filter { normal_sigma: NORMAL_SIGMA, ..settings::Filter::default() };
    let twin = twin(&settings);
    let blunt = Bilateral { depth_sigma: twin.depth_sigma * 1.2, ..twin.clone() };
    let round = Bilateral { normal_sigma: twin.normal_sigma * 1.5, ..twin.clone() };

    let mut checks = Vec::new();
    for source in SOURCES {
        let input = noise(source, 11);
        let uniforms = settings.uniforms(&view, source);
        let result = filtered(rig, info, &shared, (&input, &textures), &uniforms)?;
        let guide = (&depth, &normals[..]);
        let against = |twin: &Bilateral| differences(&result, &input, guide, &view.camera, twin);
        let (mut measured, left_out) = against(&twin);
        let (mut control, _) = against(&blunt);
        let (mut turned, _) = against(&round);
        let what = |of: &str| {
            let [w, h] = source;
            format!("{w}×{h} to the viewport{of}: 99.9th percentile of |GPU − f64 twin|")
        };
        let error = quantile(&mut measured, 0.999);
        checks.push(
            Check::of(info.name, what(", normals"))
                .within((TOLERANCE, "1"), error)
                .control("normal_sigma 1.5 times", quantile(&mut turned, 0.999)),
        );
        checks.push(
            Check::of(info.name, what(""))
                .within((TOLERANCE, "1"), error)
                .control("depth_sigma 1.2 times", quantile(&mut control, 0.999))
                .with("largest", measured.last().copied().unwrap_or(f64::NAN))
                .with("pixels_left_out_share", left_out),
        );
    }
    checks.push(background(info, rig, &shared, (&view, &depth, &textures))?);
    Ok(checks)
}

/// Of these settings.
fn twin(settings: &settings::Filter) -> Bilateral {
    let settings::Filter { taps, radius_px, sigma_px, depth_sigma, normal_sigma, .. } = *settings;
    Bilateral { taps, radius_px, sigma_px, depth_sigma, normal_sigma }
}

fn filtered(
    rig: &Rig<'_>,
    info: &'static StageInfo,
    shared: &Shared,
    (visibility, gbuffer): (&Image, &GbufferTextures),
    settings: &BilateralUniforms,
) -> Result<Image> {
    let textures = (&rig.grey(visibility), &gbuffer.depth, &gbuffer.normal);
    let stage = bilateral::new(&rig.resources, info, shared, textures, settings)?;
    rig.run(&[&stage])?;
    rig.channel(stage.texture(), 0)
}

/// Black on the geometry, white beside it: nothing of either may come to the other.
fn background(
    info: &'static StageInfo,
    rig: &Rig<'_>,
    shared: &Shared,
    (view, depth, gbuffer): (&View, &Image, &GbufferTextures),
) -> Result<Check> {
    let input = depth.map(|z| f64::from(u32::from(z >= 1.0)));
    let settings = settings::Filter::default().uniforms(view, SIZE);
    let largest = |shifted: i64| -> Result<f64> {
        let result = filtered(rig, info, shared, (&input, gbuffer), &settings)?;
        let beside = |x: u32, y: u32| input.clamped(i64::from(x) + shifted, y.into());
        let off = |x: u32, y: u32| (result.clamped(x.into(), y.into()) - beside(x, y)).abs();
        Ok(largest(pixels(SIZE).map(|(x, y)| off(x, y))))
    };
    Ok(Check::of(info.name, "largest leak between geometry and background")
        .within((0.0, "1"), largest(0)?)
        .control("compared a pixel aside", largest(1)?)
        .with("background_share", input.mean()))
}

/// |GPU − twin| over the pixels without an ambiguous tap, and the share of the pixels left out.
fn differences(
    gpu: &Image,
    input: &Image,
    guide: (&Image, &[DVec3]),
    camera: &Camera,
    twin: &Bilateral,
) -> (Vec<f64>, f64) {
    let guided = twin.over(input, guide, camera);
    let off: Vec<f64> = pixels(gpu.size())
        .filter(|(x, y)| guided.edge_distance(*x, *y) >= AMBIGUOUS_PX)
        .map(|(x, y)| (gpu.clamped(x.into(), y.into()) - guided.at(x, y)).abs())
        .collect();
    let left_out = 1.0 - off.len() as f64 / gpu.data().len() as f64;
    (off, left_out)
}
