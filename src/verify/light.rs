//! `uniforms`, `shadow/depth` and `shadow/mask` against the look-at rule and rays from the light.

use crate::prelude::*;

/// Scene with columns, curved objects and walls.
const SCENE: &str = "tank";
/// Scene with geometry above the water, which shades it.
const SHADED_SCENE: &str = "port";
const VIEW: [u32; 2] = [256, 256];
const TEXELS: u32 = 160;
/// Vulkan lets a rasterizer move corners by 1/32 texel, 1.5 mm here: on walls along the light a few
/// times that in depth.
const DEPTH_P99_M: f64 = 0.01;
/// Quads per side of the grid that draws the water.
const CELLS: u32 = 128;

pub fn cases() -> Vec<Case> {
    vec![
        Case::new("uniforms", "look-at of the light", look_at),
        Case::new("shadow/depth", "depth along the light", shadow_depth),
        Case::new("shadow/mask", "water seen from the light", shadow_mask),
    ]
}

/// `l = p_mid − p_light` with p_mid in the middle of the camera frustum (UW §3.1).
fn look_at(rig: &Rig<'_>) -> Checks {
    let mut scene = Scene::load(SCENE)?;
    let check = |kind| {
        scene.light.kind = kind;
        scene.light.position_m = [1.0, 6.0, 0.5];
        let uniforms = rig::view(&scene, VIEW).uniforms();
        let camera = &scene.camera;
        let eye = camera.position();
        // Radians between the direction in the uniforms and that from the light to `share` of the frustum.
        let off = |share: f64| {
            let middle = eye + camera.direction() * share * (camera.z_near_m + camera.z_far_m);
            let expected = (middle - uniforms.light_position_m.as_dvec3()).normalize();
            expected.cross(uniforms.light_forward.as_dvec3()).length()
        };
        Check::new(rig, format!("{kind:?} light: angle to the middle of the view"))
            .within((1e-5, "rad"), off(0.5))
            .control("middle taken at 0.55 of the frustum", off(0.55))
    };
    let mut checks: Vec<Check> = [LightKind::Directional, LightKind::Point].map(check).into();
    let scene = Scene::load(SHADED_SCENE)?;
    let off = |photons_fitted: bool| {
        let frame = View { photons_fitted, ..rig::view(&scene, VIEW) }.uniforms();
        let difference = (frame.photon_grid - frame.light_inverse).to_cols_array();
        f64::from(difference.into_iter().fold(0.0, |max: f32, of| max.max(of.abs())))
    };
    checks.push(
        Check::new(rig, "photons of the whole frustum: largest difference of its matrix")
            .within((0.0, "1"), off(false))
            .control("photons of the fitted rectangle", off(true)),
    );
    Ok(checks)
}

fn shadow_depth(rig: &Rig<'_>) -> Result<Check> {
    let fixture = rig.fixture(Scene::load(SCENE)?, VIEW)?;
    let stage = shadow::depth::new(rig, &fixture.shared, &fixture.geometry, TEXELS)?;
    let depth = rig.draw(&[&stage], stage.texture(), 0)?;
    let frame = fixture.view.light_frame();
    // Of each texel: the distance along the light between the map and the exact hit of a ray so many texels away; an error where one of
    // both is empty.
    let errors = |aside: f64| {
        let error = |(x, y): (u32, u32)| {
            let place =
                [x, y].map(|k| 2.0 * (f64::from(k) + 0.5 + aside) / f64::from(TEXELS) - 1.0);
            let [ndc_x, ndc_y] = [place[0], -place[1]];
            let (origin, direction) = frame.ray(ndc_x, ndc_y);
            let hit = fixture.tracer.cast(origin, direction, 0.0, f64::MAX);
            match (hit, depth.get((x, y))) {
                (None, stored) if stored >= 1.0 => Ok(None),
                (Some(hit), stored) if stored < 1.0 => {
                    let seen = frame.inverse.project_point3(DVec3::new(ndc_x, ndc_y, stored));
                    Ok(Some(seen.distance(hit.position)))
                }
                _ => Err(()),
            }
        };
        pixels(depth.size()).map(error).collect::<Vec<_>>()
    };
    let (exact, aside) = (errors(0.0), errors(0.5));
    let of = |errors: &[Result<Option<f64>, ()>]| -> Vec<f64> {
        errors.iter().filter_map(|error| error.ok().flatten()).collect()
    };
    Ok(Check::new(rig, "99th percentile of |depth − ray|")
        .within((DEPTH_P99_M, "m"), percentile::<99>(of(&exact)))
        .control("rays half a texel aside", percentile::<99>(of(&aside)))
        .with("median_m", median(of(&exact)))
        .with("coverage_disagreement", share(exact.iter().map(Result::is_err))))
}

fn shadow_mask(rig: &Rig<'_>) -> Result<Check> {
    let fixture = rig.fixture(Scene::load(SHADED_SCENE)?, VIEW)?;
    let depth = shadow::depth::new(rig, &fixture.shared, &fixture.geometry, TEXELS)?;
    let stage = shadow::mask::new(rig, &fixture.shared, depth.texture(), CELLS)?;
    let mask = rig.draw(&[&depth, &stage], stage.texture(), 0)?;
    let matrix = fixture.view.light_frame().view_projection;
    let rays = PixelRays::of_matrix(matrix, mask.width(), mask.height());
    // Whether the light enters the water at a texel, past what shades it.
    let wet = |tracer: &Tracer, (x, y): (u32, u32)| {
        let (origin, direction, length) = rays.ray(x, y);
        enter(&fixture.scene.water, origin, direction, length)
            .is_some_and(|entry| tracer.cast(origin, direction, 0.0, entry.distance_m).is_none())
    };
    let unlike = |tracer: &Tracer| {
        share(pixels(mask.size()).map(|at| wet(tracer, at) != (mask.get(at) > 0.5)))
    };
    Ok(Check::new(rig, "share of texels unlike exact rays")
        .within((0.01, "1"), unlike(&fixture.tracer))
        .control("nothing shades the water", unlike(&Tracer::new(&[])))
        .with("water_share", share(pixels(mask.size()).map(|at| wet(&fixture.tracer, at)))))
}
