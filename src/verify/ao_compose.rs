//! `ao/compose`: known inputs in, closed forms of reflected light out; and its shadows against rays.

use crate::prelude::*;
use fathom_stages::ao::compose::{self, LitInputs};
use fathom_stages::picture::Picture;

const STAGE: &str = "ao/compose";
const SIZE: [u32; 2] = [96, 64];
const AMBIENT: f64 = 0.4;
/// Half a step of 8 bits is 0.2 % of white; undoing the tone curve makes up to six times that of it where it is dark or
/// nearly white. The exposures keep clear of both; powers of 32 take up the rest.
const TOLERANCE: f64 = 0.02;

pub fn cases() -> Vec<Case> {
    vec![
        Case::new(STAGE, "known inputs against closed forms", known_inputs),
        Case::new(STAGE, "shadows against rays", shadows),
        Case::new(STAGE, "a plane in slanted light", unshaded),
    ]
}

/// What is composed, one value for the whole view, from a surface that faces the camera.
#[derive(Clone, Copy)]
struct SurfaceInputs {
    albedo: f64,
    specular: f64,
    visibility: f64,
    /// Depth in the shadow map: 1 leaves all in the light, 0 none.
    shadow: f64,
    exposure: f64,
}

const LIT: SurfaceInputs =
    SurfaceInputs { albedo: 0.5, specular: 0.0, visibility: 0.5, shadow: 1.0, exposure: 0.3 };
const NORMAL: DVec3 = DVec3::Z;
/// How far ahead the surface is, metres.
const AHEAD_M: f64 = 3.0;

fn known_inputs(rig: &Rig<'_>) -> Checks {
    let mut view = rig::synthetic_view(SIZE, 0.0)?;
    // The shadow map covers all that is seen.
    view.light.half_extent_m = 20.0;
    // From behind the viewer, so that the glossy lobe is seen.
    view.light.direction = [0.2, -0.3, -1.0];
    let cases = [
        ("light and ambient", LIT),
        ("ambient in shadow", SurfaceInputs { shadow: 0.0, exposure: 2.0, ..LIT }),
        ("a glossy surface", SurfaceInputs { specular: 0.6, exposure: 0.15, ..LIT }),
    ];
    let mut checks = Vec::new();
    for (name, known) in cases {
        let shown = known.composed(rig, &view, depth(&view), false)?;
        let brighter =
            SurfaceInputs { albedo: known.albedo * 1.05, specular: known.specular * 1.05, ..known };
        checks.push(
            Check::new(rig, format!("{name}: largest relative error of the radiance"))
                .within((TOLERANCE, "1"), known.error(&shown, &view))
                .control("reflectances 5 % higher", brighter.error(&shown, &view)),
        );
    }
    let behind = LIT.composed(rig, &view, 1.0, true)?;
    // The greys of the shader, below and above.
    let rays = rig::rays(&view);
    let background = |low: f64, high: f64| {
        let grey = |x, y| low + (high - low) * 0.5 * (1.0 + rays.ray(x, y).1.y);
        largest(pixels(SIZE).map(|(x, y)| (behind.get((x, y)) - grey(x, y)).abs()))
    };
    checks.push(
        Check::new(rig, "where nothing is seen: largest error of the grey")
            .within((0.51 / 255.0, "1"), background(0.30, 0.75))
            .control("a gradient upside down", background(0.75, 0.30)),
    );
    let shown = LIT.composed(rig, &view, depth(&view), true)?;
    let off = |expected: f64| largest(shown.data().iter().map(|v| (v - expected).abs()));
    checks.push(
        Check::new(rig, "occlusion alone is shown as it is: largest error")
            .within((0.51 / 255.0, "1"), off(LIT.visibility))
            .control("visibility 0.01 higher", off(LIT.visibility + 0.01)),
    );
    Ok(checks)
}

/// Device depth as the buffer holds it.
fn depth(view: &View) -> f64 {
    f64::from(rig::depth_ahead(view, AHEAD_M) as f32)
}

impl SurfaceInputs {
    /// The picture, one channel.
    fn composed(
        &self,
        rig: &Rig<'_>,
        view: &View,
        depth: f64,
        shows_occlusion: bool,
    ) -> Result<Image> {
        let grey = |value: f64| rig.constant(SIZE, [value as f32; 4]);
        let gbuffer = GBuffer {
            albedo: grey(self.albedo)?,
            normal: rig.constant(SIZE, NORMAL.as_vec3().extend(self.specular as f32).to_array())?,
            depth: rig.depth(SIZE, depth)?,
        };
        let lit = LitInputs {
            picture: Picture::new(&gbuffer, self.exposure, AMBIENT),
            visibility: &grey(self.visibility)?,
            shadow: &rig.depth([64, 64], self.shadow)?,
        };
        let stage = compose::new(rig, &Shared::new(rig, view), &lit, shows_occlusion)?;
        rig.draw(&[&stage], stage.texture(), 0)
    }

