//! `scalar/direct` and `scalar/positional` against closed forms and f64 marching.

use super::*;
use fathom_reference::media::{self, FieldMarch, occlusion_on_ramp};

const DIRECT: &str = "scalar/direct";
const POSITIONAL: &str = "scalar/positional";
/// Pixels of a probe: each draws its own rays.
const PROBE_PX: [u32; 2] = [16, 16];
const RAYS: u32 = 64;
const TWIN_RAYS: u32 = 16384;
/// Sampling noise of 16 × 16 × 64 low-discrepancy rays is below 10⁻³; strata and 8-bit values add as much again.
const TOLERANCE: f64 = 4e-3;
const BLOCK: f64 = 13.0 / 255.0;

pub fn cases() -> Vec<Case> {
    vec![
        Case::new(DIRECT, "light through a homogeneous block", block),
        Case::new(DIRECT, "occlusion on a ramp of density", ramp),
        Case::new(DIRECT, "occlusion in a rough field of long cells", rough_hemisphere),
        Case::new(POSITIONAL, "occlusion inside a homogeneous block", interior),
        Case::new(POSITIONAL, "occlusion inside an opaque block", opaque),
        Case::new(POSITIONAL, "occlusion in a rough field of long cells", rough_sphere),
        Case::new(POSITIONAL, "strata of two voxels in the average pyramid", pyramid),
        Case::new(DIRECT, "rays of several passes", |rig| many_rays(rig, Mode::Direct)),
        Case::new(POSITIONAL, "rays of several passes", |rig| many_rays(rig, Mode::Positional)),
    ]
}

fn marched(mode: Mode, law: Law, r_max_m: f64, samples: u32) -> Scalar {
    Scalar { law, r_max_m, samples, rays: RAYS, density_per_m: 4.0, ..settings(mode) }
}

/// The law as the reference has it.
fn reference_law(scalar: &Scalar, volume: &Volume) -> media::FieldLaw {
    match scalar.law {
        Law::Opacity => media::FieldLaw::Opacity { voxel_m: opacity_voxel_m(volume) },
        Law::Beer => media::FieldLaw::Beer { density_per_m: scalar.density_per_m },
    }
}

/// Mean A that the stage finds at a point.
fn measured(rig: &Rig<'_>, volume: &Volume, scalar: &Scalar, point: DVec3) -> Result<f64> {
    let (volume, scalar) = (volume.clone(), scalar.clone());
    let setup = Setup { volume, scalar, camera: probe(point), size_px: PROBE_PX };
    Ok(1.0 - setup.run(rig)?.visibility.mean())
}

const LAWS: [Law; 2] = [Law::Opacity, Law::Beer];

fn name(law: Law) -> &'static str {
    match law {
        Law::Opacity => "opacities (Eq. 7)",
        Law::Beer => "densities (Eq. 5)",
    }
}

/// A homogeneous block, seen from outside.
fn seen_block(scalar: Scalar, side_px: u32) -> Setup {
    Setup {
        volume: field([20, 16, 12], DVec3::new(0.1, 0.12, 0.15), |_| BLOCK),
        scalar,
        camera: looking(DVec3::new(2.0, 1.5, 4.0), DVec3::ZERO),
        size_px: [side_px; 2],
    }
}

fn block(rig: &Rig<'_>) -> Checks {
    let check = |law: Law| {
        let setup = seen_block(marched(Mode::Direct, law, 0.3, 2), 48);
        let opacity = setup.run(rig)?.opacity;
        let rays = PixelRays::new(&setup.camera, 48, 48);
        let exact = reference_law(&setup.scalar, &setup.volume);
        let error = |value: f64| {
            largest(pixels([48, 48]).map(|(x, y)| {
                let (origin, direction, _) = rays.ray(x, y);
                let chord_m = chord_m(&setup.volume.bounds(), origin, direction);
                (opacity.get((x, y)) - exact.opacity(value, chord_m)).abs()
            }))
        };
        Ok(Check::new(rig, format!("{}: largest error of opacity along the view", name(law)))
            .within((1e-3, "1"), error(BLOCK))
            .control("values 2 % higher", error(BLOCK * 1.02))
            .with("opacity_most", largest(opacity.data().iter().copied())))
    };
    LAWS.into_iter().map(check).collect()
}

