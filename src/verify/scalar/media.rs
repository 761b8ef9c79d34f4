//! `scalar/direct` and `scalar/positional` against closed forms and f64 marching.

use super::*;
use fathom_reference::media::{self, occlusion_on_ramp};

const DIRECT: &str = "scalar/direct";
const POSITIONAL: &str = "scalar/positional";
/// Pixels of a probe: each draws its own rays.
const PROBE_PX: [u32; 2] = [16, 16];
const RAYS: u32 = 64;
/// Sampling noise of 16 × 16 × 64 low-discrepancy rays is below 10⁻³; strata and 8-bit values add as much again.
const TOLERANCE: f64 = 4e-3;
const BLOCK: f64 = 13.0 / 255.0;

pub fn cases() -> Vec<Case> {
    vec![
        Case::new(DIRECT, "light through a homogeneous block", block),
        Case::new(DIRECT, "occlusion on a ramp of density", ramp),
        Case::new(POSITIONAL, "occlusion inside a homogeneous block", interior),
        Case::new(POSITIONAL, "occlusion inside an opaque block", opaque),
        Case::new(DIRECT, "look-ups", |rig| look_ups(rig, Mode::Direct, 6)),
        Case::new(POSITIONAL, "look-ups", |rig| look_ups(rig, Mode::Positional, 0)),
        Case::new(DIRECT, "rays of several passes", |rig| many_rays(rig, Mode::Direct)),
        Case::new(POSITIONAL, "rays of several passes", |rig| many_rays(rig, Mode::Positional)),
    ]
}

fn marched(mode: Mode, law: Law, r_max_m: f64, samples: u32) -> Scalar {
    Scalar { law, r_max_m, samples, rays: RAYS, density_per_m: 4.0, ..settings(mode) }
}

/// The law as the reference has it.
pub fn reference_law(scalar: &Scalar, volume: &Volume) -> media::FieldLaw {
    match scalar.law {
        Law::Opacity => media::FieldLaw::Opacity {
            full: scalar.opacity,
            voxel_m: scalar_field::voxel_m(volume.spacing_m),
        },
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
            .control("values 2 % higher", error(BLOCK * 1.02)))
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
            .control("16 rays of 4/3 of the length", off(&longer)),
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

/// Of a view ray of one step in a homogeneous block: one each for the view and for what the rays of occlusion begin with, those of the gradient, and those of
/// rays of which none leaves the block. In an empty one the view's alone.
fn look_ups(rig: &Rig<'_>, mode: Mode, gradient: u32) -> Result<Check> {
    const SAMPLES: u32 = 8;
    let counted = |value: f64| -> Result<Image> {
        let (volume, scalar) = (cubes(32, |_| value), marched(mode, Law::Beer, 1.2, SAMPLES));
        let setup = Setup { volume, scalar, camera: probe(DVec3::ZERO), size_px: PROBE_PX };
        Ok(setup.run(rig)?.look_ups)
    };
    let (block, empty) = (counted(BLOCK)?, counted(0.0)?);
    let off = |rays: u32| {
        let exact = f64::from(2 + gradient + rays * SAMPLES);
        let of_block = block.data().iter().map(|count| (count - exact).abs());
        largest(of_block.chain(empty.data().iter().map(|count| (count - 1.0).abs())))
    };
    Ok(Check::new(rig, "look-ups of a pixel: largest error")
        .within((0.0, "1"), off(RAYS))
        .control("one more ray", off(RAYS + 1)))
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
            .within((1e-4, "1"), largest(errors.into_iter().map(outside)))
            .control("half of r_max", outside(error(values[0], 0.5)?)))
    };
    LAWS.into_iter().map(check).collect()
}
