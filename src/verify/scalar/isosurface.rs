//! `scalar/isosurface` on a ball and a slab whose boundaries are known.

use glam::DVec3;

use super::{ScalarPicture, Setup, VOXEL_M, cubes, looking, settings};
use crate::{Case, Check, Checks, Result, Rig, VerifyError, largest, mean};
use fathom_pipelines::scalar_ao::{Gather, Mode, Scalar, Stop};
use fathom_reference::isosurface::{Solid, first, occlusion};
use fathom_reference::media::{Law, Marching};
use fathom_reference::occlusion::Attenuation;
use fathom_reference::rays::PixelRays;
use fathom_scene::Volume;

const STAGE: &str = "scalar/isosurface";
const SIZE: [u32; 2] = [64, 64];
const CELLS: u32 = 48;
/// The field falls from 1 to 0 over this distance around the boundary: a blurred solid.
const RAMP_M: f64 = 4.0 * VOXEL_M;
const BALL: Solid = Solid::Ball { centre: DVec3::new(0.03, 0.01, -0.02), radius_m: 1.0 };
const SLAB: Solid = Solid::Slab { top_m: -1.23 };
const R_MAX_M: f64 = 1.6;
/// Rays along each side of the reference's grid.
const SIDE: u32 = 48;
/// Every n-th pixel is judged by casting.
const STRIDE: usize = 5;
/// The picture's.
const DISPLAY_GAMMA: f64 = 2.2;
/// Pixels whose ray grazes a boundary are left out: the field rounds off what a ray just touches.
const GRAZING: f64 = 0.2;

