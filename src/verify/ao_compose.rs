//! `ao/compose`: known inputs in, closed forms of reflected light out; and its shadows against rays.

use glam::{DVec3, Vec2};

use super::{Case, Check, Checks, Result, Rig, largest, rig};
use fathom_reference::image::{Image, pixels};
use fathom_reference::rays::{PixelRays, Tracer};
use fathom_scene::Scene;
use fathom_stages::ao::compose::{self, LightingUniforms, Lit};
use fathom_stages::frame::{Shared, View};
use fathom_stages::gbuffer::GbufferTextures;
use fathom_stages::shadow;

const STAGE: &str = "ao/compose";
const SIZE: [u32; 2] = [96, 64];
/// Radiance L is shown as `(1 − exp(−exposure · L))^(1 / 2.2)` in 8 bits.
const DISPLAY_GAMMA: f64 = 2.2;
const AMBIENT: f64 = 0.4;
/// Half a step of 8 bits is 0.2 % of white; undoing the tone curve makes up to six times that of it where it is dark or
/// nearly white. The exposures keep clear of both; powers of 32 take up the rest.
const TOLERANCE: f64 = 0.02;

pub fn cases() -> Vec<Case> {
    vec![
        Case::new(STAGE, "known inputs against closed forms", known_inputs),
        Case::new(STAGE, "shadows against rays", shadows),
    ]
}

/// What is composed, one value for the whole view.
#[derive(Clone, Copy)]
struct Known {
    albedo: f64,
    specular: f64,
    normal: DVec3,
    visibility: f64,
    /// Depth in the shadow map: 1 leaves all in the light, 0 none.
    shadow: f64,
    exposure: f64,
}

const LIT: Known = Known {
    albedo: 0.5,
    specular: 0.0,
    normal: DVec3::Z,
    visibility: 0.5,
    shadow: 1.0,
    exposure: 0.3,
};

fn known_inputs(rig: &Rig<'_>) -> Checks {
    let cases = [
        ("light and ambient", LIT),
        ("ambient in shadow", Known { shadow: 0.0, exposure: 2.0, ..LIT }),
        ("a glossy surface", Known { specular: 0.6, exposure: 0.15, ..LIT }),
    ];
    let mut checks = Vec::new();
    for (name, known) in cases {
        let (shown, view, depth) = composed(rig, &known, false)?;
        let error = |known: &Known| relative_error(&shown, &view, depth, known);
        let brighter =
            Known { albedo: known.albedo * 1.05, specular: known.specular * 1.05, ..known };
        checks.push(
            Check::of(STAGE, format!("{name}: largest relative error of the radiance"))
                .within((TOLERANCE, "1"), error(&known))
                .control("reflectances 5 % higher", error(&brighter)),
        );
    }
    let (shown, ..) = composed(rig, &LIT, true)?;
    let off = |expected: f64| largest(shown.data().iter().map(|v| (v - expected).abs()));
    checks.push(
        Check::of(STAGE, "occlusion alone is shown as it is: largest error")
            .within((0.51 / 255.0, "1"), off(LIT.visibility))
            .control("visibility 0.01 higher", off(LIT.visibility + 0.01)),
    );
    Ok(checks)
}

fn settings(exposure: f64, ambient: f64) -> LightingUniforms {
    LightingUniforms {
        size_px: Vec2::new(SIZE[0] as f32, SIZE[1] as f32),
        exposure: exposure as f32,
        ambient: ambient as f32,
    }
}

/// The picture of known inputs (one channel), what it is seen from, and its device depth.
fn composed(rig: &Rig<'_>, known: &Known, shows_occlusion: bool) -> Result<(Image, View, f64)> {
    let mut view = rig::synthetic_view(SIZE, 0.0)?;
    // The shadow map covers all that is seen.
    view.light.half_extent_m = 20.0;
    // From behind the viewer, so that the glossy lobe is seen.
    view.light.direction = [0.2, -0.3, -1.0];
    let shared = Shared::new(&rig.resources, &view);
    let rays = PixelRays::new(&view.camera, SIZE[0], SIZE[1]);
    let ahead = view.camera.position() + view.camera.direction() * 3.0;
    let depth = rays.project(ahead).map_or(1.0, |p| f64::from(p.depth as f32));
    let grey = |value: f64| rig.constant(SIZE, [value as f32; 4]);
    let n = known.normal.as_vec3();
    let gbuffer = GbufferTextures {
        albedo: grey(known.albedo)?,
        normal: rig.constant(SIZE, [n.x, n.y, n.z, known.specular as f32])?,
        depth: rig.depth(SIZE, depth)?,
    };
    let lit = Lit {
        gbuffer: &gbuffer,
        visibility: &grey(known.visibility)?,
        shadow: &rig.depth([64, 64], known.shadow)?,
    };
    let settings = settings(known.exposure, AMBIENT);
    let stage = compose::new(&rig.resources, &shared, &lit, &settings, shows_occlusion)?;
    rig.run(&[&stage])?;
    Ok((rig.channel(stage.texture(), 0)?, view, depth))
}

