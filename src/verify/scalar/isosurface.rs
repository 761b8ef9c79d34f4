//! `scalar/isosurface` on a ball and a slab whose boundaries are known.

use super::*;
use fathom_pipelines::scalar_ao::Stop;
use fathom_pipelines::settings::Attenuation;
use fathom_reference::isosurface::{Solid, first, occlusion};
use fathom_reference::occlusion::Obscurity;

const STAGE: &str = "scalar/isosurface";
const SIZE: [u32; 2] = [64, 64];
const CELLS: u32 = 48;
/// The field falls from 1 to 0 over this distance around the boundary: a blurred solid.
const RAMP_M: f64 = 4.0 * VOXEL_M;
const CENTRE: DVec3 = DVec3::new(0.03, 0.01, -0.02);
const RADIUS_M: f64 = 1.0;
const BALL: Solid = Solid::Ball { centre: CENTRE, radius_m: RADIUS_M };
const BALL_AND_SLAB: [Solid; 2] = [BALL, Solid::Slab { top_m: -1.23 }];
const R_MAX_M: f64 = 1.6;
/// Rays along each side of the reference's grid.
const SIDE: u32 = 48;
/// Every n-th pixel is judged by casting.
const STRIDE: usize = 11;
/// Pixels whose ray grazes a boundary are left out: the field rounds off what a ray just touches.
const GRAZING: f64 = 0.2;

pub fn cases() -> Vec<Case> {
    vec![
        Case::new(STAGE, "a ball: where rays hit, and the normal there", ball),
        Case::new(STAGE, "a ball over a slab: ambient occlusion", ball_over_slab),
        Case::new(STAGE, "gaps between two planes", gaps),
    ]
}

/// 1 inside, 0 outside, 1/2 on the boundary, linear between.
fn blurred(solids: &[Solid]) -> Volume {
    cubes(CELLS, |p| {
        let nearest = solids.iter().map(|s| s.distance(p)).fold(f64::MAX, f64::min);
        0.5 - nearest / RAMP_M
    })
}

fn setup(solids: &[Solid], scalar: Scalar) -> Setup {
    Setup {
        volume: blurred(solids),
        scalar: Scalar { iso: 0.5, r_max_m: R_MAX_M, view_step_voxels: 0.7, ..scalar },
        camera: looking(DVec3::new(2.5, 2.2, 5.0), DVec3::new(0.0, -0.4, 0.0)),
        size_px: SIZE,
    }
}

/// A pixel whose ray meets a solid within the box, and what is exact there.
struct Hit {
    pixel: usize,
    /// Of the view ray.
    direction: DVec3,
    position: DVec3,
    normal: DVec3,
}

fn hits(setup: &Setup, solids: &[Solid]) -> Vec<Hit> {
    let rays = PixelRays::new(&setup.camera, SIZE[0], SIZE[1]);
    let bounds = setup.volume.bounds();
    let hit = |(pixel, (x, y)): (usize, (u32, u32))| {
        let (origin, direction, _) = rays.ray(x, y);
        let (solid, distance_m) = first(solids, origin, direction)?;
        let position = origin + direction * distance_m;
        let normal = solid.normal(position);
        // Away from the box's sides, which cut the slab and what occludes it.
        let margin = DVec3::splat(2.0 * VOXEL_M);
        let inside =
            position.cmpge(bounds.min + margin).all() && position.cmple(bounds.max - margin).all();
        let judged = inside && -normal.dot(direction) > GRAZING;
        judged.then_some(Hit { pixel, direction, position, normal })
    };
    pixels(SIZE).enumerate().filter_map(hit).collect()
}

