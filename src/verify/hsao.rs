//! `hsao/march` against closed forms and its own means of a scene.

use crate::prelude::*;
use fathom_reference::occlusion::{Obscurity, occlusion_beside_wall};
use fathom_stages::hsao::march::{self, HorizonUniforms};

const STAGE: &str = "hsao/march";
const SIZE: [u32; 2] = [96, 72];
/// Columns, curved objects, walls at a slant and background.
const SCENE: &str = "tank";
/// Means of A in this scene, linear and at half the size hard, from when the stage agreed in every pixel with an f64 copy of its
/// algorithm: 0.0419 and 0.0777 on lavapipe (Mesa 22.3), 0.0418 and 0.0776 on SwiftShader.
const MEANS: [f64; 2] = [0.0419, 0.0777];
const MEAN_TOLERANCE: f64 = 3e-4;
/// Not 0, which draws nothing else.
const SEED: u32 = 3;
const PLANE: f64 = 1e-3;
/// 32 directions of 32 samples, over pixels of some 2 cm.
const WALL_RMS: f64 = 0.015;

pub fn cases() -> Vec<Case> {
    vec![
        Case::new(STAGE, "means of a scene", means),
        Case::new(STAGE, "a plane and a wall against closed forms", closed_forms),
    ]
}

/// What the stage makes of a scene's G-buffer: A.
fn shade(
    rig: &Rig<'_>,
    fixture: &Fixture,
    gbuffer: &GBuffer,
    settings: &HorizonUniforms,
    attenuation: Obscurity,
) -> Result<Image> {
    let hard = attenuation == Obscurity::Hard;
    let stage = march::new(rig, &fixture.shared, gbuffer, settings, hard, None)?;
    Ok(rig.draw(&[&stage], stage.texture(), 0)?.map(|visibility| 1.0 - visibility))
}

fn method(buffer_px: [u32; 2]) -> HorizonUniforms {
    HorizonUniforms {
        size_px: buffer_px.into(),
        r_max_m: 1.0,
        layer_m: 0.5,
        directions: 16,
        steps: 16,
        rays: 18,
        ray_steps: 8,
        seed: 0,
    }
}

/// More directions and samples than anyone would take, so that the closed form is what is left.
fn dense() -> HorizonUniforms {
    HorizonUniforms { directions: 32, steps: 32, ..method(SIZE) }
}

fn means(rig: &Rig<'_>) -> Checks {
    let fixture = rig.fixture(Scene::load(SCENE)?, SIZE)?;
    let gbuffer = rig.gbuffer(&fixture)?;
    let check = |((name, attenuation, buffer_px), expected): ((&str, Obscurity, _), f64)| {
        let off = |r_max_m: f32| -> Result<f64> {
            let settings = HorizonUniforms { seed: SEED, r_max_m, ..method(buffer_px) };
            let mean = shade(rig, &fixture, &gbuffer, &settings, attenuation)?.mean();
            Ok((mean - expected).abs())
        };
        Ok(Check::new(rig, format!("{name}: mean A of scene {SCENE} against that of an f64 copy"))
            .within((MEAN_TOLERANCE, "1"), off(1.0)?)
            .control("r_max 5 % greater", off(1.05)?))
    };
    let half = SIZE.map(|side| side / 2);
    [("linear", Obscurity::Linear, SIZE), ("hard, at half the size", Obscurity::Hard, half)]
        .into_iter()
        .zip(MEANS)
        .map(check)
        .collect()
}

