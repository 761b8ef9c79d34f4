//! `shafts/lines` and `shafts/blur` against lines and Gaussians in f64.

use super::filters::sums;
use super::lines::ScreenSegment;
use crate::prelude::*;
use fathom_stages::photon::OUTSIDE;
use fathom_stages::shafts::blur;
use fathom_stages::shafts::lines;

const SIZE: [u32; 2] = [160, 120];
const GAMMA_PER_M: f64 = 0.13;
const PHOTON_W: f64 = 0.7;
/// Of a photon behind one that is lost.
const WEIGHT: f64 = 0.625;
/// Way through the water that lies before a line, as behind a mirror.
const BEFORE_M: f64 = 1.5;
const LINES: usize = 12;
/// Heights of the eye: so deep that all lines lie under water, and above and below the water with lines on both sides of it.
const EYES_M: [f64; 3] = [-20.0, 1.0, -1.0];
/// Standard deviations below and above a texel.
const SIGMAS_PX: [f64; 2] = [0.6, 2.5];

pub fn cases() -> Vec<Case> {
    let what = |sigma_px| format!("standard deviation {sigma_px} px");
    let seen = |eye_m| format!("one line after the other, seen from {eye_m} m");
    let mut cases: Vec<Case> = Case::each(lines::INFO.name, EYES_M, seen, single_lines).collect();
    cases.extend(Case::each(blur::INFO.name, SIGMAS_PX, what, gaussian));
    cases
}

/// A line by its ends in the world, and on the screen.
struct ShaftLine {
    ends_m: [DVec3; 2],
    segment: ScreenSegment,
}

impl ShaftLine {
    /// In view, in any direction.
    fn random(random: &mut Random, rays: &PixelRays) -> Option<ShaftLine> {
        let mut end = || {
            let [x, y] = SIZE.map(|side| random.within(0.1, 0.9) * f64::from(side));
            let (origin, direction, _) = rays.ray_at(x, y);
            origin + direction * random.within(2.0, 9.0)
        };
        let ends_m = [end(), end()];
        Some(ShaftLine { ends_m, segment: ScreenSegment::new(ends_m, rays)? })
    }

    /// The axis along which it is longest, and its extent there.
    fn longest(&self) -> (usize, f64) {
        let extent = self.segment.to - self.segment.from;
        let axis = extent.abs().max_position();
        (axis, extent[axis])
    }

    /// How far along the line in the world the middle of a pixel is.
    fn share_at(&self, (x, y): (u32, u32)) -> f64 {
        let (axis, extent) = self.longest();
        self.segment.share((f64::from([x, y][axis]) + 0.5 - self.segment.from[axis]) / extent)
    }

    fn view_m_at(&self, pixel: (u32, u32)) -> f64 {
        let [near, far] = self.segment.w;
        near + self.share_at(pixel) * (far - near)
    }

    /// Its intensity at the middle of a pixel; of the way to the eye only the part below y = 0 is in the water.
    fn intensity(&self, pixel: (u32, u32), gamma_per_m: f64, light: &PictureLight) -> f64 {
        let [start, end] = self.ends_m;
        let place = start.lerp(end, self.share_at(pixel));
        let path_m = BEFORE_M + start.distance(place) + light.wet_m(place);
        PHOTON_W * WEIGHT * transmittance(gamma_per_m, path_m)
    }
}

/// A line, and its pixels with what they show.
type LinePixels = (ShaftLine, Vec<((u32, u32), f64)>);

/// Random lines one after the other, each drawn over a depth.
fn draw_lines(rig: &Rig<'_>, view: &View, seed: u32, depth: f64) -> Result<Vec<LinePixels>> {
    let (shared, rays) = (Shared::new(rig, view), rig::rays(view));
    let depth = rig.depth(SIZE, depth)?;
    let mut random = Random::new(seed);
    let lines: Vec<ShaftLine> =
        (0..LINES).filter_map(|_| ShaftLine::random(&mut random, &rays)).collect();
    let draw = |line: ShaftLine| {
        let [start, end] = line.ends_m;
        let photon = rig::photon(start, end, BEFORE_M + start.distance(end));
        let photons = rig.photons(&[Photon { fate: OUTSIDE, ..photon }, photon]);
        let weights = rig.words(&[1.0, WEIGHT].map(|of| (of as f32).to_bits()));
        let stage = lines::new(rig, &shared, &photons, &weights, &depth, PHOTON_W, 1.0)?;
        let image = rig.draw(&[&stage], &stage.texture, 0)?;
        let lit = pixels(SIZE).map(|at| (at, image.get(at))).filter(|(_, value)| *value > 0.0);
        Ok((line, lit.collect()))
    };
    lines.into_iter().map(draw).collect()
}

