//! `ao/bilateral` and `hsao/filter`: what surfaces give each other, and how noise is spread over one.

use crate::prelude::*;
use fathom_pipelines::settings::Filter;
use fathom_stages::bilateral::{self, Window};
use fathom_stages::{ao, gtao, hsao};

const SIZE: [u32; 2] = [96, 64];
/// Sizes of the buffer that is filtered: the viewport's, half of it, and one that does not divide it. With mean square distances from points of light, along
/// the rows and along the slope of a wall, in texels, from when pixels agreed with an f64 copy of the algorithm. Both are less where
/// the Gaussian is narrower, and the second where the wall is steeper.
const SPREAD: [([u32; 2], [f64; 2]); 3] =
    [(SIZE, [2.3752, 1.1406]), ([48, 32], [2.2971, 0.974]), ([37, 29], [2.4505, 1.1192])];

pub fn cases() -> Vec<Case> {
    let cases = [&ao::bilateral::INFO, &hsao::filter::INFO, &gtao::filter::INFO].map(|info| {
        [
            Case::new(info.name, "edges of what is drawn", move |rig| {
                leak((info, Window::Disc), rig)
            }),
            Case::new(info.name, "two walls", move |rig| walls(info, rig)),
            Case::new(info.name, "points of light on a slanted wall", move |rig| spread(info, rig)),
            Case::new(info.name, "noise on twigs", move |rig| within_range(info, rig)),
        ]
    });
    let square = (&gtao::filter::INFO, Window::Square);
    let leak = move |rig: &Rig<'_>| leak(square, rig);
    let of_square = [
        Case::new(square.0.name, "edges of what is drawn, square", leak),
        Case::new(square.0.name, "a mean of 4 × 4 texels", mean_of_square),
    ];
    cases.into_iter().flatten().chain(of_square).collect()
}

/// On a wall that faces the camera all texels weigh the same.
fn mean_of_square(rig: &Rig<'_>) -> Checks {
    let (fixture, _) = rig.two_walls(SIZE, [3.0; 2], [DVec3::Z; 2])?;
    let check = |source: [u32; 2]| {
        let noise = noise(source, 3);
        let off = |window| -> Result<f64> {
            let of = (&gtao::filter::INFO, rig);
            let settings = (&Filter::default(), window);
            let [found, _] = filtered(of, &fixture, settings, |_| noise.clone())?;
            let exact = |(x, y): (u32, u32)| {
                let first = [x, y].into_iter().zip(source).zip(SIZE).map(|((at, from), to)| {
                    ((f64::from(at) + 0.5) * f64::from(from) / f64::from(to) - 1.5).floor() as i64
                });
                let first: Vec<i64> = first.collect();
                mean((0..16).map(|i| noise.clamped(first[0] + i % 4, first[1] + i / 4)))
            };
            Ok(largest(pixels(SIZE).map(|at| (found.get(at) - exact(at)).abs())))
        };
        Ok(Check::new(rig, format!("{source:?} texels: largest error of the mean of 4 × 4"))
            .within((1e-3, "1"), off(Window::Square)?)
            .control("a disc", off(Window::Disc)?))
    };
    [SIZE, [48, 32], [37, 29]].into_iter().map(check).collect()
}

/// Filters what `input` makes of the depth of a scene.
fn filtered(
    (info, rig): (&'static StageInfo, &Rig<'_>),
    fixture: &Fixture,
    (settings, window): (&Filter, Window),
    input: impl FnOnce(&Image) -> Image,
) -> Result<[Image; 2]> {
    let textures = rig.gbuffer(fixture)?;
    let input = input(&rig.channel(&textures.depth, 0)?);
    let GBuffer { depth, normal, .. } = &textures;
    let uniforms = settings.uniforms(&fixture.view, input.size());
    let stage = bilateral::new(
        rig,
        info,
        &fixture.shared,
        &rig.grey(&input),
        depth,
        normal,
        (&uniforms, window),
    )?;
    Ok([rig.draw(&[&stage], stage.texture(), 0)?, input])
}