fn ball(rig: &Rig<'_>) -> Checks {
    let scalar = Scalar { rays: 1, samples: 1, ..settings(Mode::Isosurface) };
    let setup = setup(&[BALL], scalar);
    let seen = setup.run(rig)?;
    let larger = Solid::Ball { centre: CENTRE, radius_m: RADIUS_M + 0.2 * VOXEL_M };
    let moved = Solid::Ball { centre: CENTRE + DVec3::Y * 0.5 * VOXEL_M, radius_m: RADIUS_M };
    let judged = hits(&setup, &[BALL]);
    if judged.is_empty() {
        return Err(rig.empty("a ball"));
    }
    let eye = setup.camera.position();
    let distance = |solid: Solid| {
        percentile::<95>(judged.iter().map(|h| {
            let met = eye + h.direction * seen.distance_m.data()[h.pixel];
            solid.distance(met).abs() / VOXEL_M
        }))
    };
    let normal =
        |solid: Solid| {
            percentile::<95>(judged.iter().map(|h| {
                seen.normal_at(h.pixel).angle_between(solid.normal(h.position)).to_degrees()
            }))
        };
    Ok(vec![
        Check::new(rig, "distance of hits from the boundary, 95th percentile")
            .within((0.1, "voxel"), distance(BALL))
            .control("radius 0.2 voxels larger", distance(larger))
            .with("pixels", judged.len() as f64),
        Check::new(rig, "error of the normal, 95th percentile")
            .within((1.5, "°"), normal(BALL))
            .control("centre half a voxel higher", normal(moved)),
    ])
}

impl ScalarPicture {
    fn normal_at(&self, pixel: usize) -> DVec3 {
        let axis = |i: usize| self.normal.as_ref().map_or(0.0, |n| n[i].data()[pixel]);
        DVec3::new(axis(0), axis(1), axis(2))
    }
}

/// Some of the pixels of a ball over a slab.
fn ball_over_slab(rig: &Rig<'_>) -> Checks {
    let check = |(what, stop, attenuation): (&str, Stop, Attenuation)| {
        let (threshold, tolerance, rays, samples) = (0.5, 0.15, 96, 24);
        let all = settings(Mode::Isosurface);
        let scalar = Scalar { stop, attenuation, threshold, tolerance, rays, samples, ..all };
        let setup = setup(&BALL_AND_SLAB, scalar);
        let visibility = setup.run(rig)?.visibility;
        let obscurity = match attenuation {
            Attenuation::Linear => Obscurity::Linear,
            Attenuation::Hard => Obscurity::Hard,
        };
        let judged: Vec<Hit> = hits(&setup, &BALL_AND_SLAB).into_iter().step_by(STRIDE).collect();
        let a = |h: &Hit| 1.0 - visibility.data()[h.pixel];
        let off = |h: &Hit| {
            a(h) - occlusion(&BALL_AND_SLAB, h.position, h.normal, R_MAX_M, obscurity, SIDE)
        };
        Ok(Check::new(rig, format!("rays end at {what}: mean error of A"))
            .within((0.02, "1"), mean(judged.iter().map(|h| off(h).abs())))
            .control("nothing occluded", mean(judged.iter().map(a)))
            .with("mean_signed_error", mean(judged.iter().map(off)))
            .with("pixels", judged.len() as f64))
    };
    [
        ("V ≥ V_thres", Stop::Threshold, Attenuation::Linear),
        ("V ≥ V_thres, hard", Stop::Threshold, Attenuation::Hard),
        ("|V − iso| < tolerance", Stop::Isosurface, Attenuation::Linear),
    ]
    .into_iter()
    .map(check)
    .collect()
}

/// The mean A of a plane below another at a distance g is (1 − g / r_max)².
fn gaps(rig: &Rig<'_>) -> Checks {
    let found = |share: f64, samples: u32| -> Result<f64> {
        let half_m = 0.5 * share * R_MAX_M;
        let scalar = Scalar { threshold: 0.5, rays: 64, samples, ..settings(Mode::Isosurface) };
        let camera = looking(DVec3::Z, DVec3::new(0.0, -half_m, 0.6));
        let volume = cubes(CELLS, |p| 0.5 - (half_m - p.y.abs()) / RAMP_M);
        let setup = Setup { volume, camera, size_px: [16; 2], ..setup(&[], scalar) };
        Ok(1.0 - setup.run(rig)?.visibility.mean())
    };
    let check = |(share, samples): (f64, u32)| {
        let a = found(share, samples)?;
        let off = |share: f64| (a - (1.0 - share).powi(2)).abs();
        let what = format!("a gap of {share} r_max, {samples} samples: error of the mean A");
        Ok(Check::new(rig, what)
            .within((0.01, "1"), off(share))
            .control("a gap a voxel wider", off(share + VOXEL_M / R_MAX_M))
            .with("occlusion", a))
    };
    [(0.3, 8), (0.5, 8), (0.75, 8), (0.5, 3), (0.5, 40)].into_iter().map(check).collect()
}
