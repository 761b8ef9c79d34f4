//! `compose`: known inputs in, and the laws of adding light and of attenuation out.

use glam::{DVec3, Vec2};

use super::rig::{self, Rig};
use super::{Case, Check, VerifyError};
use crate::reference::image::Image;
use crate::reference::rays::PixelRays;
use crate::stages::compose::{Compose, ComposeUniforms, Inputs};
use crate::stages::frame::Shared;

const STAGE: &str = "compose";
const SIZE: [u32; 2] = [96, 64];
/// Radiance is mapped by `1 − exp(−exposure · L)` and a gamma of 2.2 to 8 bits.
const EXPOSURE: f64 = 0.5;
const GAMMA_DISPLAY: f64 = 2.2;
/// Distance of the surface that fills the view, metres.
const WALL_M: f64 = 4.0;
const GAMMA_PER_M: f64 = 0.13;
/// Channel that is judged: the water's tint is strongest in blue, so that it has the best resolution.
const BLUE: usize = 2;
/// Bands of caustics (from left to right) and of godrays (from top to bottom), arbitrary units.
const CAUSTICS: [f64; 3] = [0.0, 4.0, 8.0];
const GODRAYS: [f64; 2] = [0.0, 0.4];
/// 8 bits at mid grey resolve radiance differences of this size to about 1 %.
const TOLERANCE: f64 = 0.02;

pub fn cases() -> Vec<Case> {
    vec![Case::new(
        STAGE,
        "addition and attenuation of known inputs",
        known_inputs,
    )]
}

/// Radiance in the middle of each band: `[godrays][caustics]`.
type Bands = [[f64; 3]; 2];

fn known_inputs(rig: &Rig<'_>) -> Result<Vec<Check>, VerifyError> {
    let clear = compose(rig, 0.0)?;
    let water = compose(rig, GAMMA_PER_M)?;
    let [dark, half, full] = water[0];
    let lit = |bands: &Bands| bands[0][2] - bands[0][0];
    let transmittance = |gamma: f64| (-gamma * WALL_M).exp();
    let through = lit(&water) / lit(&clear);
    let together = water[1][2] - dark;
    let parts = (full - dark) + (water[1][0] - dark);
    Ok(vec![
        Check::new(
            (STAGE, "twice the caustics, twice the light: relative error"),
            (TOLERANCE, "1"),
            ((full - dark) / (half - dark) / 2.0 - 1.0).abs(),
            (
                "2.2 times expected",
                ((full - dark) / (half - dark) / 2.2 - 1.0).abs(),
            ),
        ),
        Check::new(
            (STAGE, "caustics and godrays add up: relative error"),
            (TOLERANCE, "1"),
            (together / parts - 1.0).abs(),
            (
                "godrays counted 1.2 times",
                (together / (parts + 0.2 * (water[1][0] - dark)) - 1.0).abs(),
            ),
        ),
        Check::new(
            (STAGE, "caustics seen through 4 m of water: relative error"),
            (TOLERANCE, "1"),
            (through / transmittance(GAMMA_PER_M) - 1.0).abs(),
            (
                "attenuation 10 % higher",
                (through / transmittance(GAMMA_PER_M * 1.1) - 1.0).abs(),
            ),
        ),
    ])
}

/// Composes a white wall across a narrow view under water, with the bands upon it.
fn compose(rig: &Rig<'_>, gamma_per_m: f64) -> Result<Bands, VerifyError> {
    let mut view = rig::synthetic_view(SIZE, gamma_per_m)?;
    // So narrow that the path through the water is the same for all pixels.
    view.camera.fov_y_deg = 1.0;
    // Far below the surface, which then is not in view.
    view.camera.position_m[1] = -2.0;
    view.camera.target_m[1] = -2.0;
    let rays = PixelRays::new(&view.camera, SIZE[0], SIZE[1]);
    let eye = DVec3::from(view.camera.position_m);
    let wall = rays.project(eye + view.camera.direction() * WALL_M);

    let resources = rig.resources();
    let shared = Shared::new(&resources, &view);
    let inputs = Inputs {
        albedo: &rig.constant(SIZE, [1.0; 4])?,
        normal: &rig.constant(SIZE, [0.0, 0.0, 1.0, 1.0])?,
        depth: &rig.depth(SIZE, wall.map_or(1.0, |wall| wall.depth))?,
        caustics: &rig.grey(&banded(|x, _| CAUSTICS[(3 * x / SIZE[0]) as usize])?),
        godrays: &rig.grey(&banded(|_, y| GODRAYS[(2 * y / SIZE[1]) as usize])?),
        reflection: &rig.constant(SIZE, [0.0; 4])?,
        refraction: &rig.constant(SIZE, [0.0; 4])?,
    };
    let settings = ComposeUniforms {
        size_px: Vec2::new(SIZE[0] as f32, SIZE[1] as f32),
        caustics_scale: 1.0,
        godrays_scale: 1.0,
        exposure: EXPOSURE as f32,
        occlusion_taps: 0,
        occlusion_radius_m: 0.5,
        water_cells: 1,
    };
    let stage = Compose::new(&resources, &shared, &inputs, settings, false)?;
    rig.run(&[&stage])?;
    let image = rig.channel(stage.texture(), BLUE)?;
    let radiance = |x: u32, y: u32| {
        let value = image.clamped((x * SIZE[0] / 6).into(), (y * SIZE[1] / 4).into());
        -(1.0 - value.powf(GAMMA_DISPLAY)).ln() / EXPOSURE
    };
    Ok([1, 3].map(|y| [1, 3, 5].map(|x| radiance(x, y))))
}

fn banded(value: impl Fn(u32, u32) -> f64) -> Result<Image, VerifyError> {
    let pixels = (0..SIZE[1]).flat_map(|y| (0..SIZE[0]).map(move |x| (x, y)));
    let data = pixels.map(|(x, y)| value(x, y)).collect();
    Ok(Image::from_data(SIZE[0], SIZE[1], data)?)
}
