//! The checks of both stages against f64 twins, each with a control.

use fathom::gpu::kit::Resources;
use fathom::harness::verify::rig::{Rig, largest, noise};
use fathom::harness::verify::{Case, Check, Result};
use fathom::reference::image::{Image, pixels};
use fathom::scene::SceneFile;

use crate::pipeline::Params;
use crate::{blur, draw};

const SIZE: [u32; 2] = [48, 40];
/// Both stages store 8 bits, a step of which is 1 / 255; sums in f32 add less than a hundredth of it.
const TOLERANCE: f64 = 0.51 / 255.0;
const RADIUS_PX: u32 = 3;

pub fn cases() -> Vec<Case> {
    vec![
        Case::new(draw::INFO.name, "rings against their closed form", rings),
        Case::new(blur::INFO.name, "noise against the mean of squares", squares),
    ]
}

fn rings(rig: &Rig<'_>) -> Result<Check> {
    let mut params = Params::from(&SceneFile::load("plane")?);
    params.ripples.rings = 5;
    let stage = draw::new(&Resources::new(rig.gpu), SIZE, &params)?;
    let drawn = rig.draw(&[&stage], stage.texture(), 0)?;
    let wavelength = params.water.wavelength_m / params.water.half_size_m[0];
    let error = |wavelength: f64| {
        largest(
            pixels(SIZE).map(|(x, y)| (drawn.get((x, y)) - height([x, y], wavelength, 5)).abs()),
        )
    };
    Ok(Check::new(rig, "largest error of the height")
        .within((TOLERANCE, "1"), error(wavelength))
        .control("wavelength 2 % longer", error(1.02 * wavelength)))
}

/// The sum of rings at a pixel's middle.
fn height(pixel: [u32; 2], wavelength: f64, rings: u32) -> f64 {
    let place = |i: usize| 2.0 * (f64::from(pixel[i]) + 0.5) / f64::from(SIZE[i]) - 1.0;
    let turn = std::f64::consts::TAU * place(0).hypot(place(1)) / wavelength;
    let sum: f64 = (1..=rings).map(|ring| (turn * f64::from(ring)).cos()).sum();
    0.5 + 0.5 * sum / f64::from(rings)
}

fn squares(rig: &Rig<'_>) -> Result<Check> {
    let source = noise(SIZE, 3);
    let resources = Resources::new(rig.gpu);
    let stage = blur::new(&resources, &rig.grey(&source), RADIUS_PX)?;
    let blurred = rig.draw(&[&stage], stage.texture(), 0)?;
    let error = |radius: u32| {
        largest(
            pixels(SIZE).map(|(x, y)| (blurred.get((x, y)) - mean(&source, [x, y], radius)).abs()),
        )
    };
    Ok(Check::new(rig, "largest error of the mean")
        .within((TOLERANCE, "1"), error(RADIUS_PX))
        .control("a square two pixels narrower", error(RADIUS_PX - 1)))
}

/// The mean of the square around a pixel.
fn mean(source: &Image, [x, y]: [u32; 2], radius: u32) -> f64 {
    let radius = i64::from(radius);
    let square = (-radius..=radius).flat_map(|i| (-radius..=radius).map(move |j| (i, j)));
    let sum: f64 = square.map(|(i, j)| source.clamped(i64::from(x) + i, i64::from(y) + j)).sum();
    sum / ((2 * radius + 1) * (2 * radius + 1)) as f64
}
