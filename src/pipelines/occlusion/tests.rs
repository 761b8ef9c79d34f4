use super::fixtures::{camera, corner, gbuffer};
use super::*;
use crate::settings::Deform;
use fathom_scene::Mesh;

fn question(scale: u32) -> OcclusionQuery {
    OcclusionQuery {
        opaque: vec![true; 2],
        alphas: vec![1.0; 2],
        camera: camera([4.0, 3.0, 2.0]),
        size_px: [48, 40],
        r_max_m: 1.0,
        model: RayModel::First(Attenuation::Linear),
        animation: Animation::default(),
        buffer_px: [48 / scale, 40 / scale],
    }
}

fn points(question: &OcclusionQuery, max: usize) -> Vec<JudgedPoint> {
    let tracer = Tracer::new(&corner());
    let [depth, normal] = gbuffer(&tracer, &question.camera, question.size_px);
    cast(question, &tracer, &depth, &normal, max, 64)
}

/// A buffer of visibilities that holds what the reference says, and `darker` more occlusion.
fn buffer(question: &OcclusionQuery, points: &[JudgedPoint], darker: f64) -> Pixels {
    let [width, height] = question.buffer_px;
    let mut data = vec![1.0; (width * height) as usize];
    for x in 0..width {
        for y in 0..height {
            let pixel = question.pixel([x, y]);
            let point = points.iter().find(|point| point.pixel == pixel);
            if let Some(point) = point {
                data[(y * width + x) as usize] = (1.0 - point.occlusion - darker) as f32;
            }
        }
    }
    Pixels { width, height, channels: 1, data }
}

#[test]
fn a_buffer_that_holds_the_reference_has_no_error_and_a_darker_one_its_bias() {
    for scale in [1, 2] {
        let question = question(scale);
        let points = points(&question, 400);
        assert!((300..440).contains(&points.len()), "{}", points.len());
        let figures_of = |darker: f64| {
            let buffer = buffer(&question, &points, darker);
            figures("ao", "ao/march", &errors(&question, &points, &buffer)).map(|f| f.value)
        };
        let [rmse, _] = figures_of(0.0);
        assert!(rmse < 1e-6, "{rmse}");
        let [rmse, bias] = figures_of(0.1);
        assert!((bias - 0.1).abs() < 1e-6 && (rmse - 0.1).abs() < 1e-6, "{bias} {rmse}");
    }
}

#[test]
fn errors_are_painted_red_where_too_dark() {
    assert_eq!(color(0.0), [255, 255, 255]);
    assert_eq!(color(0.3), [255, 0, 0]);
    assert_eq!(color(-0.125), [128, 128, 255]);
    let question = question(1);
    let points = points(&question, 100);
    let picture = paint(&question, &points, &vec![0.3; points.len()], color);
    let red = picture.pixels().filter(|pixel| pixel.0 == [255, 0, 0]);
    // The lattice's blocks touch: nearly all that is seen is painted.
    assert!(red.count() > 48 * 40 / 2);
}

#[test]
fn points_behind_glass_are_judged_and_glass_is_not() {
    let mut question = question(1);
    let plain = points(&question, 400);
    let objects = {
        let mut objects = corner();
        let [a, b] = [DVec3::Y * 2.0, DVec3::Z * 2.0];
        // Between the camera and the corner.
        let pane = Mesh::parallelogram(DVec3::new(2.5, 1.5, 1.0), a, b);
        objects.push(Object::new("pane", pane));
        objects
    };
    question.opaque.push(false);
    question.alphas.push(0.3);
    question.model = RayModel::Through;
    let tracer = Tracer::new(&objects);
    let bare = Tracer::new(&corner());
    let [depth, normal] = gbuffer(&bare, &question.camera, question.size_px);
    let through = cast(&question, &tracer, &depth, &normal, 400, 64);
    assert_eq!(through.len(), plain.len());
    let clear = OcclusionQuery { alphas: vec![1.0, 1.0, 0.0], ..question.clone() };
    let clear = cast(&clear, &tracer, &depth, &normal, 400, 64);
    let opaque = OcclusionQuery { alphas: vec![1.0; 3], ..question };
    let opaque = cast(&opaque, &tracer, &depth, &normal, 400, 64);
    let sum = |points: &[JudgedPoint]| points.iter().map(|p| p.occlusion).sum::<f64>();
    let [clear, third, opaque] = [sum(&clear), sum(&through), sum(&opaque)];
    assert!(clear < opaque, "{clear} {opaque}");
    // Alone between a point and the sky, glass counts by its opacity; before the wall it adds nothing.
    assert!((third - clear - 0.3 * (opaque - clear)).abs() < 1e-9, "{clear} {third} {opaque}");
}

#[test]
fn moving_geometry_is_judged_where_it_is() {
    let scene = Arc::new(Scene::load("ball").unwrap());
    let spun = Animation { deform: Deform::Wave, time_s: 1.0, ..Animation::default() };
    let cache = GeometryCache::default();
    let at = |tracer: &Tracer| {
        let eye = DVec3::from(scene.camera.position_m);
        let ball = scene.objects[1].mesh.bounds().center();
        tracer.cast(eye, (ball - eye).normalize(), 0.0, 100.0).unwrap().distance_m
    };
    let rest = at(&cache.tracer(&scene, &Animation::default()));
    let moved = at(&cache.tracer(&scene, &spun));
    assert!((rest - moved).abs() > 0.01, "{rest} {moved}");
}
