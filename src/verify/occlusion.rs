//! `ao/march` and `ao/query`: against the f64 twin of the marching, against closed forms, and against one another's variants.

mod edges;
mod laws;
mod orientations;
mod pixels;
mod points;

use crate::prelude::*;
use fathom_pipelines::occlusion::exact;
use fathom_reference::march::{Guard as TwinGuard, HostVolume, March};
use fathom_reference::occlusion as reference;
use fathom_stages::ao::query::{self, SurfacePoint};
use fathom_stages::marching::{Attenuation, Estimator, Guard, Hit, Marching, Occluder, Sampling};

pub fn cases() -> Vec<Case> {
    [points::cases(), laws::cases(), orientations::cases(), edges::cases(), pixels::cases()]
        .into_iter()
        .flatten()
        .collect()
}

/// Rays whose marching takes more turns than an adapter may make of an invocation's loops: see [`fathom_gpu::MOST_LOOP_TURNS`]. The
/// stages take several passes.
const MANY_RAYS: u32 = 8_192;

/// Edge of a voxel in these cases, metres.
const VOXEL_M: f64 = 0.1;

/// A volume of so many voxels a side around the origin, on the host and on the GPU.
struct MarchedVolume {
    host: HostVolume,
    voxels: Voxels,
}

impl MarchedVolume {
    /// `level`, 1 … 255, fills the voxels for whose centres `inside` holds.
    fn new(rig: &Rig<'_>, side: u32, level: u8, inside: impl Fn(DVec3) -> bool) -> Result<Self> {
        let grid =
            Grid::around(DVec3::ZERO, VOXEL_M * f64::from(side), side).map_err(GpuError::Limit)?;
        Ok(Self::on(rig, &grid, level, inside))
    }

    fn on(rig: &Rig<'_>, grid: &Grid, level: u8, inside: impl Fn(DVec3) -> bool) -> Self {
        let mut host = HostVolume::filled(grid, inside);
        let bytes: Vec<u8> = host.values.iter().map(|v| *v as u8 * level).collect();
        host.values.iter_mut().for_each(|v| *v *= f64::from(level) / 255.0);
        let voxels = Voxels::new(rig, "verify voxels", grid, true);
        voxels.write(rig, &bytes);
        Self { host, voxels }
    }
}

/// Shells about a voxel thick: a floor, a wall, and a ball above the floor that touches neither.
fn furnished(p: DVec3) -> bool {
    let shell = |distance: f64| distance.abs() < 0.5 * VOXEL_M;
    shell(p.y - FLOOR_M) || shell(p.x - WALL_M) || shell(p.distance(BALL_M) - RADIUS_M)
}

const FLOOR_M: f64 = -0.97;
const WALL_M: f64 = -1.03;
const BALL_M: DVec3 = DVec3::new(0.3, -0.2, 0.1);
const RADIUS_M: f64 = 0.5;

/// Points on floor, wall and ball with their normals, in general position.
fn furnished_points() -> Vec<(DVec3, DVec3)> {
    let mut random = Random::new(11);
    let mut within = |low, high| random.within(low, high);
    (0..96)
        .map(|i| match i % 3 {
            0 => (DVec3::new(within(-0.9, 1.2), FLOOR_M, within(-1.2, 1.2)), DVec3::Y),
            1 => (DVec3::new(WALL_M, within(-0.8, 1.2), within(-1.2, 1.2)), DVec3::X),
            _ => {
                let (sin, cos) = within(0.0, TAU).sin_cos();
                let up = within(-1.0, 1.0);
                let flat = (1.0 - up * up).sqrt();
                let normal = DVec3::new(flat * cos, up, flat * sin);
                (BALL_M + RADIUS_M * normal, normal)
            }
        })
        .map(|(p, n)| (p.as_vec3().as_dvec3(), n.as_vec3().as_dvec3()))
        .collect()
}

/// The pipeline's defaults with fewer rays, and r_max of ten voxels.
fn marching(change: impl FnOnce(&mut Marching)) -> Marching {
    let mut marching = Marching { rays: 32, r_max_m: 10.0 * VOXEL_M, ..Marching::default() };
    change(&mut marching);
    marching
}

/// The f64 twin of these settings.
fn twin(marching: &Marching, grid: &Grid) -> March {
    let guard = marching.guard.voxels();
    March {
        rays: marching.rays,
        r_max: marching.r_max_voxels(grid),
        step: marching.step_in(grid),
        threshold: marching.threshold,
        offset: marching.offset_voxels,
        guard: match marching.guard {
            Guard::Variable => TwinGuard::Above(guard),
            _ => TwinGuard::Along(guard),
        },
        attenuation: exact(marching.attenuation),
        uniform: match marching.estimator {
            Estimator::Unbiased => None,
            Estimator::Paper => Some(1.0),
            Estimator::Uniform => Some(2.0),
        },
        shift: marching.shift_voxels,
        random: marching.sampling == Sampling::Random,
        opacity: marching.occluder == Occluder::Opacity,
        exponent: marching.step_in(grid),
        peak: marching.hit == Hit::Peak,
        jitter: marching.jitter,
    }
}

/// A of points on the GPU, by `ao/query`.
fn query(
    rig: &Rig<'_>,
    volume: &Voxels,
    points: &[(DVec3, DVec3)],
    marching: &Marching,
) -> Result<Vec<f64>> {
    let points: Vec<SurfacePoint> = points
        .iter()
        .map(|(p, n)| SurfacePoint { position_m: p.as_vec3(), normal: n.as_vec3() })
        .collect();
    let stage = query::new(rig, std::slice::from_ref(volume), &points, marching)?;
    rig.run(&[&stage])?;
    let visibility: Vec<f32> = rig.read(&stage)?;
    Ok(visibility.iter().map(|v| 1.0 - f64::from(*v)).collect())
}

/// How exact V is: filtering units have 8 bits of weight along each axis.
const DENSITY_ERROR: f64 = 1.0 / 64.0;

/// How far a value lies outside the twin's values for thresholds a little above and below. A lower threshold ends rays
/// earlier and gives more occlusion: what differs by rounding of V alone lies between.
fn beyond(value: f64, march: &March, error: f64, occlusion: impl Fn(&March) -> f64) -> f64 {
    let at = |threshold: f64| occlusion(&March { threshold, ..march.clone() });
    let [low, high] = [at(march.threshold + error), at(march.threshold - error)];
    (low - value).max(value - high).max(0.0)
}