fn single_lines(rig: &Rig<'_>, eye_m: f64) -> Checks {
    let mut view = rig::synthetic_view(SIZE, GAMMA_PER_M)?;
    view.camera.position_m[1] = eye_m;
    view.camera.target_m[1] = eye_m;
    let lines = draw_lines(rig, &view, 3, 1.0)?;
    let light = &PictureLight::new(&view.camera, &view.light, &view.water);
    let error = |gamma_per_m: f64| {
        percentile::<90>(lines.iter().flat_map(|(line, lit)| {
            lit.iter().map(move |(at, value)| {
                relative_error(*value, line.intensity(*at, gamma_per_m, light))
            })
        }))
    };
    // A driver draws rectangles a pixel wide, or a pixel for each step along the longer axis: Vulkan leaves both. A slanted rectangle holds
    // a few middles of pixels more or fewer than its area says.
    let off = |longer_px: f64| {
        largest(lines.iter().map(|(line, lit)| {
            let (count, steps) = (lit.len() as f64, line.longest().1.abs());
            let length = line.segment.length_px();
            (steps + longer_px - count).max(count - length - longer_px).max(0.0)
        }))
    };
    Ok(vec![
        // Where within its pixel a line is evaluated is left to the driver: the way changes by some centimetres.
        Check::new(rig, "90th percentile of the intensity's relative error")
            .within((0.01, "1"), error(GAMMA_PER_M))
            .control("attenuation 10 % higher", error(1.1 * GAMMA_PER_M)),
        Check::new(rig, "pixels fewer than the steps or more than the length of a line, at most")
            .within((6.0, "px"), off(0.0))
            .control("lines 30 px longer", off(30.0)),
        hidden(rig, &view)?,
    ])
}

/// Lines behind a wall across the view are hidden, pixel by pixel.
fn hidden(rig: &Rig<'_>, view: &View) -> Result<Check> {
    const WALL_M: f64 = 5.0;
    let before_wall = draw_lines(rig, view, 11, rig::depth_ahead(view, WALL_M))?;
    let open = draw_lines(rig, view, 11, 1.0)?;
    // Of each pixel of a line: whether it is drawn before the wall, and its view depth.
    let found: Vec<(bool, f64)> = open
        .iter()
        .zip(&before_wall)
        .flat_map(|((line, all), (_, shown))| {
            let is_shown = |at| shown.iter().any(|(other, _)| *other == at);
            all.iter().map(move |(at, _)| (is_shown(*at), line.view_m_at(*at)))
        })
        .collect();
    let wrong =
        |wall_m: f64| share(found.iter().map(|(shown, view_m)| *shown != (*view_m <= wall_m)));
    // Where a line meets the wall, a pixel may fall to either side.
    Ok(Check::new(rig, "share of pixels shown behind a wall or hidden before it")
        .within((0.03, "1"), wrong(WALL_M))
        .control("the wall a metre farther", wrong(WALL_M + 1.0)))
}

fn gaussian(rig: &Rig<'_>, sigma_px: f64) -> Result<Check> {
    let source = noise(SIZE, 9);
    let stage = blur::new(rig, &sums(rig, &source), sigma_px)?;
    let blurred = rig.draw(&[&stage], stage.texture(), 0)?;
    let error = |sigma_px: f64| {
        let exact = twin(&twin(&source, sigma_px, [1, 0]), sigma_px, [0, 1]);
        apart(&blurred, &exact) / source.mean()
    };
    Ok(Check::new(rig, format!("σ = {sigma_px} px: largest difference from the twin, of the mean"))
        .within((1e-5, "1"), error(sigma_px))
        .control("a kernel 2 % wider", error(1.02 * sigma_px)))
}

/// The image averaged along an axis with the weights of a Gaussian, up to three standard deviations.
fn twin(source: &Image, sigma_px: f64, along: [i64; 2]) -> Image {
    let reach = (3.0 * sigma_px).ceil() as i64;
    let weight = |k: i64| (-0.5 * (k as f64 / sigma_px).powi(2)).exp();
    let weights: f64 = (-reach..=reach).map(weight).sum();
    Image::from_fn(source.size(), |x, y| {
        let tap = |k: i64| {
            weight(k) * source.clamped(i64::from(x) + k * along[0], i64::from(y) + k * along[1])
        };
        (-reach..=reach).map(tap).sum::<f64>() / weights
    })
}
