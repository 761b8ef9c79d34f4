//! A grey image in f64, row 0 on top.

use itertools::iproduct;
use serde::{Deserialize, Serialize};

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Image {
    width: u32,
    height: u32,
    data: Vec<f64>,
}

impl Image {
    pub fn constant(width: u32, height: u32, value: f64) -> Image {
        Image { width, height, data: vec![value; width as usize * height as usize] }
    }

    pub fn from_fn(size: [u32; 2], mut value: impl FnMut(u32, u32) -> f64) -> Image {
        let [width, height] = size;
        Image { width, height, data: pixels(size).map(|(x, y)| value(x, y)).collect() }
    }

    /// An image from values in rows: as many as it has pixels.
    pub fn from_data([width, height]: [u32; 2], data: Vec<f64>) -> Image {
        assert_eq!(data.len(), width as usize * height as usize);
        Image { width, height, data }
    }

    #[must_use]
    pub fn map(&self, change: impl Fn(f64) -> f64) -> Image {
        let data = self.data.iter().map(|value| change(*value)).collect();
        Image { width: self.width, height: self.height, data }
    }

    pub fn width(&self) -> u32 {
        self.width
    }

    pub fn height(&self) -> u32 {
        self.height
    }

    pub fn size(&self) -> [u32; 2] {
        [self.width, self.height]
    }

    pub fn data(&self) -> &[f64] {
        &self.data
    }

    pub fn contains(&self, x: i64, y: i64) -> bool {
        (0..i64::from(self.width)).contains(&x) && (0..i64::from(self.height)).contains(&y)
    }

    pub fn get(&self, (x, y): (u32, u32)) -> f64 {
        self.clamped(x.into(), y.into())
    }

    /// Value at a pixel; coordinates beyond the border are clamped to it.
    pub fn clamped(&self, x: i64, y: i64) -> f64 {
        let x = x.clamp(0, i64::from(self.width) - 1) as usize;
        let y = y.clamp(0, i64::from(self.height) - 1) as usize;
        self.data[y * self.width as usize + x]
    }

    /// Nearest value at a position in 0…1 of the image's width and height, clamped to the border.
    pub fn nearest(&self, u: f64, v: f64) -> f64 {
        self.clamped(
            (u * f64::from(self.width)).floor() as i64,
            (v * f64::from(self.height)).floor() as i64,
        )
    }

    /// Adds to a pixel; outside the image nothing happens.
    pub fn add(&mut self, x: i64, y: i64, value: f64) {
        if self.contains(x, y) {
            self.data[y as usize * self.width as usize + x as usize] += value;
        }
    }

    /// Means over square blocks of `side` pixels; those at the right and at the bottom are smaller where the image ends.
    #[must_use]
    pub fn downsample(&self, side: u32) -> Image {
        let size = self.size().map(|pixels| pixels.div_ceil(side));
        let within = |block: u32, end: u32| block * side..((block + 1) * side).min(end);
        Image::from_fn(size, |x, y| {
            let (columns, rows) = (within(x, self.width), within(y, self.height));
            let count = columns.len() * rows.len();
            let values = iproduct!(rows, columns).map(|(y, x)| self.clamped(x.into(), y.into()));
            values.sum::<f64>() / count as f64
        })
    }

    pub fn sum(&self) -> f64 {
        self.data.iter().sum()
    }

    pub fn mean(&self) -> f64 {
        self.sum() / self.data.len() as f64
    }
}

/// The pixel of an image that a texel of another over the same view belongs to: the one its middle falls into, the right and
/// lower one on a border.
pub fn pixel_behind(texel: [f64; 2], own: [u32; 2], size: [u32; 2]) -> [i64; 2] {
    [0, 1].map(|k| {
        let place = (texel[k] + 0.5) * f64::from(size[k]) / f64::from(own[k]);
        ((place + 1e-3) as i64).min(i64::from(size[k]) - 1)
    })
}

/// The pixels (x, y) of an image, row by row.
pub fn pixels([width, height]: [u32; 2]) -> impl Iterator<Item = (u32, u32)> + Clone {
    iproduct!(0..height, 0..width).map(|(y, x)| (x, y))
}