/// Points of light on a wall that is seen at 60 degrees.
fn spread(info: &'static StageInfo, rig: &Rig<'_>) -> Checks {
    const APART_PX: u32 = 16;
    let mut scene = rig::flat_plane(LightKind::Directional)?;
    scene.camera = Camera::new([0.0; 3], [0.0, 0.0, -1.0], 4.0, [1.0, 40.0]);
    let slope = DVec3::new(0.0, 0.5, -3f64.sqrt() / 2.0);
    let wall = Mesh::parallelogram(DVec3::NEG_Z * 10.0, DVec3::X * 9.0, slope * 9.0);
    scene.objects = vec![Object::new("wall", wall)];
    let fixture = rig.fixture(scene, SIZE)?;
    let mut checks = Vec::new();
    for (source, stored) in SPREAD {
        let middle = |k: u32| k % APART_PX == APART_PX / 2;
        let points = Image::from_fn(source, |x, y| f64::from(u8::from(middle(x) && middle(y))));
        let errors = |settings: &Filter| -> Result<[f64; 2]> {
            let [found, _] =
                filtered((info, rig), &fixture, (settings, Window::Disc), |_| points.clone())?;
            let square = |axis: usize, k: u32| {
                let place = (f64::from(k) + 0.5) * f64::from(source[axis]) / f64::from(SIZE[axis]);
                let apart_px = f64::from(APART_PX);
                ((place - 0.5).rem_euclid(apart_px) - 0.5 * apart_px).powi(2)
            };
            Ok([0, 1].map(|axis| {
                let squares =
                    pixels(SIZE).map(|at| found.get(at) * square(axis, [at.0, at.1][axis]));
                relative_error(squares.sum::<f64>() / found.sum(), stored[axis])
            }))
        };
        let sigma_px = 1.1 * Filter::default().sigma_px;
        let found = errors(&Filter::default())?;
        let wider = errors(&Filter { sigma_px, ..Filter::default() })?;
        checks.extend([(0, "rows"), (1, "slope")].map(|(axis, along)| {
            let what = format!("{source:?} texels: mean square distance from points of light along the {along}, relative error");
            Check::new(rig, what)
                .within((5e-3, "1"), found[axis])
                .control("a Gaussian a tenth wider", wider[axis])
        }));
    }
    Ok(checks)
}

/// Black on a wall, and white on one beside and behind it whose normal is another: each pixel's share of white against that without weights of depths
/// and normals, weighted by the Gaussians of both.
fn walls(info: &'static StageInfo, rig: &Rig<'_>) -> Checks {
    const WALLS_M: [f64; 2] = [3.0, 3.01];
    let normals = [DVec3::Z, DVec3::new(0.2, 0.0, 1.0).normalize()];
    let (fixture, middle) = rig.two_walls(SIZE, WALLS_M, normals)?;
    let white = |depth: &Image| depth.map(|z| f64::from(u8::from(z > middle)));
    let settings = Filter::default();
    let blind =
        Filter { depth_sigma: 1e3, normal_sigma: bilateral::NO_NORMALS.into(), ..settings.clone() };
    let [mixed, on] = filtered((info, rig), &fixture, (&blind, Window::Disc), white)?;
    let [found, _] = filtered((info, rig), &fixture, (&settings, Window::Disc), white)?;
    let between = pixels(SIZE).filter(|at| (0.02..0.98).contains(&mixed.get(*at)));
    let between: Vec<_> = between.collect();
    let error = |depth_sigma: f64, normal_sigma: f64| {
        largest(between.iter().map(|at| {
            let (wall, other) = if on.get(*at) > 0.5 { (1, 0) } else { (0, 1) };
            let off = (WALLS_M[other] - WALLS_M[wall]) / (depth_sigma * WALLS_M[wall]);
            let turned = normals[0].distance(normals[1]) / normal_sigma;
            let weight = (-0.5 * (off * off + turned * turned)).exp();
            // Of the other wall.
            let shares = |image: &Image| (image.get(*at) - on.get(*at)).abs();
            let share = shares(&mixed);
            (shares(&found) - weight * share / (1.0 - share + weight * share)).abs()
        }))
    };
    let Filter { depth_sigma, normal_sigma, .. } = settings;
    Ok(vec![
        Check::new(rig, "two walls: largest error of a pixel's share of the other")
            .within((2e-3, "1"), error(depth_sigma, normal_sigma))
            .control("depth_sigma 1.2 times", error(1.2 * depth_sigma, normal_sigma))
            .with("pixels", between.len() as f64),
        Check::new(rig, "two walls: largest error of a pixel's share of the other, normals")
            .within((2e-3, "1"), error(depth_sigma, normal_sigma))
            .control("normal_sigma 0.45", error(depth_sigma, 0.45)),
    ])
}

