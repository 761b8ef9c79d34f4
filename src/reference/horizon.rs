//! Horizon-split ambient occlusion over a depth buffer (Dimitrov, Bavoil and Sainz, I3D 2008, with the changes of VAO §6),
//! twin of the GPU's, and closed forms of occlusion on height fields.

use std::f64::consts::{PI, TAU};

use glam::{DVec2, DVec3, DVec4};

use super::filter::{pcg, unit};
use super::image::{Image, behind};
use super::occlusion::{Attenuation, tangent_frame};
use super::rays::PixelRays;
use fathom_scene::Camera;

/// What the method is told.
#[derive(Clone, Debug, PartialEq)]
pub struct HorizonSplit {
    /// Directions around a pixel in which the horizon is sought, and samples of depth along each.
    pub directions: u32,
    pub steps: u32,
    /// Rays marched above the horizon, shared among the directions, and samples of depth along each.
    pub rays: u32,
    pub ray_steps: u32,
    pub r_max_m: f64,
    /// Difference of depth beyond which samples belong to another layer of surfaces.
    pub layer_m: f64,
    pub attenuation: Attenuation,
    /// Draws other numbers at every pixel.
    pub seed: u32,
}

/// What the camera sees.
pub struct SeenDepth<'a> {
    rays: PixelRays,
    camera: &'a Camera,
    /// Device depth.
    depth: &'a Image,
    /// Unit normals in rows, as many as depths.
    normals: &'a [DVec3],
}

impl<'a> SeenDepth<'a> {
    pub fn new(camera: &'a Camera, depth: &'a Image, normals: &'a [DVec3]) -> SeenDepth<'a> {
        let rays = PixelRays::new(camera, depth.width(), depth.height());
        SeenDepth { rays, camera, depth, normals }
    }

    fn size(&self) -> DVec2 {
        DVec2::new(self.depth.width().into(), self.depth.height().into())
    }

    /// The surface in the middle of a texel: its device depth and its place.
    fn surface(&self, texel: [i64; 2]) -> (f64, DVec3) {
        let z = self.depth.clamped(texel[0], texel[1]);
        let [x, y] = texel.map(|t| t as f64 + 0.5);
        (z, self.rays.unproject(x, y, z))
    }

    fn pixels(&self, clip: DVec4) -> DVec2 {
        DVec2::new(clip.x / clip.w * 0.5 + 0.5, 0.5 - clip.y / clip.w * 0.5) * self.size()
    }

    fn inside(&self, place: DVec2) -> bool {
        place.cmpge(DVec2::ZERO).all() && place.cmplt(self.size()).all()
    }
}

struct ShadedPoint<'a> {
    seen: &'a SeenDepth<'a>,
    texel: [i64; 2],
    position: DVec3,
    normal: DVec3,
    to_eye: DVec3,
    eye_m: f64,
}

/// The half-plane through a point that holds the eye and one direction of the picture. Directions in it are angles θ from the
/// one to the eye; dω = sin θ dθ dψ, and the cosine with the normal is `toward` cos θ + `aside` sin θ.
struct Slice {
    aside_m: DVec3,
    across: DVec3,
    /// Brings points beside the slice into it, parallel to the tangent plane.
    into: DVec3,
    toward: f64,
    aside: f64,
    /// From the point's pixel to the end of the search, pixels.
    start: DVec2,
    unit: DVec2,
    length_px: f64,
}

/// Smallest cosine between the normal and the direction to the eye: interpolated normals may point away.
const LEAST_FACING: f64 = 0.02;
/// The search spans at most this sine of the angle at the eye.
const MOST_REACH: f64 = 0.95;
/// Along a slice points lie at least this share of their distance beside it: the centres of near texels may lie aside.
const LEAST_ALONG: f64 = 0.1;
/// Ends of searches stay this far from the camera's plane, share of the point's view depth.
const LEAST_W: f64 = 0.1;

/// 2³² / golden ratio.
const SEED_STEP: u32 = 0x9E37_79B9;

