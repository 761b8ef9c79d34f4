//! `scalar/isosurface` on a ball and between two planes, whose boundaries are known.

use super::*;
use fathom_pipelines::scalar_ao::Stop;
use fathom_pipelines::settings::Attenuation;

const STAGE: &str = "scalar/isosurface";
const SIZE: [u32; 2] = [64, 64];
const CELLS: u32 = 48;
/// The field falls from 1 to 0 over this distance around the boundary: a blurred solid.
const RAMP_M: f64 = 4.0 * VOXEL_M;
const CENTRE: DVec3 = DVec3::new(0.03, 0.01, -0.02);
const RADIUS_M: f64 = 1.0;
const R_MAX_M: f64 = 1.6;
/// Pixels whose ray grazes a boundary are left out: the field rounds off what a ray just touches.
const GRAZING: f64 = 0.2;

pub fn cases() -> Vec<Case> {
    vec![
        Case::new(STAGE, "a ball: where rays hit, and the normal there", ball),
        Case::new(STAGE, "gaps between two planes", gaps),
    ]
}

/// 1 inside, 0 outside, 1/2 on the boundary, linear between.
fn setup(distance_m: impl Fn(DVec3) -> f64, scalar: Scalar) -> Setup {
    Setup {
        volume: cubes(CELLS, |p| 0.5 - distance_m(p) / RAMP_M),
        scalar: Scalar { iso: 0.5, r_max_m: R_MAX_M, view_step_voxels: 0.7, ..scalar },
        camera: looking(DVec3::new(2.5, 2.2, 5.0), DVec3::new(0.0, -0.4, 0.0)),
        size_px: SIZE,
    }
}

fn ball(rig: &Rig<'_>) -> Checks {
    let scalar = Scalar { rays: 1, samples: 1, ..settings(Mode::Isosurface) };
    let setup = setup(|p| p.distance(CENTRE) - RADIUS_M, scalar);
    let seen = setup.run(rig)?;
    let rays = PixelRays::new(&setup.camera, SIZE[0], SIZE[1]);
    let eye = setup.camera.position();
    // Pixel, direction and exact place of each hit.
    let hit = |(pixel, (x, y)): (usize, (u32, u32))| {
        let (_, direction, _) = rays.ray(x, y);
        let nearest = (CENTRE - eye).dot(direction);
        let beside = CENTRE.distance(eye + direction * nearest);
        let half = (RADIUS_M * RADIUS_M - beside * beside).sqrt();
        let place = eye + direction * (nearest - half);
        (half > GRAZING * RADIUS_M).then_some((pixel, direction, place))
    };
    let judged: Vec<_> = pixels(SIZE).enumerate().filter_map(hit).collect();
    let distance = |radius_m: f64| {
        percentile::<95>(judged.iter().map(|(pixel, direction, _)| {
            let met = eye + direction * seen.distance_m.data()[*pixel];
            (met.distance(CENTRE) - radius_m).abs() / VOXEL_M
        }))
    };
    let normal = |centre: DVec3| {
        percentile::<95>(judged.iter().map(|(pixel, _, place)| {
            let axis = |i: usize| seen.normal.as_ref().map_or(0.0, |n| n[i].data()[*pixel]);
            let found = DVec3::new(axis(0), axis(1), axis(2));
            found.angle_between(place - centre).to_degrees()
        }))
    };
    Ok(vec![
        Check::new(rig, "distance of hits from the boundary, 95th percentile")
            .within((0.1, "voxel"), distance(RADIUS_M))
            .control("radius 0.2 voxels larger", distance(RADIUS_M + 0.2 * VOXEL_M)),
        Check::new(rig, "error of the normal, 95th percentile")
            .within((1.5, "°"), normal(CENTRE))
            .control("centre half a voxel higher", normal(CENTRE + DVec3::Y * 0.5 * VOXEL_M)),
    ])
}

/// The mean A of a plane below another at a distance g is (1 − g / r_max)², and 1 − (g / r_max)² of hard attenuation.
fn gaps(rig: &Rig<'_>) -> Checks {
    let check = |(share, samples, stop, attenuation): (f64, u32, Stop, Attenuation)| {
        let half_m = 0.5 * share * R_MAX_M;
        let (threshold, tolerance) = (0.5, 0.02);
        let all = settings(Mode::Isosurface);
        let scalar = Scalar { threshold, tolerance, rays: 64, samples, stop, attenuation, ..all };
        let camera = looking(DVec3::Z, DVec3::new(0.0, -half_m, 0.6));
        let between = setup(|p| half_m - p.y.abs(), scalar);
        let setup = Setup { camera, size_px: [16; 2], ..between };
        let a = 1.0 - setup.run(rig)?.visibility.mean();
        let law = |share: f64| match attenuation {
            Attenuation::Linear => (1.0 - share).powi(2),
            Attenuation::Hard => 1.0 - share * share,
        };
        let off = |share: f64| (a - law(share)).abs();
        let settings = format!("{stop:?}, {attenuation:?}").to_lowercase();
        let what =
            format!("a gap of {share} r_max, {samples} samples, {settings}: error of the mean A");
        Ok(Check::new(rig, what)
            .within((0.01, "1"), off(share))
            .control("a gap a voxel wider", off(share + VOXEL_M / R_MAX_M))
            .with("occlusion", a))
    };
    let plain = [(0.3, 8), (0.5, 8), (0.75, 8), (0.5, 3), (0.5, 40)];
    let hard = (0.5, 8, Stop::Threshold, Attenuation::Hard);
    let thin = (0.5, 320, Stop::Isosurface, Attenuation::Linear);
    let plain = plain.map(|(g, samples)| (g, samples, Stop::Threshold, Attenuation::Linear));
    plain.into_iter().chain([hard, thin]).map(check).collect()
}