/// More rays at the steps along a view ray than an adapter may make turns of an invocation's loops: the stages take several passes.
const MANY_RAYS: u32 = 1024;

/// The pass of few rays against the passes of many.
fn many_rays(rig: &Rig<'_>, mode: Mode) -> Checks {
    let run = |rays: u32, r_max_m: f64| {
        seen_block(Scalar { rays, ..marched(mode, Law::Beer, r_max_m, 8) }, 8).run(rig)
    };
    let (many, few, longer) = (run(MANY_RAYS, 0.6)?, run(16, 0.6)?, run(16, 0.8)?);
    let off = |other: &ScalarPicture| (many.visibility.mean() - other.visibility.mean()).abs();
    let black = Image::constant(8, 8, 0.0);
    let check = |what: &str| Check::new(rig, format!("{MANY_RAYS} rays: {what}"));
    Ok(vec![
        check("mean visibility against that with 16 rays")
            .within((TOLERANCE, "1"), off(&few))
            .control("16 rays of 4/3 of the length", off(&longer))
            .with("visibility", many.visibility.mean()),
        check("largest change of opacity")
            .within((1e-6, "1"), apart(&many.opacity, &few.opacity))
            .control("no steps", apart(&many.opacity, &black)),
        check("largest change of distance")
            .within((1e-5, "m"), apart(&many.distance_m, &few.distance_m))
            .control("no steps", apart(&many.distance_m, &black)),
    ])
}

/// Length of a ray within a box.
fn chord_m(bounds: &Bounds, origin: DVec3, direction: DVec3) -> f64 {
    let (low, high) = ((bounds.min - origin) / direction, (bounds.max - origin) / direction);
    let enter = low.min(high).max_element().max(0.0);
    (low.max(high).min_element() - enter).max(0.0)
}

fn ramp(rig: &Rig<'_>) -> Result<Check> {
    let scalar = marched(Mode::Direct, Law::Beer, 1.0, 20);
    // 0.5 at the origin; steps of 8 bits are whole.
    let volume = cubes(32, |p| (128.0 - 60.0 * p.z) / 255.0);
    let a = measured(rig, &volume, &scalar, DVec3::ZERO)?;
    let (sigma, fall) = (4.0 * 128.0 / 255.0, 4.0 * 60.0 / 255.0);
    let exact = occlusion_on_ramp(sigma, fall, 1.0);
    Ok(Check::new(rig, "Eq. 3 against its integral: relative error")
        .within((1e-2, "1"), relative_error(a, exact))
        .control(
            "the sum without the factor 2 of uniform directions",
            relative_error(a, exact / 2.0),
        )
        .with("occlusion", exact))
}

/// Random values on cells twice as long as wide.
fn rough() -> Volume {
    let mut random = Random::new(11);
    let mut volume = field([16, 16, 12], DVec3::new(0.1, 0.1, 0.2), |_| 0.0);
    volume.data.fill_with(|| random.within(0.0, 0.5) as f32);
    volume
}

fn twin(scalar: &Scalar, volume: &Volume) -> FieldMarch {
    let law = reference_law(scalar, volume);
    let &Scalar { r_max_m, samples, rejection, .. } = scalar;
    FieldMarch { law, r_max_m, samples, rejection, threshold: f64::INFINITY }
}

const ROUGH_POINT: DVec3 = DVec3::new(0.13, -0.07, 0.11);

fn rough_hemisphere(rig: &Rig<'_>) -> Checks {
    let volume = rough();
    let normal = -gradient(&volume, ROUGH_POINT).normalize();
    rough_checks(rig, Mode::Direct, |marching, rays| {
        marching.hemispherical(&volume, ROUGH_POINT, normal, rays)
    })
}

fn rough_sphere(rig: &Rig<'_>) -> Checks {
    let volume = rough();
    rough_checks(rig, Mode::Positional, |marching, rays| {
        marching.positional(&volume, ROUGH_POINT, rays)
    })
}

