//! `frame`, `shadow/depth` and `shadow/mask` against the look-at rule and rays from the light.

use glam::DVec3;

use super::{Case, Check, Checks, Result, Rig, rig};
use fathom_reference::image::{Image, pixels};
use fathom_reference::quantities::quantile;
use fathom_reference::rays::{PixelRays, Tracer};
use fathom_reference::surface::enter;
use fathom_scene::{LightFrame, LightKind, Scene, Water};
use fathom_stages::shadow;

/// Scene with columns, curved objects and walls.
const SCENE: &str = "tank";
/// Scene with geometry above the water, which shades it.
const SHADED_SCENE: &str = "port";
const TEXELS: u32 = 256;
/// Vulkan lets a rasterizer move corners by 1/32 texel, 1.5 mm here: on walls along the light a few
/// times that in depth.
const DEPTH_P99_M: f64 = 0.01;
/// Quads per side of the grid that draws the water.
const CELLS: u32 = 128;

pub fn cases() -> Vec<Case> {
    vec![
        Case::new("frame", "look-at of the light", look_at),
        Case::new("shadow/depth", "depth along the light", shadow_depth),
        Case::new("shadow/mask", "water seen from the light", shadow_mask),
    ]
}

/// `l = p_mid − p_light` with p_mid in the middle of the camera frustum (UW §3.1).
fn look_at(_: &Rig<'_>) -> Checks {
    let mut scene = Scene::load(SCENE)?;
    let check = |(kind, name)| {
        scene.light.kind = kind;
        scene.light.position_m = [1.0, 6.0, 0.5];
        let view = rig::view(&scene, [256, 256]);
        let uniforms = view.uniforms();
        let camera = &scene.camera;
        let eye = camera.position();
        let looking = (DVec3::from(camera.target_m) - eye).normalize();
        // Radians between the direction in the uniforms and that from the light to `share` of the frustum.
        let off = |share: f64| {
            let middle = eye + looking * share * (camera.z_near_m + camera.z_far_m);
            let expected = (middle - uniforms.light_position_m.as_dvec3()).normalize();
            expected.cross(uniforms.light_forward.as_dvec3()).length()
        };
        Check::of("frame", format!("{name} light: angle to the middle of the view"))
            .within((1e-5, "rad"), off(0.5))
            .control("middle taken at 0.55 of the frustum", off(0.55))
    };
    let kinds = [(LightKind::Directional, "directional"), (LightKind::Point, "point")];
    Ok(kinds.map(check).into())
}

fn shadow_depth(rig: &Rig<'_>) -> Result<Check> {
    let scene = Scene::load(SCENE)?;
    let rig::Stand { view, shared, geometry } = rig.stand(&scene, [256, 256]);
    let stage = shadow::depth::new(&rig.resources, &shared, &geometry, TEXELS)?;
    rig.run(&[&stage])?;
    let depth = rig.channel(stage.texture(), 0)?;

    let tracer = Tracer::new(&scene.objects)?;
    let frame = view.light_frame();
    let measured = depth_errors(&depth, &frame, &tracer, 0.0);
    let control = depth_errors(&depth, &frame, &tracer, 0.5);
    let check = Check::of("shadow/depth", "99th percentile of |depth − ray|")
        .within((DEPTH_P99_M, "m"), measured.p99_m)
        .control("rays half a texel aside", control.p99_m);
    Ok(check
        .with("median_m", measured.median_m)
        .with("coverage_disagreement", measured.disagreement))
}

struct DepthErrors {
    median_m: f64,
    p99_m: f64,
    /// Share of texels that are covered by one and not by the other.
    disagreement: f64,
}

/// Distances along the light between the depth map and exact hits of rays `aside` texels away.
fn depth_errors(depth: &Image, frame: &LightFrame, tracer: &Tracer, aside: f64) -> DepthErrors {
    let (mut errors, mut disagree) = (Vec::new(), 0);
    for (x, y) in pixels(depth.size()) {
        let ndc_x = 2.0 * (f64::from(x) + 0.5 + aside) / f64::from(depth.width()) - 1.0;
        let ndc_y = 1.0 - 2.0 * (f64::from(y) + 0.5 + aside) / f64::from(depth.height());
        let (origin, direction) = frame.ray(ndc_x, ndc_y);
        let hit = tracer.cast(origin, direction, 0.0, f64::MAX);
        let stored = depth.clamped(x.into(), y.into());
        match hit {
            Some(hit) if stored < 1.0 => {
                let seen = frame.inverse.project_point3(DVec3::new(ndc_x, ndc_y, stored));
                errors.push((seen - hit.position).length());
            }
            None if stored >= 1.0 => {}
            _ => disagree += 1,
        }
    }
    DepthErrors {
        median_m: quantile(&mut errors, 0.5),
        p99_m: quantile(&mut errors, 0.99),
        disagreement: f64::from(disagree) / depth.data().len() as f64,
    }
}

fn shadow_mask(rig: &Rig<'_>) -> Result<Check> {
    let scene = Scene::load(SHADED_SCENE)?;
    let rig::Stand { view, shared, geometry } = rig.stand(&scene, [256, 256]);
    let depth = shadow::depth::new(&rig.resources, &shared, &geometry, TEXELS)?;
    let stage = shadow::mask::new(&rig.resources, &shared, depth.texture(), CELLS)?;
    rig.run(&[&depth, &stage])?;
    let mask = rig.channel(stage.texture(), 0)?;

    let tracer = Tracer::new(&scene.objects)?;
    let frame = view.light_frame();
    let (measured, water_share) = mask_disagreement(&mask, &frame, &scene.water, &tracer);
    let (control, _) = mask_disagreement(&mask, &frame, &scene.water, &Tracer::new(&[])?);
    let check = Check::of("shadow/mask", "share of texels unlike exact rays")
        .within((0.01, "1"), measured)
        .control("nothing shades the water", control);
    Ok(check.with("water_share", water_share))
}

/// Share of texels whose mask differs from exact rays, and the exact share of water.
fn mask_disagreement(
    mask: &Image,
    frame: &LightFrame,
    water: &Water,
    tracer: &Tracer,
) -> (f64, f64) {
    let rays = PixelRays::of_matrix(frame.view_projection, mask.width(), mask.height());
    let (mut unlike, mut wet) = (0u32, 0u32);
    for (x, y) in pixels(mask.size()) {
        let (origin, direction, length) = rays.ray(x, y);
        let entered = enter(water, origin, direction, length)
            .is_some_and(|entry| tracer.cast(origin, direction, 0.0, entry.distance_m).is_none());
        wet += u32::from(entered);
        unlike += u32::from(entered != (mask.clamped(x.into(), y.into()) > 0.5));
    }
    let all = mask.data().len() as f64;
    (f64::from(unlike) / all, f64::from(wet) / all)
}
