//! `shafts/lines` and `shafts/blur` against lines and Gaussians in f64.

use glam::DVec3;

use super::{Case, Check, Checks, Result, Rig, largest, noise, rig};
use fathom_reference::image::{Image, pixels};
use fathom_reference::quantities::quantile;
use fathom_reference::rays::PixelRays;
use fathom_scene::Camera;
use fathom_stages::Column;
use fathom_stages::frame::Shared;
use fathom_stages::shafts::blur;
use fathom_stages::shafts::lines;
use fathom_stages::splatting::Sums;

const SIZE: [u32; 2] = [160, 120];
const GAMMA_PER_M: f64 = 0.13;
const PHOTON_W: f64 = 0.7;
const LINES: usize = 12;
/// Standard deviations below and above a texel.
const SIGMAS_PX: [f64; 2] = [0.6, 2.5];

pub fn cases() -> Vec<Case> {
    let blurred = |sigma_px: f64| {
        let what = format!("standard deviation {sigma_px} px");
        Case::new(blur::INFO.name, what, move |rig| gaussian(rig, sigma_px))
    };
    let mut cases = vec![Case::new(lines::INFO.name, "one line after the other", single_lines)];
    cases.extend(SIGMAS_PX.map(blurred));
    cases
}

/// A line by its ends in the world, on the screen, and along the view.
struct Line {
    ends_m: [DVec3; 2],
    places: [[f64; 2]; 2],
    view_m: [f64; 2],
}

impl Line {
    /// In view, in any direction.
    fn random(random: &mut rig::Random, camera: &Camera, rays: &PixelRays) -> Option<Line> {
        let mut end = || {
            let [x, y] = SIZE.map(|side| random.within(0.1, 0.9) * f64::from(side));
            let (origin, direction, _) = rays.ray_at(x, y);
            origin + direction * random.within(2.0, 9.0)
        };
        let ends_m = [end(), end()];
        let [a, b] = ends_m.map(|end| rays.project(end).map(|place| [place.x_px, place.y_px]));
        let view_m = ends_m.map(|end| (end - camera.position()).dot(camera.direction()));
        Some(Line { ends_m, places: [a?, b?], view_m })
    }

    /// The axis along which it is longest, and its extent there.
    fn longest(&self) -> (usize, f64) {
        let extent = [0, 1].map(|axis| self.places[1][axis] - self.places[0][axis]);
        let axis = usize::from(extent[1].abs() > extent[0].abs());
        (axis, extent[axis])
    }

    fn length_px(&self) -> f64 {
        let [[ax, ay], [bx, by]] = self.places;
        (bx - ax).hypot(by - ay)
    }

    /// How far along the line in the world the middle of a pixel is.
    fn share_at(&self, pixel: [u32; 2]) -> f64 {
        let (axis, extent) = self.longest();
        let on_screen = (f64::from(pixel[axis]) + 0.5 - self.places[0][axis]) / extent;
        let [near, far] = self.view_m;
        on_screen * near / (on_screen * near + (1.0 - on_screen) * far)
    }

    fn view_m_at(&self, pixel: [u32; 2]) -> f64 {
        let [near, far] = self.view_m;
        near + self.share_at(pixel) * (far - near)
    }

    /// Its intensity at the middle of a pixel.
    fn at(&self, pixel: [u32; 2], gamma_per_m: f64) -> f64 {
        let way_m = self.share_at(pixel) * self.ends_m[0].distance(self.ends_m[1]);
        PHOTON_W * (-gamma_per_m * way_m).exp()
    }
}

fn single_lines(rig: &Rig<'_>) -> Checks {
    let view = rig::synthetic_view(SIZE, GAMMA_PER_M)?;
    let shared = Shared::new(&rig.resources, &view);
    let depth = rig.depth(SIZE, 1.0)?;
    let rays = PixelRays::new(&view.camera, SIZE[0], SIZE[1]);
    let mut random = rig::Random::new(3);
    let (mut errors, mut murkier, mut lengths) = (Vec::new(), Vec::new(), Vec::new());
    for _ in 0..LINES {
        let Some(line) = Line::random(&mut random, &view.camera, &rays) else { continue };
        let [start, end] = line.ends_m;
        let photons = rig.photons(&[rig::photon(start, end, start.distance(end))]);
        let alike = rig.ones(photons.count);
        let stage =
            lines::new(&rig.resources, &shared, (&photons, &alike), &depth, (PHOTON_W, 1.0))?;
        rig.run(&[&stage])?;
        let drawn = rig.channel(&stage.texture, 0)?;
        let lit: Vec<[u32; 2]> = pixels(SIZE)
            .filter(|(x, y)| drawn.clamped((*x).into(), (*y).into()) > 0.0)
            .map(|(x, y)| [x, y])
            .collect();
        let error = |pixel: &[u32; 2], gamma_per_m: f64| {
            let [x, y] = pixel.map(i64::from);
            (drawn.clamped(x, y) / line.at(*pixel, gamma_per_m) - 1.0).abs()
        };
        errors.extend(lit.iter().map(|pixel| error(pixel, GAMMA_PER_M)));
        murkier.extend(lit.iter().map(|pixel| error(pixel, 1.1 * GAMMA_PER_M)));
        lengths.push((lit.len() as f64, line.longest().1.abs(), line.length_px()));
    }
    // A driver draws rectangles a pixel wide, or a pixel for each step along the longer axis: Vulkan leaves both. A slanted rectangle holds
    // a few middles of pixels more or fewer than its area says.
    let hidden = hidden(rig)?;
    let off = |longer_px: f64| {
        let beyond = |(n, steps, length): &(f64, f64, f64)| {
            (steps + longer_px - n).max(n - length - longer_px).max(0.0)
        };
        largest(lengths.iter().map(beyond))
    };
    Ok(vec![
        // Where within its pixel a line is evaluated is left to the driver: the way changes by some centimetres.
        Check::of(lines::INFO.name, "90th percentile of the intensity's relative error")
            .within((0.01, "1"), quantile(&mut errors, 0.9))
            .control("attenuation 10 % higher", quantile(&mut murkier, 0.9)),
        Check::of(
            lines::INFO.name,
            "pixels fewer than the steps or more than the length of a line, at most",
        )
        .within((6.0, "px"), off(0.0))
        .control("lines 30 px longer", off(30.0)),
        hidden,
    ])
}