fn closed_forms(rig: &Rig<'_>) -> Checks {
    let camera = camera([3.0, 2.6, 0.0], [0.0, 0.4, 0.0]);
    let floor = quad([30.0, 0.0, 0.0], [0.0, 0.0, -30.0]);
    let wall = quad([0.0, 30.0, 0.0], [0.0, 0.0, 30.0]);
    let plane = built(rig, camera.clone(), vec![floor.clone()])?;
    let corner = built(rig, camera, vec![floor, wall])?;

    let max = |fixture: &Fixture| -> Result<f64> {
        let found = shade(rig, fixture, &rig.gbuffer(fixture)?, &dense(), Obscurity::Hard)?;
        Ok(largest(found.data().iter().copied()))
    };
    let checks = vec![
        Check::new(rig, "largest occlusion of a plane by itself")
            .within((PLANE, "1"), max(&plane)?)
            .control("a wall stands on it", max(&corner)?),
        behind_a_plate(rig)?,
    ];
    let exact = |hit: &Hit, r_max_m: f64, attenuation| {
        let on_floor = hit.normal.y > 0.5;
        let from_edge = if on_floor { hit.position.x } else { hit.position.y };
        // Pixels next to the edge hold it.
        (from_edge > 0.06).then(|| occlusion_beside_wall(from_edge / r_max_m, attenuation))
    };
    let gbuffer = rig.gbuffer(&corner)?;
    let check = |(name, attenuation): (&str, Obscurity)| {
        let settings = dense();
        let found = shade(rig, &corner, &gbuffer, &settings, attenuation)?;
        let off = |r_max_m: f64| -> Vec<f64> {
            let inner = (8..SIZE[1] - 8).flat_map(|y| (8..SIZE[0] - 8).map(move |x| (x, y)));
            let off = |at| Some(found.get(at) - exact(&corner.hit(at)?, r_max_m, attenuation)?);
            inner.step_by(5).filter_map(off).collect()
        };
        let r_max_m = f64::from(settings.r_max_m);
        let errors = off(r_max_m);
        Ok(Check::new(rig, format!("beside a wall, {name}: RMS of the error"))
            .within((WALL_RMS, "1"), rms(errors.iter().copied()))
            .control("r_max 20 % greater", rms(off(1.2 * r_max_m)))
            .with("bias", mean(errors)))
    };
    let both = [("hard", Obscurity::Hard), ("linear", Obscurity::Linear)].into_iter();
    checks.into_iter().map(Ok).chain(both.map(check)).collect()
}

/// What lies out of reach does not block light, though it hides parts of the plane from the eye.
fn behind_a_plate(rig: &Rig<'_>) -> Result<Check> {
    let floor = quad([30.0, 0.0, 0.0], [0.0, 0.0, -30.0]);
    let mut plate = quad([0.3, 0.0, 0.0], [0.0, 0.0, -0.3]);
    plate.mesh.positions.iter_mut().for_each(|position| position[1] += 1.8);
    let fixture = built(rig, camera([0.6, 3.0, 0.4], [0.0; 3]), vec![floor, plate])?;
    let gbuffer = rig.gbuffer(&fixture)?;
    let max = |r_max_m: f32| -> Result<f64> {
        let settings = HorizonUniforms { r_max_m, ..dense() };
        let found = shade(rig, &fixture, &gbuffer, &settings, Obscurity::Hard)?;
        let is_floor = |at: &(u32, u32)| fixture.hit(*at).is_some_and(|hit| hit.object == 0);
        Ok(largest(pixels(SIZE).filter(is_floor).map(|at| found.get(at))))
    };
    Ok(Check::new(rig, "a plate out of reach before a plane: largest occlusion of the plane")
        .within((PLANE, "1"), max(1.0)?)
        .control("within reach", max(2.5)?))
}

pub(super) fn camera(position_m: [f64; 3], target_m: [f64; 3]) -> Camera {
    Camera::new(position_m, target_m, 50.0, [0.1, 20.0])
}

/// Scene `plane` with other objects, seen by this camera.
pub(super) fn built(rig: &Rig<'_>, camera: Camera, objects: Vec<Object>) -> Result<Fixture> {
    rig.fixture(Scene { camera, objects, ..Scene::load("plane")? }, SIZE)
}

/// A parallelogram around the origin, with half its sides; its normal is that of `a` × `b`.
pub(super) fn quad(a: [f64; 3], b: [f64; 3]) -> Object {
    Object::new("verify", Mesh::parallelogram(DVec3::ZERO, a.into(), b.into()))
}
