//! Ambient occlusion in slices of the hemisphere over a depth buffer, by the printed formulas: Jimenez, Wu, Pesce and Jarabo 2016 (GTAO), and
//! Therrien, Levesque and Gilet 2023. Angles in a slice are from the direction to the eye, negative on its left.

use std::f64::consts::{FRAC_PI_2, PI};

use glam::{DVec2, DVec3};

use super::image::{Image, pixel_behind};
use super::occlusion::tangent_frame;
use super::rays::PixelRays;
use fathom_scene::pcg;

/// 2³² over the golden ratio, and the ratio's fraction.
const GOLDEN: u32 = 0x9E37_79B9;
const GOLDEN_FRACTION: f64 = 0.618_033_988_75;
const SECTORS: u32 = 32;
/// As in `shaders/shared/horizon.wgsl`.
const MIN_FACING: f64 = 0.02;
const MAX_REACH: f64 = 0.95;
const MIN_ALONG: f64 = 0.1;
const MIN_W: f64 = 0.1;

/// What occludes a slice.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SliceMethod {
    Horizons,
    /// Sectors of equal angle.
    UniformSectors,
    /// Sectors of equal cosine-weighted share.
    CosineSectors,
}

#[derive(Clone, Copy, Debug)]
pub struct SliceSearch {
    pub method: SliceMethod,
    pub r_max_m: f64,
    pub thickness_m: f64,
    pub fall: f64,
    pub slices: u32,
    pub steps: u32,
    pub seed: u32,
    /// Rotations repeat every 4 × 4 texels.
    pub tiled: bool,
}

/// What a camera sees.
pub struct SeenDepth {
    pub depth: Image,
    pub normal: [Image; 3],
    pub rays: PixelRays,
    pub eye: DVec3,
}

/// One slice of a point: its directions and the projected normal's angle γ and length.
struct Slice {
    position: DVec3,
    normal: DVec3,
    to_eye: DVec3,
    right: DVec3,
    gamma: f64,
    length: f64,
}

impl Slice {
    /// GTAO Eq. 7: ∫ of cos(θ − γ) |sin θ| between 0 and h.
    fn arc(&self, h: f64) -> f64 {
        let gamma = self.gamma;
        0.25 * (-(2.0 * h - gamma).cos() + gamma.cos() + 2.0 * h * gamma.sin())
    }

    /// Angles of the tangent plane.
    fn ends(&self) -> [f64; 2] {
        [self.gamma - FRAC_PI_2, self.gamma + FRAC_PI_2]
    }

    /// Place of an angle in the slice, from 0 at its left end to 1.
    fn place(&self, uniform: bool, angle: f64) -> f64 {
        let [left, right] = self.ends();
        if uniform {
            return (angle - left) / PI;
        }
        (self.arc(left) + angle.signum() * self.arc(angle)) / (self.arc(left) + self.arc(right))
    }

    /// Angle of a point at `v`, once it is moved into the slice along the tangent plane; none for what lies beside it.
    fn angle(&self, side: f64, v: DVec3) -> Option<f64> {
        let direction = side * self.right;
        let across = self.to_eye.cross(direction);
        let within = across - self.normal * self.normal.dot(across);
        let beside = v.dot(across);
        let moved = v - within * (beside / within.dot(across).max(1e-4));
        let along = moved.dot(direction);
        (along >= MIN_ALONG * beside.abs()).then(|| side * along.atan2(moved.dot(self.to_eye)))
    }
}

impl SliceSearch {
    /// A at a pixel of an occlusion buffer of `own_px` pixels; none where nothing is seen.
    pub fn occlusion(&self, seen: &SeenDepth, own: (u32, u32), own_px: [u32; 2]) -> Option<f64> {
        let texel = pixel_behind([own.0.into(), own.1.into()], own_px, seen.depth.size());
        let position = seen.position(texel)?;
        let to_eye = (seen.eye - position).normalize();
        let stored = DVec3::from([0, 1, 2].map(|i| seen.normal[i].clamped(texel[0], texel[1])));
        let stored = stored.normalize();
        let lift = (MIN_FACING - stored.dot(to_eye)).max(0.0);
        let normal = (stored + lift * to_eye).normalize();
        let frame = tangent_frame(to_eye);
        let [rotation, offset] = self.drawn(own);
        let of_slice = |i: u32| {
            let angle = PI * (f64::from(i) + rotation) / f64::from(self.slices);
            let right = frame.x_axis * angle.cos() + frame.y_axis * angle.sin();
            let [toward, aside] = [normal.dot(to_eye), normal.dot(right)];
            let (gamma, length) = (aside.atan2(toward), aside.hypot(toward));
            let slice = Slice { position, normal, to_eye, right, gamma, length };
            let jitter = (offset + f64::from(i) * GOLDEN_FRACTION).fract();
            self.in_slice(seen, texel, &slice, jitter)
        };
        Some((0..self.slices).map(of_slice).sum::<f64>() / f64::from(self.slices))
    }