impl HorizonSplit {
    /// Occlusion A, 0 open … 1 closed, at a pixel of a buffer of `buffer_px` pixels; none where nothing was drawn.
    pub fn at(&self, seen: &SeenDepth<'_>, buffer_px: [u32; 2], x: u32, y: u32) -> Option<f64> {
        let texel = behind([x, y].map(f64::from), buffer_px, seen.depth.size());
        let point = ShadedPoint::new(seen, texel)?;
        let own = self.seed.wrapping_mul(SEED_STEP);
        let seed = pcg(x.wrapping_add(y.wrapping_mul(65_536)).wrapping_add(own));
        let [first, second, third] = [pcg(seed), pcg(pcg(seed)), pcg(pcg(pcg(seed)))].map(unit);
        let turn = unit(seed);
        let basis = tangent_frame(point.to_eye);
        let (mut horizon, mut marched, mut ray) = (0.0, 0.0, 0);
        for i in 0..self.directions {
            let angle = TAU * (f64::from(i) / f64::from(self.directions) + turn);
            let aside = basis.x_axis * angle.cos() + basis.y_axis * angle.sin();
            let slice = self.slice(&point, aside);
            let jitter = (first + f64::from(i) * 0.618_033_988_75).fract();
            let (occluded, cosine) = self.find_horizon(&point, &slice, jitter);
            horizon += occluded;
            let own = rays_before(self.rays, self.directions, i + 1) - ray;
            for k in 0..own {
                let u = (second + f64::from(ray) * 0.754_877_666_25).fract();
                let jitter = (third + f64::from(ray) * 0.569_840_290_998).fract();
                let x = cosine + (1.0 - cosine) * (f64::from(k) + u) / f64::from(own);
                marched += (1.0 - cosine) * self.march(&point, &slice, x, jitter);
                ray += 1;
            }
        }
        // Each direction stands for 2π / directions of the angle ψ, and 1/π is VAO Eq. 1's.
        let mut a = 2.0 * horizon / f64::from(self.directions);
        if self.rays > 0 {
            a += 2.0 * marched / f64::from(self.rays);
        }
        Some(a.clamp(0.0, 1.0))
    }

    fn slice(&self, point: &ShadedPoint<'_>, aside_m: DVec3) -> Slice {
        let seen = point.seen;
        let across = point.to_eye.cross(aside_m);
        let off = point.normal.dot(across);
        let clip = |p: DVec3| seen.rays.clip(p);
        // The sphere of radius r_max is seen to end where a line from the eye touches it.
        let sine = (self.r_max_m / point.eye_m).min(MOST_REACH);
        let rim = point.to_eye * sine + aside_m * (1.0 - sine * sine).sqrt();
        let (from, mut to) =
            (clip(point.position), clip(point.position + rim * (sine * point.eye_m)));
        let least = LEAST_W * from.w;
        if to.w < least {
            to = from + (to - from) * ((from.w - least) / (from.w - to.w));
        }
        let start = DVec2::new(point.texel[0] as f64 + 0.5, point.texel[1] as f64 + 0.5);
        let delta = seen.pixels(to) - start;
        let room = |start: f64, delta: f64, size: f64| {
            let room = if delta > 0.0 { size - start } else { start };
            room / delta.abs().max(1e-6)
        };
        let size = seen.size();
        let share = room(start.x, delta.x, size.x).min(room(start.y, delta.y, size.y)).min(1.0);
        let length = delta.length();
        Slice {
            aside_m,
            across,
            into: (across - point.normal * off) / (1.0 - off * off).max(1e-4),
            toward: point.normal.dot(point.to_eye),
            aside: point.normal.dot(aside_m),
            start,
            unit: delta / length.max(1e-6),
            length_px: length * share,
        }
    }

    /// Part 1: samples of depth along the picture's line, farther apart with the distance, raise the horizon. Returns
    /// ∫ ρ cos dω / dψ below it, and the cosine of its angle θ.
    fn find_horizon(&self, point: &ShadedPoint<'_>, slice: &Slice, jitter: f64) -> (f64, f64) {
        let mut cosine = slice.tangent();
        let mut below = slice.integral(cosine);
        let (mut occluded, mut height) = (0.0, 0.0);
        if slice.length_px <= 1.0 {
            return (0.0, cosine);
        }
        for k in 0..self.steps {
            let share = (f64::from(k) + jitter) / f64::from(self.steps);
            let place = slice.start + slice.unit * (1.0 + share * share * (slice.length_px - 1.0));
            let texel = [place.x.floor() as i64, place.y.floor() as i64];
            let (z, position) = point.seen.surface(texel);
            let v = position - point.position;
            let distance_m = v.length();
            if z >= 1.0 || distance_m > self.r_max_m {
                continue;
            }
            let rise = v.dot(point.to_eye);
            if rise - height > self.layer_m {
                continue;
            }
            height = rise;
            let found = point.cosine(slice, v);
            if found > cosine {
                let integral = slice.integral(found);
                let rho = self.attenuation.at(distance_m / self.r_max_m);
                occluded += rho * (below - integral);
                (cosine, below) = (found, integral);
            }
        }
        (occluded, cosine)
    }

