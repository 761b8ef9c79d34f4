//! Exits from glass in screen space, against exact ray tracing.

use std::sync::Arc;

use fathom::harness::dump;
use fathom::pipelines::refraction::{Params, ScreenRefraction};
use fathom::pipelines::{Judge, PipelineInstance, ReferenceCache};
use fathom::reference::rays::PixelRays;
use fathom::scene::{Camera, Mesh, Object, Optics, Scene, SceneFile, generators};
use fathom::stages::screen_ray::GlassSurface;
use fathom::verify::rig::Random;
use glam::{DQuat, DVec3};
use itertools::Itertools as _;

use crate::{built, gpu};

fn vector(random: &mut Random, span: f64) -> DVec3 {
    DVec3::from([(); 3].map(|()| random.within(-span, span)))
}

/// Random glass by its number, of faces that are flat: a convex solid, a dented one, or four thin plates one behind another. `factor` is on its
/// index.
fn solids(number: u32, factor: f32) -> Scene {
    let random = &mut Random::new(1000 * number);
    let mut scene = Scene::load("ball").unwrap();
    scene.objects.clear();
    let plates: &[f64] = if number % 3 == 2 { &[-0.6, -0.2, 0.2, 0.6] } else { &[0.0] };
    for plate_y in plates {
        let rows = 3 + (3.0 * random.number()) as u32;
        let ball = generators::sphere(&generators::Sphere { rows, radius_m: 1.0 });
        let half_m = 0.75 + vector(random, 0.25);
        let half_m = half_m * DVec3::new(1.0, if plates.len() > 1 { 0.02 } else { 1.0 }, 1.0);
        let dents = vector(random, 3.0) * f64::from(u8::from(number % 3 == 1));
        let turn = DQuat::from_scaled_axis(vector(random, 0.3));
        let place = |at: DVec3| {
            turn * (half_m * at * (1.0 - 0.5 * at.dot(dents).sin().powi(2))) + plate_y * DVec3::Y
        };
        let corners = (0..ball.triangle_count())
            .flat_map(|triangle| ball.triangle(triangle).map(|at| at - DVec3::Y));
        let positions: Vec<_> = corners.map(|at| place(at).as_vec3().to_array()).collect();
        let indices = (0..positions.len() as u32).collect();
        let mut object = Object::new("glass", Mesh::smooth(positions, indices));
        (object.material.optics, object.material.alpha) = (Optics::Glass, 0.2);
        object.material.refractive_index = [1.0, 1.2, 1.5][number as usize / 3 % 3] * factor;
        scene.objects.push(object);
    }
    let eye = 3.5 * (vector(random, 1.0) + 2.5 * DVec3::Y).normalize();
    scene.camera = Camera::new(eye.to_array(), [0.0; 3], 40.0, [0.1, 20.0]);
    scene.camera.up = [0.3, 0.1, 1.0];
    scene
}

/// From random solids, convex and not, of indices from 1 on, with any number of steps. At index 1 nothing turns; of the others up to a tenth
/// leaves where no pixel's middle shows the face.
#[test]
fn exits_from_random_solids_are_exact() {
    let (gpu, mut moved) = (gpu(), 0);
    for draw in 0..super::draws() as u32 {
        let scene = Arc::new(solids(18 + draw, 1.0));
        let mut params = Params::from(&SceneFile::load("ball").unwrap());
        (params.view.width, params.view.height, params.ldi.layers) = (64, 48, 8);
        params.camera = scene.camera.clone();
        params.refraction.least_px = Random::new(draw).within(1.0, 64.0) as u32;
        let frame = built::<ScreenRefraction>(&gpu, &scene, &params);
        let p90_deg = |scene: &Arc<Scene>| {
            let judge = frame.pipeline.judge(&gpu).unwrap();
            judge(&Judge::new(scene, &ReferenceCache::default())).unwrap().errors[1].value
        };
        let found = p90_deg(&scene);
        assert!(found < 0.1, "draw {draw}, {} steps: {found}°", params.refraction.least_px);
        // The control, in every fourth draw.
        let is_tried = draw % 4 == 0;
        moved += u64::from(is_tried && p90_deg(&Arc::new(solids(18 + draw, 1.05))) > 0.1);
    }
    assert!(
        moved == super::draws().div_ceil(4),
        "the control, an index 5 % higher, shows in {moved}"
    );
}

/// Rows that lines are drawn into are as wide as the longest of them, and in nine of ten draws hardly wider: exact rays meet edges of thin plates
/// that the rasterizer leaves out.
#[test]
fn rows_hold_the_longest_line() {
    let (gpu, mut wide) = (gpu(), 0);
    for draw in 0..super::draws() as u32 {
        let scene = solids(18 + draw, 1.0);
        let mut params = Params::from(&SceneFile::load("ball").unwrap());
        (params.view.width, params.view.height) = (100 + 7 * draw, 128);
        params.camera = scene.camera.clone();
        (params.refraction.surface, params.refraction.least_px) = (GlassSurface::Depth, 1);
        let frame = built::<ScreenRefraction>(&gpu, &scene, &params);
        let dumped = |name| {
            let stages = frame.stages();
            let stage = stages.iter().find(|stage| stage.name() == name).unwrap();
            dump::read(&gpu, &stage.dumps[0]).unwrap()
        };
        let ((_, rays), (hits, _)) = (dumped("transfer/sight"), dumped("rays/rasterize"));
        let view = PixelRays::new(&scene.camera, params.view.width, params.view.height);
        let bounds = scene.solid_bounds();
        let room = bounds.size().max_element() / 50.0;
        let line_px = |ray: &[f32]| {
            let [x, y, z, state, a, b, c, _] = ray.iter().map(|v| f64::from(*v)).collect_array()?;
            let (from, along) = (DVec3::new(x, y, z), DVec3::new(a, b, c));
            let bound =
                DVec3::select(along.cmpgt(DVec3::ZERO), bounds.max + room, bounds.min - room);
            let to = from + ((bound - from) / along).min_element() * along;
            let ends = (state != 0.0).then(|| [from, to].map(|place| view.project(place)))?;
            let [from, to] = [ends[0]?, ends[1]?];
            Some((from.x_px - to.x_px).abs().max((from.y_px - to.y_px).abs()))
        };
        let longest_px = rays.chunks(8).filter_map(line_px).fold(0.0, f64::max);
        let width_px = hits[1] as f64;
        assert!(width_px >= longest_px, "draw {draw}: {longest_px} px in rows of {width_px}");
        wide += u64::from(width_px >= 1.1 * longest_px + 4.0);
    }
    assert!(10 * wide <= super::draws(), "{wide} draws have rows far wider than their lines");
}