/// Both laws, with rejection and with V_thres within the field's range.
fn rough_checks(rig: &Rig<'_>, mode: Mode, exact: impl Fn(&FieldMarch, u32) -> f64) -> Checks {
    let volume = rough();
    let check = |law: Law| {
        let mut scalar = Scalar { rejection: true, ..marched(mode, law, 0.7, 8) };
        // Beer's threshold is the opacity over a voxel of the value that ends rays.
        let ends_at = 0.45;
        scalar.threshold = match law {
            Law::Opacity => ends_at,
            Law::Beer => reference_law(&scalar, &volume).opacity(ends_at, opacity_voxel_m(&volume)),
        };
        let a = measured(rig, &volume, &scalar, ROUGH_POINT)?;
        let error = |rejection: bool| {
            let twin = FieldMarch { threshold: ends_at, rejection, ..twin(&scalar, &volume) };
            (a - exact(&twin, TWIN_RAYS)).abs()
        };
        let what = format!("{}: A with rejection and V_thres against f64 marching", name(law));
        Ok(Check::new(rig, what)
            .within((TOLERANCE, "1"), error(true))
            .control("no sample rejected", error(false))
            .with("occlusion", a))
    };
    LAWS.into_iter().map(check).collect()
}

/// Central differences one cell to each side, as the stage takes its normals.
fn gradient(volume: &Volume, p: DVec3) -> DVec3 {
    let along = |axis: DVec3| {
        let step = axis.dot(volume.spacing_m);
        (media::interpolated(volume, p + axis * step)
            - media::interpolated(volume, p - axis * step))
            / (2.0 * step)
    };
    DVec3::new(along(DVec3::X), along(DVec3::Y), along(DVec3::Z))
}

fn interior(rig: &Rig<'_>) -> Checks {
    let volume = cubes(32, |_| BLOCK);
    let check = |law: Law| {
        let scalar = marched(Mode::Positional, law, 1.2, 8);
        let a = measured(rig, &volume, &scalar, DVec3::ZERO)?;
        let exact = reference_law(&scalar, &volume);
        let error = |value: f64| (a - exact.opacity(value, 1.2)).abs();
        Ok(Check::new(rig, format!("{}: A_P within a homogeneous block", name(law)))
            .within((1e-4, "1"), error(BLOCK))
            .control("values 1 % higher", error(BLOCK * 1.01))
            .with("occlusion", a))
    };
    LAWS.into_iter().map(check).collect()
}

/// Rays end where less than 1/256 comes through. That makes A too small by no more.
fn opaque(rig: &Rig<'_>) -> Checks {
    const CUT: f64 = 1.0 / 256.0;
    let check = |law: Law| {
        let error = |value: f64, share: f64| -> Result<f64> {
            let scalar = Scalar { density_per_m: 12.0, ..marched(Mode::Positional, law, 1.2, 16) };
            let volume = cubes(32, |_| value);
            let exact = reference_law(&scalar, &volume).opacity(value, 1.2);
            let scalar = Scalar { r_max_m: share * scalar.r_max_m, ..scalar };
            Ok(exact - measured(rig, &volume, &scalar, DVec3::ZERO)?)
        };
        // From a transmittance of some 1/16 over r_max to none.
        let values = [51.0, 77.0, 102.0, 153.0, 255.0].map(|byte| byte / 255.0);
        let errors =
            values.map(|value| error(value, 1.0)).into_iter().collect::<Result<Vec<_>>>()?;
        let outside = |error: f64| (error - CUT).max(-error).max(0.0);
        let what = format!("{}: A too small by more than 1/256, or too large", name(law));
        Ok(Check::new(rig, what)
            .within((1e-4, "1"), largest(errors.iter().copied().map(outside)))
            .control("half of r_max", outside(error(values[0], 0.5)?))
            .with("largest_error", largest(errors)))
    };
    LAWS.into_iter().map(check).collect()
}

fn pyramid(rig: &Rig<'_>) -> Result<Check> {
    let mut random = Random::new(5);
    let mut volume = cubes(24, |_| 0.0);
    volume.data.fill_with(|| if random.number() < 0.1 { 0.81 } else { 0.0 });
    let mut scalar = marched(Mode::Positional, Law::Opacity, 0.6, 3);
    scalar.pyramid = true;
    let a = measured(rig, &volume, &scalar, ROUGH_POINT)?;
    let marching = twin(&scalar, &volume);
    let error = |volume: &Volume| (a - marching.positional(volume, ROUGH_POINT, TWIN_RAYS)).abs();
    Ok(Check::new(rig, "A_P from the next coarser level against f64 marching of means")
        .within((TOLERANCE, "1"), error(&volume.clone().reduced(2)))
        .control("the level below", error(&volume))
        .with("occlusion", a))
}