    /// Part 2: one ray at cos θ = x above the horizon, marched until it goes behind a surface that is not deeper than a layer.
    /// Returns ρ times its cosine with the normal, 0 without a hit.
    fn march(&self, point: &ShadedPoint<'_>, slice: &Slice, x: f64, jitter: f64) -> f64 {
        let seen = point.seen;
        let sine = (1.0 - x * x).max(0.0).sqrt();
        let direction = point.to_eye * x + slice.aside_m * sine;
        for k in 0..self.ray_steps {
            let share = (f64::from(k) + jitter) / f64::from(self.ray_steps);
            let place = point.position + direction * (share * self.r_max_m);
            let clip = seen.rays.clip(place);
            if clip.w <= seen.camera.z_near_m {
                break;
            }
            let pixel = seen.pixels(clip);
            if !seen.inside(pixel) {
                break;
            }
            let texel = [pixel.x as i64, pixel.y as i64];
            let (z, surface) = seen.surface(texel);
            let behind = clip.w - seen.camera.view_depth_m(z);
            if z >= 1.0 || texel == point.texel || behind <= 0.0 || behind > self.layer_m {
                continue;
            }
            // The texel's surface hides the ray where it rises above it, as seen from the shaded point.
            if point.cosine(slice, surface - point.position) > x {
                let facing = slice.toward * x + slice.aside * sine;
                return self.attenuation.at(share) * facing;
            }
        }
        0.0
    }
}

impl<'a> ShadedPoint<'a> {
    fn new(seen: &'a SeenDepth<'a>, texel: [i64; 2]) -> Option<ShadedPoint<'a>> {
        let (z, position) = seen.surface(texel);
        if z >= 1.0 {
            return None;
        }
        let to_eye = seen.camera.position() - position;
        let eye_m = to_eye.length();
        let to_eye = to_eye / eye_m;
        let index = texel[1] as usize * seen.depth.width() as usize + texel[0] as usize;
        let stored = seen.normals[index].normalize();
        let lift = (LEAST_FACING - stored.dot(to_eye)).max(0.0);
        Some(ShadedPoint {
            seen,
            texel,
            position,
            normal: (stored + to_eye * lift).normalize(),
            to_eye,
            eye_m,
        })
    }

    /// cos θ of a surface point at `v` from here, once it is brought into the slice parallel to the tangent plane: points of
    /// that plane then lie on the slice's own tangent. −1, below any horizon, for points that lie beside the slice rather than
    /// along it.
    fn cosine(&self, slice: &Slice, v: DVec3) -> f64 {
        let beside = v.dot(slice.across);
        let v = v - slice.into * beside;
        if v.dot(slice.aside_m) < LEAST_ALONG * beside.abs() {
            return -1.0;
        }
        v.dot(self.to_eye) / v.length().max(1e-12)
    }
}

impl Slice {
    /// cos θ of the tangent plane.
    fn tangent(&self) -> f64 {
        -self.aside / self.toward.hypot(self.aside)
    }

    /// ∫ of (toward cos θ + aside sin θ) sin θ from 0 to θ, given cos θ.
    fn integral(&self, cosine: f64) -> f64 {
        let cosine = cosine.clamp(-1.0, 1.0);
        let square = 1.0 - cosine * cosine;
        0.5 * (self.toward * square + self.aside * (cosine.acos() - cosine * square.sqrt()))
    }
}

/// Rays of the first `directions` directions, of `of` in all.
fn rays_before(rays: u32, of: u32, directions: u32) -> u32 {
    (u64::from(directions) * u64::from(rays) / u64::from(of)) as u32
}

/// Occlusion at `share` × r_max from an endless wall that stands on an endless floor. Directions that meet the wall within
/// r_max have a component of at least k = `share` towards it; on the unit disc of VAO Eq. 1's cosine weight that is a segment.
pub fn beside_wall(share: f64, attenuation: Attenuation) -> f64 {
    if share >= 1.0 {
        return 0.0;
    }
    let k = share.max(1e-12);
    let root = (1.0 - k * k).sqrt();
    let segment = k.acos() - k * root;
    let distances = 2.0 * k * (((1.0 + root) / k).ln() - root);
    match attenuation {
        Attenuation::Hard => segment / PI,
        Attenuation::Linear => (segment - distances) / PI,
    }
}

#[cfg(test)]
mod tests;
