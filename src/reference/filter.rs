//! Multi-tap low-pass with a kernel rotated per pixel (UW §3.5), twin of the GPU's.

use std::f64::consts::TAU;

use super::image::Image;
use super::plane::CameraDepth;

/// Golden angle, radians: π (3 − √5). Successive taps of a Vogel disc differ by it
/// (Vogel, Mathematical Biosciences 44, 1979).
pub const GOLDEN_ANGLE: f64 = 2.399_963_229_728_653;

/// The taps of the filter before rotation, in pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct Disc {
    pub taps: Vec<[f64; 2]>,
}

impl Disc {
    /// `count` taps spread evenly over a disc: tap i at radius `R √((i + ½)/count)` and i golden angles.
    pub fn vogel(count: u32, radius_px: f64) -> Disc {
        let taps = (0..count)
            .map(|i| {
                let radius = radius_px * ((f64::from(i) + 0.5) / f64::from(count)).sqrt();
                let (sin, cos) = (f64::from(i) * GOLDEN_ANGLE).sin_cos();
                [radius * cos, radius * sin]
            })
            .collect();
        Disc { taps }
    }

    /// Mean of the taps around pixel (x, y), the disc turned by the pixel's angle. A tap reads the
    /// texel in which it falls; beyond the border the border's texel.
    pub fn at(&self, image: &Image, x: u32, y: u32) -> f64 {
        let texels = self.places(x, y).map(|place| place.map(|t| t.floor() as i64));
        texels.map(|[x, y]| image.clamped(x, y)).sum::<f64>() / self.taps.len() as f64
    }

    /// The same over the taps whose surface lies within `share` of the pixel's view depth from the pixel's plane; the pixel itself
    /// where none does.
    pub fn within_surface(
        &self,
        image: &Image,
        (seen, share): (&CameraDepth<'_>, f64),
        x: u32,
        y: u32,
    ) -> f64 {
        let counted = self.offs(image, seen, x, y).filter(|(_, off)| *off <= share);
        let (sum, count) =
            counted.fold((0.0, 0.0), |(sum, n), ([x, y], _)| (sum + image.clamped(x, y), n + 1.0));
        if count > 0.0 { sum / count } else { image.clamped(x.into(), y.into()) }
    }

    /// Smallest difference between a tap's distance from the pixel's plane and `share`, both over the pixel's view depth: where
    /// it is tiny, single precision may decide otherwise.
    pub fn decision_distance(
        &self,
        image: &Image,
        (seen, share): (&CameraDepth<'_>, f64),
        x: u32,
        y: u32,
    ) -> f64 {
        let distances = self.offs(image, seen, x, y).map(|(_, off)| (off - share).abs());
        distances.fold(f64::INFINITY, f64::min)
    }

    /// The texels of the taps about a pixel, and how far the surface at each is from the pixel's plane, over its view depth.
    fn offs(
        &self,
        image: &Image,
        seen: &CameraDepth<'_>,
        x: u32,
        y: u32,
    ) -> impl Iterator<Item = ([i64; 2], f64)> {
        let plane = seen.plane(seen.texel([x.into(), y.into()], image.size()));
        let view_m = seen.view_m(plane.z);
        let last = image.size().map(|side| i64::from(side) - 1);
        self.places(x, y).map(move |place| {
            let texel = [0, 1].map(|k| (place[k].floor() as i64).clamp(0, last[k]));
            (texel, seen.beyond_m(&plane, seen.texel(texel, image.size())).abs() / view_m)
        })
    }

    /// Smallest distance of a rotated tap of pixel (x, y) from a texel's edge, pixels: where it is
    /// tiny, single precision may read the neighbour.
    pub fn edge_distance(&self, x: u32, y: u32) -> f64 {
        from_edges(self.places(x, y))
    }

    /// Where the rotated taps of a pixel lie, pixels.
    fn places(&self, x: u32, y: u32) -> impl Iterator<Item = [f64; 2]> {
        let (sin, cos) = rotation(x, y).sin_cos();
        let [x, y] = [x, y].map(|t| f64::from(t) + 0.5);
        self.taps.iter().map(move |[dx, dy]| [x + cos * dx - sin * dy, y + sin * dx + cos * dy])
    }

    pub fn apply(&self, image: &Image) -> Image {
        Image::of(image.size(), |x, y| self.at(image, x, y))
    }
}

/// Smallest distance of any of these coordinates from a whole number.
pub fn from_edges(places: impl Iterator<Item = [f64; 2]>) -> f64 {
    places.flatten().map(|t| (t - t.round()).abs()).fold(f64::INFINITY, f64::min)
}

/// Angle by which the disc is turned at a pixel, radians in [0, 2π).
pub fn rotation(x: u32, y: u32) -> f64 {
    TAU * f64::from(pcg(x.wrapping_add(y.wrapping_mul(65_536)))) / 4_294_967_296.0
}

/// PCG-RXS-M-XS-32 as a hash (O'Neill 2014; Jarzynski and Olano, JCGT 9(3), 2020).
pub fn pcg(v: u32) -> u32 {
    let state = v.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    let word = ((state >> ((state >> 28) + 4)) ^ state).wrapping_mul(277_803_737);
    (word >> 22) ^ word
}

/// The upper 24 bits as a number in [0, 1).
pub fn unit(bits: u32) -> f64 {
    f64::from(bits >> 8) / 16_777_216.0
}