    /// The rotation of a pixel's slices and the offset of its samples.
    fn drawn(&self, (x, y): (u32, u32)) -> [f64; 2] {
        let unit = |v: u32| f64::from(v >> 8) / 16_777_216.0;
        if self.tiled {
            let place = f64::from(((x + y) & 3) * 4 + (x & 3)) + 0.5;
            let first = pcg(self.seed);
            let offset = unit(pcg(first)) + place * GOLDEN_FRACTION;
            return [(unit(first) + place / 16.0).fract(), offset.fract()];
        }
        let first = pcg(x.wrapping_add(y << 16).wrapping_add(self.seed.wrapping_mul(GOLDEN)));
        [unit(first), unit(pcg(first))]
    }

    fn in_slice(&self, seen: &SeenDepth, texel: [i64; 2], slice: &Slice, jitter: f64) -> f64 {
        let [left, right] = slice.ends();
        let open = slice.arc(left) + slice.arc(right);
        let samples = |side: f64| self.samples(seen, texel, slice, side, jitter);
        if self.method == SliceMethod::Horizons {
            let horizon = |side: f64, end: f64| {
                let raise = |highest: f64, v: &DVec3| match slice.angle(side, *v) {
                    Some(found) if found.cos() < highest => {
                        let fallen = highest + self.fall * (found.cos() - highest);
                        fallen.max(end.cos())
                    }
                    Some(found) => found.cos(),
                    None => highest,
                };
                side * samples(side).iter().fold(end.cos(), raise).acos()
            };
            let seen = slice.arc(horizon(-1.0, left)) + slice.arc(horizon(1.0, right));
            return slice.length * (open - seen);
        }
        let uniform = self.method == SliceMethod::UniformSectors;
        let mut covered = [false; SECTORS as usize];
        for (side, end) in [(-1.0, left), (1.0, right)] {
            for v in samples(side) {
                let back = v - self.thickness_m * slice.to_eye;
                let Some((front, back)) = slice.angle(side, v).zip(slice.angle(side, back)) else {
                    continue;
                };
                let [front, back] = [front, back]
                    .map(|angle| slice.place(uniform, side * angle.abs().min(end.abs())));
                for (i, covered) in (0..SECTORS).zip(&mut covered) {
                    let middle = (f64::from(i) + 0.5) / f64::from(SECTORS);
                    *covered |= (front.min(back)..front.max(back)).contains(&middle);
                }
            }
        }
        let share = covered.iter().filter(|covered| **covered).count() as f64 / f64::from(SECTORS);
        if uniform { share } else { slice.length * open * share }
    }

    /// From the point to what the samples of a side show within reach.
    fn samples(
        &self,
        seen: &SeenDepth,
        texel: [i64; 2],
        slice: &Slice,
        side: f64,
        jitter: f64,
    ) -> Vec<DVec3> {
        let [width, height] = seen.depth.size().map(f64::from);
        let start = DVec2::new(texel[0] as f64, texel[1] as f64) + 0.5;
        let eye_m = seen.eye.distance(slice.position);
        let sine = (self.r_max_m / eye_m).min(MAX_REACH);
        let rim = sine * slice.to_eye + (1.0 - sine * sine).sqrt() * side * slice.right;
        let rim = slice.position + sine * eye_m * rim;
        let [here_w, rim_w] = [slice.position, rim].map(|point| seen.rays.clip(point).w);
        let shorten =
            if rim_w < MIN_W * here_w { (1.0 - MIN_W) * here_w / (here_w - rim_w) } else { 1.0 };
        let end = seen.rays.project(slice.position + shorten * (rim - slice.position));
        let delta = end.map_or(DVec2::ZERO, |end| DVec2::new(end.x_px, end.y_px) - start);
        let room = |delta: f64, start: f64, side: f64| {
            (if delta > 0.0 { side - start } else { start }) / delta.abs().max(1e-6)
        };
        let room = room(delta.x, start.x, width).min(room(delta.y, start.y, height)).min(1.0);
        let length = delta.length() * room;
        if length <= 1.0 {
            return Vec::new();
        }
        let sample = |k: u32| {
            let share = (f64::from(k) + jitter) / f64::from(self.steps);
            let at = start + delta.normalize() * (1.0 + share * share * (length - 1.0));
            let clamp = |at: f64, side: f64| at.floor().clamp(0.0, side - 1.0) as i64;
            let v = seen.position([clamp(at.x, width), clamp(at.y, height)])? - slice.position;
            (v.length() <= self.r_max_m).then_some(v)
        };
        (0..self.steps).filter_map(sample).collect()
    }
}

impl SeenDepth {
    /// The surface in the middle of a texel.
    fn position(&self, [x, y]: [i64; 2]) -> Option<DVec3> {
        let depth = self.depth.clamped(x, y);
        let point = || self.rays.unproject(x as f64 + 0.5, y as f64 + 0.5, depth);
        (depth < 1.0).then(point)
    }
}