/// Largest difference of the radiance from the closed form, relative to it: Lambert's law, Blinn and Phong's lobe of exponent 32, and
/// ambient light times visibility.
fn relative_error(shown: &Image, view: &View, depth: f64, known: &Known) -> f64 {
    use std::f64::consts::PI;
    let rays = PixelRays::new(&view.camera, SIZE[0], SIZE[1]);
    let to_light = -view.light_frame().forward;
    let lit = if known.shadow > 0.0 { 1.0 } else { 0.0 };
    let mut largest = 0.0f64;
    for ((x, y), shown) in pixels(SIZE).zip(shown.data()) {
        let p = rays.unproject(f64::from(x) + 0.5, f64::from(y) + 0.5, depth);
        let to_viewer = (view.camera.position() - p).normalize();
        let half_way = (to_light + to_viewer).normalize();
        let lobe = 40.0 / (8.0 * PI) * known.normal.dot(half_way).max(0.0).powi(32);
        let direct = (known.albedo / PI + known.specular * lobe) * known.normal.dot(to_light);
        let ambient = known.albedo / PI * AMBIENT * known.visibility;
        let exact = view.irradiance() * (lit * direct.max(0.0) + ambient);
        let measured = -(1.0 - shown.powf(DISPLAY_GAMMA)).ln() / known.exposure;
        largest = largest.max((measured / exact - 1.0).abs());
    }
    largest
}

/// Which pixels the light reaches, in a scene with columns and curved objects.
fn shadows(rig: &Rig<'_>) -> Result<Check> {
    let scene = Scene::load("tank")?;
    let stand = rig.stand(&scene, SIZE);
    let gbuffer = rig.gbuffer(&stand)?;
    let rig::Stand { view, shared, geometry } = stand;
    let light = shadow::depth::new(&rig.resources, &shared, &geometry, 1024)?;
    let white = rig.constant(SIZE, [1.0; 4])?;
    let lit = Lit {
        gbuffer: &GbufferTextures { albedo: white, ..gbuffer },
        visibility: &rig.constant(SIZE, [1.0; 4])?,
        shadow: light.texture(),
    };
    let dark = settings(1e3, 0.0);
    let stage = compose::new(&rig.resources, &shared, &lit, &dark, false)?;
    rig.run(&[&light, &stage])?;
    let shown = rig.channel(stage.texture(), 0)?;
    let tracer = Tracer::new(&scene.objects)?;
    let toward = -view.light_frame().forward;
    let (measured, in_shadow) = unlike(&shown, &view, &tracer, toward);
    let turned = (toward + DVec3::new(0.3, 0.0, 0.3)).normalize();
    Ok(Check::of(STAGE, "share of pixels whose shadow is unlike exact rays")
        .within((0.015, "1"), measured)
        .control("light turned by about 20 degrees", unlike(&shown, &view, &tracer, turned).0)
        .with("in_shadow_share", in_shadow))
}

/// Share of the covered pixels that are lit where a ray to the light is blocked, or dark where it is free; and the share
/// in shadow. Pixels that the light strikes at a slant of less than 5 degrees are left out.
fn unlike(shown: &Image, view: &View, tracer: &Tracer, toward: DVec3) -> (f64, f64) {
    const START_M: f64 = 1e-3;
    let rays = PixelRays::new(&view.camera, SIZE[0], SIZE[1]);
    let (mut judged, mut differing, mut shadowed) = (0u32, 0u32, 0u32);
    for (x, y) in pixels(SIZE) {
        let Some((hit, _)) = rays.cast(tracer, x, y) else {
            continue;
        };
        let facing = hit.shading_normal.dot(toward);
        if facing.abs() < 0.087 {
            continue;
        }
        let start = hit.position + hit.normal * START_M;
        let lit = facing > 0.0 && tracer.cast(start, toward, 0.0, 1e3).is_none();
        judged += 1;
        shadowed += u32::from(!lit);
        differing += u32::from(lit != (shown.clamped(x.into(), y.into()) > 0.5));
    }
    let judged = f64::from(judged.max(1));
    (f64::from(differing) / judged, f64::from(shadowed) / judged)
}