/// What a mean of taps is: within the range of the texels around the pixel that show a surface. Twigs lie between taps of smaller buffers.
fn within_range(info: &'static StageInfo, rig: &Rig<'_>) -> Checks {
    let fixture = rig.fixture(Scene::load("thicket")?, SIZE)?;
    let (depth, settings) = (rig.channel(&rig.gbuffer(&fixture)?.depth, 0)?, Filter::default());
    let check = |source: [u32; 2]| {
        let noise = noise(source, 5);
        let [found, _] =
            filtered((info, rig), &fixture, (&settings, Window::Disc), |_| noise.clone())?;
        // Of the middle of a pixel or texel, that of the other image.
        let other = |(x, y): (u32, u32), [from, to]: [[u32; 2]; 2]| {
            let along = |at: u32, axis: usize| (2 * at + 1) * to[axis] / (2 * from[axis]);
            (along(x, 0), along(y, 1))
        };
        let shows = |texel: &(u32, u32)| depth.get(other(*texel, [source, SIZE])) < 1.0;
        let outside = |reach: u32| {
            let drawn = pixels(SIZE).filter(|at| depth.get(*at) < 1.0);
            largest(drawn.map(|at| {
                let (x, y) = other(at, [SIZE, source]);
                let around = pixels(source)
                    .filter(|texel| texel.0.abs_diff(x).max(texel.1.abs_diff(y)) <= reach);
                let values = || around.clone().filter(shows).map(|texel| noise.get(texel));
                let low = values().fold(1.0, f64::min);
                let v = found.get(at);
                (low - v).max(v - values().fold(low, f64::max))
            }))
        };
        let reach = settings.radius_px as u32;
        let what = "texels of noise: largest distance from the range of those around";
        // Half a step of 16-bit floats.
        Ok(Check::new(rig, format!("{source:?} {what}"))
            .within((2.5e-4, "1"), outside(reach))
            .control("of those within half the radius", outside(reach / 2)))
    };
    [[48, 32], [13, 11]].into_iter().map(check).collect()
}

/// Black on the geometry of a scene, white beside it.
fn leak((info, window): (&'static StageInfo, Window), rig: &Rig<'_>) -> Result<Check> {
    let fixture = rig.fixture(Scene::load("tank")?, SIZE)?;
    let outside = |depth: &Image| depth.map(|z| f64::from(u32::from(z >= 1.0)));
    let [result, input] = filtered((info, rig), &fixture, (&Filter::default(), window), outside)?;
    let leak = |shifted: i64| {
        let beside = |x: u32, y: u32| input.clamped(i64::from(x) + shifted, y.into());
        largest(pixels(SIZE).map(|(x, y)| (result.get((x, y)) - beside(x, y)).abs()))
    };
    Ok(Check::new(rig, "largest leak between geometry and background")
        .within((0.0, "1"), leak(0))
        .control("compared a pixel aside", leak(1))
        .with("background_share", input.mean()))
}