    /// Largest difference of the radiance from the closed form, relative to it: Lambert's law, Blinn and Phong's lobe of exponent 32, and
    /// ambient light times visibility.
    fn error(&self, shown: &Image, view: &View) -> f64 {
        let (rays, depth) = (rig::rays(view), depth(view));
        let to_light = -view.light_frame().forward;
        let lit = if self.shadow > 0.0 { 1.0 } else { 0.0 };
        largest(pixels(SIZE).map(|(x, y)| {
            let p = rays.unproject(f64::from(x) + 0.5, f64::from(y) + 0.5, depth);
            let to_viewer = (view.camera.position() - p).normalize();
            let half_way = (to_light + to_viewer).normalize();
            let lobe = 40.0 / (8.0 * PI) * NORMAL.dot(half_way).max(0.0).powi(32);
            let direct = (self.albedo / PI + self.specular * lobe) * NORMAL.dot(to_light);
            let ambient = self.albedo / PI * AMBIENT * self.visibility;
            let exact = view.irradiance() * (lit * direct.max(0.0) + ambient);
            relative_error(radiance_of(shown.get((x, y)), self.exposure), exact)
        }))
    }
}

/// Which pixels the light reaches, in a scene with columns and curved objects.
fn shadows(rig: &Rig<'_>) -> Result<Check> {
    const START_M: f64 = 1e-3;
    let fixture = rig.fixture(Scene::load("tank")?, SIZE)?;
    let shown = lit(rig, &fixture, &fixture.geometry, 1e3)?;
    // Of the covered pixels: whether a ray to the light is free, and whether the picture is lit. Pixels that the light strikes at a slant
    // of less than 5 degrees are left out.
    let judged = |toward: DVec3| -> Vec<[bool; 2]> {
        let judge = |at| {
            let hit = fixture.hit(at)?;
            let facing = hit.shading_normal.dot(toward);
            let start = hit.position + hit.normal * START_M;
            let free = || facing > 0.0 && fixture.tracer.cast(start, toward, 0.0, 1e3).is_none();
            (facing.abs() >= 0.087).then(|| [free(), shown.get(at) > 0.5])
        };
        pixels(SIZE).filter_map(judge).collect()
    };
    let unlike = |judged: &[[bool; 2]]| share(judged.iter().map(|[free, lit]| free != lit));
    let toward = -fixture.view.light_frame().forward;
    let turned = judged((toward + DVec3::new(0.3, 0.0, 0.3)).normalize());
    let judged = judged(toward);
    Ok(Check::new(rig, "share of pixels whose shadow is unlike exact rays")
        .within((0.015, "1"), unlike(&judged))
        .control("light turned by about 20 degrees", unlike(&turned))
        .with("in_shadow_share", share(judged.iter().map(|[free, _]| !free))))
}

/// A white scene in the light that a geometry leaves.
fn lit(rig: &Rig<'_>, fixture: &Fixture, caster: &Geometry, exposure: f64) -> Result<Image> {
    let light = shadow::depth::new(rig, &fixture.shared, caster, 1024)?;
    let white = rig.constant(SIZE, [1.0; 4])?;
    let gbuffer = GBuffer { albedo: white.clone(), ..rig.gbuffer(fixture)? };
    let lit = LitInputs {
        picture: Picture::new(&gbuffer, exposure, 0.0),
        visibility: &white,
        shadow: light.texture(),
    };
    let stage = compose::new(rig, &fixture.shared, &lit, false)?;
    rig.draw(&[&light, &stage], stage.texture(), 0)
}

/// No plane lies in its own shadow. One as far above it as two texels of the map are wide lays a shadow on it.
fn unshaded(rig: &Rig<'_>) -> Result<Check> {
    let mut scene = rig::flat_plane(LightKind::Directional)?;
    scene.light.direction = [1.0, -0.5, 0.7];
    let fixture = rig.fixture(scene.clone(), SIZE)?;
    let texel_m = 2.0 * scene.light.half_extent_m / 1024.0;
    for position in scene.objects.iter_mut().flat_map(|object| &mut object.mesh.positions) {
        position[1] += 2.0 * texel_m as f32;
    }
    let above = Geometry::new(rig, &scene);
    let dark = |caster| -> Result<f64> {
        let shown = lit(rig, &fixture, caster, 0.3)?;
        let plane = pixels(SIZE).filter(|at| fixture.hit(*at).is_some()).map(|at| shown.get(at));
        let brightest = largest(plane.clone());
        Ok(share(plane.map(|shown| shown < 0.99 * brightest)))
    };
    Ok(Check::new(rig, "share of pixels in shadow")
        .within((0.0, "1"), dark(&fixture.geometry)?)
        .control("a plane two texels above it casts the shadow", dark(&above)?))
}