pub fn cases() -> Vec<Case> {
    vec![
        Case::new(STAGE, "a ball: where rays hit, and the normal there", ball),
        Case::new(STAGE, "a ball over a slab: the light it shows", shading),
        Case::new(STAGE, "a ball over a slab: ambient occlusion", ball_over_slab),
        Case::new(STAGE, "a ball over a slab: rejection sampling", rejection),
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
    let hit = |pixel: usize| {
        let (x, y) = (pixel as u32 % SIZE[0], pixel as u32 / SIZE[0]);
        let (origin, direction, _) = rays.ray(x, y);
        let (solid, distance_m) = first(solids, origin, direction)?;
        let position = origin + direction * distance_m;
        let normal = solid.normal(position);
        // Away from the box's sides, which cut the slab and what occludes it.
        let margin = DVec3::new(2.0, 2.0, 2.0) * VOXEL_M;
        let inside =
            position.cmpge(bounds.min + margin).all() && position.cmple(bounds.max - margin).all();
        let judged = inside && -normal.dot(direction) > GRAZING;
        judged.then_some(Hit { pixel, direction, position, normal })
    };
    (0..(SIZE[0] * SIZE[1]) as usize).filter_map(hit).collect()
}

fn ball(rig: &Rig<'_>) -> Checks {
    let scalar = Scalar { rays: 1, samples: 1, ..settings(Mode::Isosurface) };
    let setup = setup(&[BALL], scalar);
    let seen = setup.run(rig)?;
    let Solid::Ball { centre, radius_m } = BALL else {
        unreachable!("it is a ball");
    };
    let larger = Solid::Ball { centre, radius_m: radius_m + 0.2 * VOXEL_M };
    let moved = Solid::Ball { centre: centre + DVec3::Y * 0.5 * VOXEL_M, radius_m };
    let judged = hits(&setup, &[BALL]);
    let eye = setup.camera.position();
    let distance = |solid: Solid| {
        let off = |h: &Hit| {
            let met = eye + h.direction * seen.distance_m.data()[h.pixel];
            solid.distance(met).abs() / VOXEL_M
        };
        percentile(judged.iter().map(off))
    };
    let normal = |solid: Solid| {
        let off = |h: &Hit| seen.normal_at(h.pixel).angle_between(solid.normal(h.position));
        percentile(judged.iter().map(|h| off(h).to_degrees()))
    };
    if judged.is_empty() {
        return Err(VerifyError::Empty { stage: STAGE, what: "a ball".into() });
    }
    Ok(vec![
        Check::of(STAGE, "distance of hits from the boundary, 95th percentile")
            .within((0.1, "voxel"), distance(BALL))
            .control("radius 0.2 voxels larger", distance(larger))
            .with("pixels", judged.len() as f64),
        Check::of(STAGE, "error of the normal, 95th percentile")
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

fn percentile(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values[(values.len() - 1) * 95 / 100]
}

/// γ of Eq. 7 with Eq. 4, against f64 marching of the same field from where the rays exactly hit.
fn rejection(rig: &Rig<'_>) -> Checks {
    let solids = [BALL, SLAB];
    let check = |(samples, step): (u32, &str)| {
        let all = settings(Mode::Isosurface);
        let gather = Gather::Rejection;
        // Of full opacity a single sample would end every ray.
        let scalar = Scalar { gather, samples, threshold: 0.8, opacity: 0.3, rays: 64, ..all };
        let setup = setup(&solids, scalar);
        let visibility = setup.run(rig)?.visibility;
        let judged: Vec<Hit> = hits(&setup, &solids).into_iter().step_by(STRIDE).collect();
        // The twin's values are opacities.
        let mut field = setup.volume.clone();
        field.data.iter_mut().for_each(|v| *v *= 0.3);
        let twin = |samples: u32, rejection: bool| Marching {
            law: Law::Opacity { voxel_m: VOXEL_M },
            r_max_m: R_MAX_M,
            samples,
            rejection,
            threshold: 0.8 * 0.3,
        };
        let error = |twin: &Marching| {
            let off = |h: &Hit| {
                let exact = twin.hemispherical(&field, h.position, h.normal, 256);
                (1.0 - visibility.data()[h.pixel] - exact).abs()
            };
            mean(judged.iter().map(off))
        };
        let mean_occlusion = mean(judged.iter().map(|h| 1.0 - visibility.data()[h.pixel]));
        Ok(Check::of(
            STAGE,
            format!("rejection, strata of {step}: mean error of A against f64 marching"),
        )
        .within((0.02, "1"), error(&twin(samples, true)))
        .control("no sample rejected", error(&twin(samples, false)))
        .with("mean_occlusion", mean_occlusion))
    };
    // R_MAX_M is 16 voxels.
    [(32, "half a voxel"), (8, "two voxels")].into_iter().map(check).collect()
}

fn ball_over_slab(rig: &Rig<'_>) -> Checks {
    let solids = [BALL, SLAB];
    let check = |(stop, what)| {
        let (threshold, tolerance) = (0.5, 0.15);
        let all = settings(Mode::Isosurface);
        let scalar = Scalar { stop, threshold, tolerance, rays: 64, samples: 24, ..all };
        let setup = setup(&solids, scalar);
        let visibility = setup.run(rig)?.visibility;
        let judged: Vec<Hit> = hits(&setup, &solids).into_iter().step_by(STRIDE).collect();
        let exact = |r_max_m: f64| -> Vec<f64> {
            let at = |h: &Hit| {
                occlusion(&solids, h.position, h.normal, r_max_m, Attenuation::Linear, SIDE)
            };
            judged.iter().map(at).collect()
        };
        let measured: Vec<f64> = judged.iter().map(|h| 1.0 - visibility.data()[h.pixel]).collect();
        let error = |exact: &[f64]| mean(measured.iter().zip(exact).map(|(a, b)| (a - b).abs()));
        let truth = exact(R_MAX_M);
        let open = vec![0.0; truth.len()];
        Ok(Check::of(STAGE, format!("rays end at {what}: mean error of A"))
            .within((0.02, "1"), error(&truth))
            .control("nothing occluded", error(&open))
            .with("mean_signed_error", mean(measured.iter().zip(&truth).map(|(a, b)| a - b)))
            .with("mean_occlusion", mean(truth.iter().copied()))
            .with("error_at_half_r_max", error(&exact(R_MAX_M / 2.0)))
            .with("pixels", judged.len() as f64))
    };
    [(Stop::Threshold, "V ≥ V_thres"), (Stop::Isosurface, "|V − iso| < tolerance")]
        .into_iter()
        .map(check)
        .collect()
}

/// The picture against what visibility and normals make of the light: albedo × visibility × light.
fn shading(rig: &Rig<'_>) -> Result<Check> {
    const ALBEDO: f64 = 0.5;
    let scalar = Scalar {
        low_color: [ALBEDO as f32; 3],
        high_color: [ALBEDO as f32; 3],
        samples: 24,
        ..settings(Mode::Isosurface)
    };
    let solids = [BALL, SLAB];
    let setup = setup(&solids, scalar);
    let seen = setup.run(rig)?;
    let to_light = -setup.view()?.light_frame().forward;
    let error = |ambient: f64| {
        let off = |h: &Hit| {
            let facing = seen.normal_at(h.pixel).dot(to_light).max(0.0);
            let light = facing + (1.0 - facing) * ambient;
            let radiance = ALBEDO * seen.visibility.data()[h.pixel] * light;
            (radiance.powf(1.0 / DISPLAY_GAMMA) - seen.shown.data()[h.pixel]).abs()
        };
        largest(hits(&setup, &solids).iter().map(off))
    };
    let ambient = setup.scalar.ambient;
    // A step of 8 bits, and normals of 16 bits.
    let tolerance = (1.5 / 255.0, "1");
    Ok(Check::of(STAGE, "albedo × visibility × light: largest error of the picture")
        .within(tolerance, error(ambient))
        .control("a tenth more ambient light", error(ambient * 1.1)))
}
