use itertools::iproduct;

use super::*;

const SIZE: [u32; 2] = [64, 48];

fn camera(position_m: [f64; 3], target_m: [f64; 3]) -> Camera {
    Camera::new(position_m, target_m, 50.0, [0.1, 50.0])
}

fn dense(attenuation: Attenuation) -> HorizonSplit {
    let (r_max_m, layer_m) = (1.0, 1.0);
    HorizonSplit {
        directions: 32,
        steps: 48,
        rays: 0,
        ray_steps: 0,
        r_max_m,
        layer_m,
        attenuation,
        seed: 0,
    }
}

/// Depth and normals of a height field y = h(x, z) with its normals, by bisection along each pixel's ray.
fn field(
    camera: &Camera,
    height: impl Fn(f64, f64) -> f64,
    normal: impl Fn(DVec3) -> DVec3,
) -> (Image, Vec<DVec3>) {
    let rays = PixelRays::new(camera, SIZE[0], SIZE[1]);
    let (mut depths, mut normals) = (Vec::new(), Vec::new());
    for i in 0..SIZE[0] * SIZE[1] {
        let (origin, direction, _) = rays.ray(i % SIZE[0], i / SIZE[0]);
        let above = |t: f64| {
            let p = origin + direction * t;
            p.y - height(p.x, p.z)
        };
        let mut low = 0.0;
        while above(low + 0.01) > 0.0 && low < 40.0 {
            low += 0.01;
        }
        let [low, _] = crate::bisected([low, low + 0.01], 50, |t| above(t) <= 0.0);
        let p = origin + direction * low;
        depths.push(rays.project(p).unwrap().depth);
        normals.push(normal(p));
    }
    (Image::from_data(SIZE, depths), normals)
}

fn mean_occlusion(
    method: &HorizonSplit,
    camera: &Camera,
    (depth, normals): &(Image, Vec<DVec3>),
    expected: impl Fn(DVec3, DVec3) -> Option<f64>,
) -> (f64, f64) {
    let seen = SeenDepth::new(camera, depth, normals);
    let (mut bias, mut square, mut count) = (0.0, 0.0, 0.0);
    for (y, x) in iproduct!((8..SIZE[1] - 8).step_by(3), (8..SIZE[0] - 8).step_by(3)) {
        let (_, p) = seen.surface([x.into(), y.into()]);
        if let Some(exact) = expected(p, normals[(y * SIZE[0] + x) as usize]) {
            let off = method.at(&seen, SIZE, x, y).unwrap() - exact;
            bias += off;
            square += off * off;
            count += 1.0;
        }
    }
    assert!(count > 20.0);
    (bias / count, (square / count).sqrt())
}

#[test]
fn a_plane_at_any_slant_does_not_occlude_itself() {
    let camera = camera([0.0, 1.0, 1.0], [0.0, 0.0, 0.0]);
    let view = field(&camera, |_, _| 0.0, |_| DVec3::Y);
    let method = HorizonSplit { rays: 32, ray_steps: 8, ..dense(Attenuation::Hard) };
    let seen = SeenDepth::new(&camera, &view.0, &view.1);
    for (y, x) in iproduct!((0..SIZE[1]).step_by(5), (0..SIZE[0]).step_by(5)) {
        let a = method.at(&seen, SIZE, x, y).unwrap();
        assert!(a < 1e-9, "{a} at {x}, {y}");
    }
}

/// Floor y = 0 and wall x = 0, as a height field in x.
fn wall(camera: &Camera) -> (Image, Vec<DVec3>) {
    let height = |x: f64, _| if x > 0.0 { 0.0 } else { 100.0 };
    let normal = |p: DVec3| if p.x > 1e-6 { DVec3::Y } else { DVec3::X };
    field(camera, height, normal)
}

#[test]
fn a_wall_seen_from_before_it_has_its_closed_form() {
    let camera = camera([3.0, 2.6, 0.0], [0.0, 0.4, 0.0]);
    let view = wall(&camera);
    for attenuation in [Attenuation::Hard, Attenuation::Linear] {
        let expected = |p: DVec3, n: DVec3| {
            let from_edge = if n.y > 0.5 { p.x } else { p.y };
            (from_edge > 0.06).then(|| beside_wall(from_edge, attenuation))
        };
        let (bias, rms) = mean_occlusion(&dense(attenuation), &camera, &view, expected);
        assert!(bias.abs() < 0.012 && rms < 0.03, "{attenuation:?}: {bias} {rms}");
    }
}

#[test]
fn beside_the_wall_is_half_and_beyond_reach_nothing() {
    for attenuation in [Attenuation::Hard, Attenuation::Linear] {
        assert!((beside_wall(0.0, attenuation) - 0.5).abs() < 1e-6);
        assert_eq!(beside_wall(1.0, attenuation), 0.0);
    }
    // Midpoint rule over the disc's chords: ∫ (1 − k/u) 2√(1 − u²) du / π.
    let k = 0.3;
    let steps = 100_000;
    let sum: f64 = (0..steps)
        .map(|i| k + (1.0 - k) * (f64::from(i) + 0.5) / f64::from(steps))
        .map(|u| (1.0 - k / u) * 2.0 * (1.0 - u * u).sqrt() / PI)
        .sum();
    let expected = sum * (1.0 - k) / f64::from(steps);
    assert!((beside_wall(k, Attenuation::Linear) - expected).abs() < 1e-6);
}

#[test]
fn rays_find_a_ledge_that_the_horizon_leaves_out() {
    // A strip floats above the floor, a layer nearer to the camera than what lies under it.
    let camera = camera([0.0, 4.0, 0.01], [0.0, 0.0, 0.0]);
    let height = |x: f64, _| if x.abs() < 0.4 { 0.5 } else { 0.0 };
    let view = field(&camera, height, |_| DVec3::Y);
    let seen = SeenDepth::new(&camera, &view.0, &view.1);
    let split =
        |rays| HorizonSplit { rays, ray_steps: 16, layer_m: 0.3, ..dense(Attenuation::Hard) };
    let pixel = (0..SIZE[0]).find(|x| seen.surface([i64::from(*x), 24]).1.x > 0.5);
    let at = |rays| split(rays).at(&seen, SIZE, pixel.unwrap(), 24).unwrap();
    assert!(at(0) < 0.02, "{}", at(0));
    assert!(at(64) > 0.1, "{}", at(64));
}

#[test]
fn rays_are_shared_among_the_directions() {
    for (rays, directions) in [(32, 16), (18, 16), (5, 16), (0, 3)] {
        assert_eq!(rays_before(rays, directions, directions), rays);
        assert_eq!(rays_before(rays, directions, 0), 0);
    }
}
