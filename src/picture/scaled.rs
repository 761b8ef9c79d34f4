//! Scaling by a separable filter in `f32`, columns first. Sums are taken in the order of the crate `image` 0.25, whose bytes these are.

use super::RgbImage;

#[derive(Clone, Copy, Debug)]
pub enum Filter {
    /// Linear, over a pixel to either side.
    Triangle,
    /// A windowed sinc, over three pixels to either side.
    Lanczos3,
}

impl Filter {
    fn reach(self) -> f32 {
        match self {
            Self::Triangle => 1.0,
            Self::Lanczos3 => 3.0,
        }
    }

    fn at(self, x: f32) -> f32 {
        if x.abs() >= self.reach() {
            return 0.0;
        }
        match self {
            Self::Triangle => 1.0 - x.abs(),
            Self::Lanczos3 => sinc(x) * sinc(x / self.reach()),
        }
    }
}

fn sinc(x: f32) -> f32 {
    let a = x * std::f32::consts::PI;
    if x == 0.0 { 1.0 } else { a.sin() / a }
}

/// The pixels of a row or column that make one of the new ones: the first of them, and the weight of each.
struct Taps {
    first: usize,
    weights: Vec<f32>,
}

impl Taps {
    fn new(filter: Filter, old: u32, new: u32, pixel: u32) -> Self {
        let ratio = old as f32 / new as f32;
        let stretch = ratio.max(1.0);
        let reach = filter.reach() * stretch;
        let middle = (pixel as f32 + 0.5) * ratio;
        let first = ((middle - reach).floor() as i64).clamp(0, i64::from(old) - 1);
        let end = ((middle + reach).ceil() as i64).clamp(first + 1, old.into());
        let weight = |i: i64| filter.at((i as f32 - (middle - 0.5)) / stretch);
        let mut weights: Vec<f32> = (first..end).map(weight).collect();
        let sum = weights.iter().fold(0.0, |sum, weight| sum + weight);
        weights.iter_mut().for_each(|weight| *weight /= sum);
        Self { first: first as usize, weights }
    }

    /// The weighted sum of pixels, by their place in the row or column.
    fn sum(&self, pixel: impl Fn(usize) -> [f32; 3]) -> [f32; 3] {
        let mut sum = [0.0; 3];
        for (i, weight) in self.weights.iter().enumerate() {
            let pixel = pixel(self.first + i);
            sum.iter_mut().zip(pixel).for_each(|(sum, value)| *sum += value * weight);
        }
        sum
    }
}

impl RgbImage {
    /// Of another size.
    ///
    /// # Panics
    /// If it has no pixels.
    pub fn scaled(&self, [width, height]: [u32; 2], filter: Filter) -> Self {
        if self.size() == [width, height] {
            return self.clone();
        }
        let columns = self.width as usize;
        let mut rows = Vec::with_capacity(columns * height as usize);
        for y in 0..height {
            let taps = Taps::new(filter, self.height, height, y);
            let value = |x: usize, y: usize| self.pixels[y * columns + x].map(f32::from);
            rows.extend((0..columns).map(|x| taps.sum(|y| value(x, y))));
        }
        let taps: Vec<_> = (0..width).map(|x| Taps::new(filter, self.width, width, x)).collect();
        Self::from_fn(width, height, |x, y| {
            let sum = taps[x as usize].sum(|x| rows[y as usize * columns + x]);
            sum.map(|value| value.clamp(0.0, 255.0).round() as u8)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plain_picture_stays_plain_and_a_step_stays_a_step() {
        for filter in [Filter::Triangle, Filter::Lanczos3] {
            for size in [[3, 2], [17, 40]] {
                let plain = RgbImage::filled(9, 7, [3, 99, 255]).scaled(size, filter);
                assert_eq!(plain, RgbImage::filled(size[0], size[1], [3, 99, 255]), "{filter:?}");
            }
            let step = RgbImage::from_fn(64, 8, |x, _| [if x < 32 { 0 } else { 200 }; 3]);
            let small = step.scaled([16, 2], filter);
            assert_eq!([small.pixel(0, 0), small.pixel(15, 1)], [[0; 3], [200; 3]]);
            assert!(small.pixel(7, 0)[0] < 100 && small.pixel(8, 0)[0] > 100);
        }
    }
}