/// Lines behind a wall across the view are hidden, pixel by pixel.
fn hidden(rig: &Rig<'_>) -> Result<Check> {
    const WALL_M: f64 = 5.0;
    let view = rig::synthetic_view(SIZE, GAMMA_PER_M)?;
    let shared = Shared::new(&rig.resources, &view);
    let rays = PixelRays::new(&view.camera, SIZE[0], SIZE[1]);
    let ahead = view.camera.position() + WALL_M * view.camera.direction();
    let wall = rig.depth(SIZE, rays.project(ahead).map_or(1.0, |place| place.depth))?;
    let open = rig.depth(SIZE, 1.0)?;
    let mut random = rig::Random::new(11);
    // Of each pixel of a line: whether it is drawn before the wall, and its view depth.
    let mut found: Vec<(bool, f64)> = Vec::new();
    for _ in 0..LINES {
        let Some(line) = Line::random(&mut random, &view.camera, &rays) else { continue };
        let [start, end] = line.ends_m;
        let photons = rig.photons(&[rig::photon(start, end, start.distance(end))]);
        let alike = rig.ones(photons.count);
        let drawn = |depth: &wgpu::Texture| -> Result<Image> {
            let stage =
                lines::new(&rig.resources, &shared, (&photons, &alike), depth, (PHOTON_W, 1.0))?;
            rig.run(&[&stage])?;
            rig.channel(&stage.texture, 0)
        };
        let (all, shown) = (drawn(&open)?, drawn(&wall)?);
        let lit = |image: &Image, x: u32, y: u32| image.clamped(x.into(), y.into()) > 0.0;
        let pixels = pixels(SIZE).filter(|(x, y)| lit(&all, *x, *y));
        found.extend(pixels.map(|(x, y)| (lit(&shown, x, y), line.view_m_at([x, y]))));
    }
    let wrong = |wall_m: f64| {
        let wrong = found.iter().filter(|(shown, view_m)| *shown != (*view_m <= wall_m)).count();
        wrong as f64 / found.len() as f64
    };
    // Where a line meets the wall, a pixel may fall to either side.
    Ok(Check::of(lines::INFO.name, "share of pixels shown behind a wall or hidden before it")
        .within((0.03, "1"), wrong(WALL_M))
        .control("the wall a metre farther", wrong(WALL_M + 1.0)))
}

fn gaussian(rig: &Rig<'_>, sigma_px: f64) -> Result<Check> {
    let source = noise(SIZE, 9);
    let column = Column::new("noise", "1", "noise");
    let sums = Sums { texture: rig.grey(&source), column };
    let stage = blur::new(&rig.resources, &sums, sigma_px)?;
    rig.run(&[&stage])?;
    let blurred = rig.channel(stage.texture(), 0)?;
    let error = |sigma_px: f64| {
        let exact = twin(&twin(&source, sigma_px, [1, 0]), sigma_px, [0, 1]);
        let off = blurred.data().iter().zip(exact.data()).map(|(a, b)| (a - b).abs());
        largest(off) / source.mean()
    };
    Ok(Check::of(
        blur::INFO.name,
        format!("σ = {sigma_px} px: largest difference from the twin, of the mean"),
    )
    .within((1e-5, "1"), error(sigma_px))
    .control("a kernel 2 % wider", error(1.02 * sigma_px)))
}

/// The image averaged along an axis with the weights of a Gaussian, up to three standard deviations.
fn twin(source: &Image, sigma_px: f64, along: [i64; 2]) -> Image {
    let reach = (3.0 * sigma_px).ceil() as i64;
    let weight = |k: i64| (-0.5 * (k as f64 / sigma_px).powi(2)).exp();
    let weights: f64 = (-reach..=reach).map(weight).sum();
    let [width, height] = source.size();
    Image::of([width, height], |x, y| {
        let tap = |k: i64| {
            weight(k) * source.clamped(i64::from(x) + k * along[0], i64::from(y) + k * along[1])
        };
        (-reach..=reach).map(tap).sum::<f64>() / weights
    })
}
