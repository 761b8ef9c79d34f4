//! `ao/glass`: panes over a known picture against the closed form of blending.

use std::f64::consts::PI;

use glam::DVec3;

use super::{Case, Check, Checks, Result, Rig, largest, rig};
use fathom_reference::image::{Image, pixels};
use fathom_reference::rays::{PixelRays, Tracer};
use fathom_scene::{Mesh, Object, Scene};
use fathom_stages::ao::glass::{self, GlassUniforms};
use fathom_stages::frame::{Shared, View};
use fathom_stages::geometry::Geometry;

const STAGE: &str = "ao/glass";
const SIZE: [u32; 2] = [64, 48];
const AMBIENT: f64 = 0.4;
const EXPOSURE: f64 = 0.3;
const DISPLAY_GAMMA: f64 = 2.2;
/// The grey behind the panes.
const BEHIND: f64 = 0.2;
/// Three panes, each rounded to 8 bits.
const TOLERANCE: f64 = 3.0 * 0.51 / 255.0;

pub fn cases() -> Vec<Case> {
    vec![Case::new(STAGE, "panes in front of a known picture", panes)]
}

/// Distances ahead of the camera, half widths, opacities and greys.
const PANES: [(f64, f64, f64, f64); 3] =
    [(2.0, 0.5, 0.3, 0.9), (4.0, 1.6, 0.6, 0.2), (3.0, 1.0, 0.5, 0.5)];
/// What hides panes beyond this depth.
const WALL_M: f64 = 3.5;

fn objects(view: &View) -> Vec<Object> {
    let (eye, ahead) = (view.camera.position(), view.camera.direction());
    let right = ahead.cross(DVec3::Y).normalize();
    let pane = |(number, &(distance, half, alpha, grey)): (usize, &(f64, f64, f64, f64))| {
        // Every second one shows its back.
        let across = if number % 2 == 0 { right } else { -right };
        let mesh = Mesh::parallelogram(eye + ahead * distance, across * half, DVec3::Y * half);
        let mut object = Object::new("pane", mesh);
        object.material.alpha = alpha as f32;
        object.material.albedo = [grey as f32; 3];
        object
    };
    PANES.iter().enumerate().map(pane).collect()
}

fn panes(rig: &Rig<'_>) -> Checks {
    let mut view = rig::synthetic_view(SIZE, 0.0)?;
    view.light.direction = [0.2, -0.3, -1.0];
    let objects = objects(&view);
    let check = |(name, wall_m): (&str, f64)| {
        let shown = drawn(rig, &view, &objects, wall_m)?;
        let off =
            |order: &dyn Fn(&mut Vec<f64>)| difference(&shown, &view, &objects, wall_m, order);
        Ok(Check::of(STAGE, format!("{name}: largest error of the picture"))
            .within((TOLERANCE, "1"), off(&|_| ())?)
            .control("the nearest pane drawn first", off(&|found| found.reverse())?))
    };
    [("nothing before the panes", 10.0), ("a wall between them", WALL_M)]
        .into_iter()
        .map(check)
        .collect()
}

fn drawn(rig: &Rig<'_>, view: &View, objects: &[Object], wall_m: f64) -> Result<Image> {
    let shared = Shared::new(&rig.resources, view);
    let scene = Scene { objects: objects.to_vec(), ..Scene::load("plane")? };
    let geometry = Geometry::new(&rig.resources, &scene);
    let rays = PixelRays::new(&view.camera, SIZE[0], SIZE[1]);
    let wall = view.camera.position() + view.camera.direction() * wall_m;
    let depth = rig.depth(SIZE, rays.project(wall).map_or(1.0, |p| p.depth))?;
    let picture = rig.resources.target("verify picture", SIZE, wgpu::TextureFormat::Rgba8Unorm);
    rig.fill(&picture, BEHIND)?;
    let settings = GlassUniforms { exposure: EXPOSURE as f32, ambient: AMBIENT as f32 };
    let targets = (&picture, &depth);
    let stage =
        glass::new(&rig.resources, (&shared, view), (&scene, &geometry), targets, &settings)?;
    let stage = stage.ok_or(super::VerifyError::Empty { stage: STAGE, what: "panes".into() })?;
    rig.run(&[&stage])?;
    rig.channel(&picture, 0)
}

/// From blending exact rays' surfaces, the farthest first, after `order` has changed the order.
fn difference(
    shown: &Image,
    view: &View,
    objects: &[Object],
    wall_m: f64,
    order: &dyn Fn(&mut Vec<f64>),
) -> Result<f64> {
    let tracers: Vec<Tracer> = objects
        .iter()
        .map(|object| Tracer::new(std::slice::from_ref(object)))
        .collect::<std::result::Result<_, _>>()?;
    let rays = PixelRays::new(&view.camera, SIZE[0], SIZE[1]);
    let to_light = -view.light_frame().forward;
    let ahead = view.camera.direction();
    let expected = |x: u32, y: u32| {
        let (origin, direction, length_m) = rays.ray(x, y);
        let mut met: Vec<(f64, f64, f64)> = Vec::new();
        for (tracer, object) in tracers.iter().zip(objects) {
            let Some(hit) = tracer.cast(origin, direction, 0.0, length_m) else { continue };
            let depth_m = (hit.position - view.camera.position()).dot(ahead);
            if depth_m < wall_m {
                let lit = AMBIENT + hit.normal.dot(to_light).max(0.0);
                let radiance = f64::from(object.material.albedo[0]) / PI * lit * view.irradiance();
                let grey = (1.0 - (-radiance * EXPOSURE).exp()).powf(1.0 / DISPLAY_GAMMA);
                met.push((depth_m, f64::from(object.material.alpha), grey));
            }
        }
        met.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut places: Vec<f64> = (0..met.len()).map(|i| i as f64).collect();
        order(&mut places);
        places.iter().fold((BEHIND * 255.0).round() / 255.0, |behind, place| {
            let (_, alpha, grey) = met[*place as usize];
            behind + alpha * (grey - behind)
        })
    };
    // Pixels at a pane's edge belong to either side.
    let inner = |x: u32, y: u32| {
        let about = expected(x, y);
        [(0, 1), (2, 1), (1, 0), (1, 2)].into_iter().all(|(dx, dy)| {
            let beside = expected((x + dx).saturating_sub(1), (y + dy).saturating_sub(1));
            (about - beside).abs() < 0.02
        })
    };
    let judged = pixels(SIZE).filter(|(x, y)| inner(*x, *y));
    Ok(largest(judged.map(|(x, y)| (shown.clamped(x.into(), y.into()) - expected(x, y)).abs())))
}
