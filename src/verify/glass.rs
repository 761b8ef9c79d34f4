//! `ao/glass`: panes over a known picture against the closed form of blending.

use crate::prelude::*;
use fathom_stages::ao::glass::{self, GlassUniforms};

const STAGE: &str = "ao/glass";
const SIZE: [u32; 2] = [64, 48];
const AMBIENT: f64 = 0.4;
const EXPOSURE: f64 = 0.3;
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
/// Between the two faces of a pane.
const BEHIND_M: f64 = 0.2;
/// What hides panes beyond this depth.
const WALL_M: f64 = 3.5;

fn objects(view: &View) -> Vec<Object> {
    let (eye, ahead) = (view.camera.position(), view.camera.direction());
    let right = ahead.cross(DVec3::Y).normalize();
    let pane = |(number, &(distance, half, alpha, grey)): (usize, &(f64, f64, f64, f64))| {
        // Every second one shows its back.
        let across = if number % 2 == 0 { right } else { -right };
        let mut mesh = Mesh::parallelogram(eye + ahead * distance, across * half, DVec3::Y * half);
        // Behind others there is a face that looks away and up: it comes later in the mesh and is drawn first.
        let middle = eye + ahead * (distance + BEHIND_M);
        let mut behind = Mesh::parallelogram(middle, -across * half, DVec3::Y * half);
        behind.normals.fill((ahead + DVec3::Y).normalize().as_vec3().to_array());
        if number % 2 == 0 {
            mesh.append(&behind);
        }
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
        let shown = draw(rig, &view, &objects, wall_m)?;
        let off = |nearest_first: bool| {
            let blended = Blended::new(&view, &objects, wall_m, nearest_first);
            let exact = Image::from_fn(SIZE, |x, y| blended.radiance((x, y)));
            let judged = pixels(SIZE).filter(|at| is_inner(&exact, *at));
            largest(judged.map(|at| (shown.get(at) - exact.get(at)).abs()))
        };
        Ok(Check::new(rig, format!("{name}: largest error of the picture"))
            .within((TOLERANCE, "1"), off(false))
            .control("the nearest pane drawn first", off(true)))
    };
    [("nothing before the panes", 10.0), ("a wall between them", WALL_M)]
        .into_iter()
        .map(check)
        .collect()
}

fn draw(rig: &Rig<'_>, view: &View, objects: &[Object], wall_m: f64) -> Result<Image> {
    let shared = Shared::new(rig, view);
    let scene = Scene { objects: objects.to_vec(), ..Scene::load("plane")? };
    let geometry = Geometry::new(rig, &scene);
    let depth = rig.depth(SIZE, rig::depth_ahead(view, wall_m))?;
    let grey = wgpu::Color { r: BEHIND, g: BEHIND, b: BEHIND, a: 1.0 };
    let picture = rig.constant_texture(SIZE, wgpu::TextureFormat::Rgba8Unorm, grey)?;
    let settings = GlassUniforms { exposure: EXPOSURE as f32, ambient: AMBIENT as f32 };
    let targets = (&picture, &depth);
    let stage = glass::new(rig, (&shared, view), (&scene, &geometry), targets, &settings)?;
    let stage = stage.ok_or_else(|| rig.empty("panes"))?;
    rig.draw(&[&stage], &picture, 0)
}

/// Exact rays' surfaces, blended.
struct Blended<'a> {
    view: &'a View,
    rays: PixelRays,
    /// Of each pane.
    tracers: Vec<Tracer>,
    wall_m: f64,
    /// And not the farthest.
    nearest_first: bool,
}

impl<'a> Blended<'a> {
    fn new(view: &'a View, objects: &[Object], wall_m: f64, nearest_first: bool) -> Self {
        let tracers = objects.iter().map(|object| Tracer::new(std::slice::from_ref(object)));
        Self { view, rays: rig::rays(view), tracers: tracers.collect(), wall_m, nearest_first }
    }

    fn radiance(&self, (x, y): (u32, u32)) -> f64 {
        let camera = &self.view.camera;
        let (origin, direction, length_m) = self.rays.ray(x, y);
        let to_light = -self.view.light_frame().forward;
        let faces = self.tracers.iter().zip(&PANES).flat_map(|pane| [0.0, 1.0].map(|n| (pane, n)));
        let met = faces.filter_map(|((tracer, &(.., alpha, grey)), number)| {
            let first_m = tracer.cast(origin, direction, 0.0, length_m)?.distance_m;
            let hit = tracer.cast(origin, direction, number * (first_m + 1e-6), length_m)?;
            let depth_m = (hit.position - camera.position()).dot(camera.direction());
            let facing = -hit.shading_normal.dot(direction).signum();
            let lit = AMBIENT + (facing * hit.shading_normal).dot(to_light).max(0.0);
            let radiance = f64::from(grey as f32) / PI * lit * self.view.irradiance();
            let shown = tone_mapped(radiance, EXPOSURE);
            (depth_m < self.wall_m).then_some((depth_m, f64::from(alpha as f32), shown))
        });
        let mut met: Vec<_> = met.collect();
        met.sort_by(
            |a, b| if self.nearest_first { a.0.total_cmp(&b.0) } else { b.0.total_cmp(&a.0) },
        );
        met.iter().fold((BEHIND * 255.0).round() / 255.0, |behind, (_, alpha, shown)| {
            behind + alpha * (shown - behind)
        })
    }
}

/// Pixels at a pane's edge belong to either side.
fn is_inner(exact: &Image, (x, y): (u32, u32)) -> bool {
    let around = [(-1, 0), (1, 0), (0, -1), (0, 1)];
    around.into_iter().all(|(dx, dy)| {
        (exact.get((x, y)) - exact.clamped(i64::from(x) + dx, i64::from(y) + dy)).abs() < 0.02
    })
}
