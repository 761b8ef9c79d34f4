//! Scalar fields on a regular grid: densities or opacities of volume data sets.

use glam::DVec3;
use itertools::iproduct;
use serde::{Deserialize, Serialize};

use super::{Bounds, check};
use fathom_base::choices;

/// The stored axis that points up in the world.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Up {
    /// Stored x is world y, y is z, z is x.
    X,
    /// As stored.
    #[default]
    Y,
    /// Stored z is world y, y is −z, x is x: upright scans.
    Z,
}

choices!(Up);

/// Values at the centres of the cells of a box, 0 … 1.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Volume {
    /// As in the scene file.
    pub name: String,
    /// Cells along x, y and z.
    pub cells: [u32; 3],
    /// The corner of smallest coordinates, metres.
    pub origin_m: DVec3,
    /// Edges of a cell, metres.
    pub spacing_m: DVec3,
    /// x runs fastest, then y, then z.
    pub data: Vec<f32>,
}

impl Volume {
    pub fn bounds(&self) -> Bounds {
        let size = self.spacing_m * DVec3::from(self.cells.map(f64::from));
        Bounds { min: self.origin_m, max: self.origin_m + size }
    }

    /// Whether the values fill the cells and can be used; the error says what is wrong and where.
    pub fn validate(&self) -> Result<(), String> {
        let count: u64 = self.cells.iter().map(|n| u64::from(*n)).product();
        if count == 0 || self.data.len() as u64 != count {
            let [x, y, z] = self.cells;
            let values = self.data.len();
            return Err(format!("a volume of {x} × {y} × {z} cells has {values} values"));
        }
        for place in self.origin_m.to_array() {
            check::check_range("volume origin", place, -check::FAR_M, check::FAR_M)?;
        }
        for edge in self.spacing_m.to_array() {
            check::check_range("volume spacing", edge, 1e-9, check::FAR_M)?;
        }
        match self.data.iter().position(|v| !(0.0..=1.0).contains(v)) {
            Some(i) => Err(format!("value {i} is {}: values must lie in 0 to 1", self.data[i])),
            None => Ok(()),
        }
    }

    pub fn value(&self, [x, y, z]: [u32; 3]) -> f32 {
        let [nx, ny, _] = self.cells.map(|n| n as usize);
        self.data[x as usize + nx * (y as usize + ny * z as usize)]
    }

    /// The error counts values that are not finite and names the first.
    pub(super) fn check_finite(&self) -> Result<(), String> {
        let Some(first) = self.data.iter().position(|v| !v.is_finite()) else {
            return Ok(());
        };
        let count = self.data.iter().filter(|v| !v.is_finite()).count();
        let [nx, ny, _] = self.cells.map(|n| n as usize);
        let (x, y, z) = (first % nx, first / nx % ny, first / (nx * ny));
        let (of, value) = (self.data.len(), self.data[first]);
        Err(format!(
            "{count} of {of} values are not finite: the first, {value}, lies in cell ({x}, {y}, {z})"
        ))
    }

    /// Means over boxes of `factor` cells along each axis. Where the cells do not divide, the last box takes those there are.
    #[must_use]
    pub fn reduced(self, factor: u32) -> Volume {
        if factor <= 1 {
            return self;
        }
        let cells = self.cells.map(|n| n.div_ceil(factor));
        let span = |axis: usize, i: u32| i * factor..((i + 1) * factor).min(self.cells[axis]);
        let mean = |(z, y, x)| {
            let (mut sum, mut count) = (0.0, 0u32);
            for (k, j, i) in iproduct!(span(2, z), span(1, y), span(0, x)) {
                sum += f64::from(self.value([i, j, k]));
                count += 1;
            }
            (sum / f64::from(count)) as f32
        };
        let data = iproduct!(0..cells[2], 0..cells[1], 0..cells[0]).map(mean).collect();
        Volume { cells, spacing_m: self.spacing_m * f64::from(factor), data, ..self }
    }

    /// Turned so that `up` is y.
    #[must_use]
    pub(super) fn upright(self, up: Up) -> Volume {
        let [nx, ny, nz] = self.cells;
        let s = self.spacing_m;
        let (cells, spacing_m) = match up {
            Up::X => ([nz, nx, ny], DVec3::new(s.z, s.x, s.y)),
            Up::Y => return self,
            Up::Z => ([nx, nz, ny], DVec3::new(s.x, s.z, s.y)),
        };
        let mut data = Vec::with_capacity(self.data.len());
        for (z, y) in iproduct!(0..cells[2], 0..cells[1]) {
            data.extend((0..cells[0]).map(|x| match up {
                Up::X => self.value([y, z, x]),
                _ => self.value([x, ny - 1 - z, y]),
            }));
        }
        Volume { cells, spacing_m, data, ..self }
    }

    /// The values brought to 0 … 1, linear within `window` (low, high) and clamped outside of it.
    pub(super) fn windowed(&mut self, [low, high]: [f64; 2]) {
        let scale = 1.0 / (high - low);
        for v in &mut self.data {
            *v = ((f64::from(*v) - low) * scale).clamp(0.0, 1.0) as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_are_found() {
        let spacing_m = DVec3::new(0.5, 1.0, 1.0);
        let volume = |data| Volume { cells: [2, 1, 1], spacing_m, data, ..Volume::default() };
        assert!(volume(vec![0.0, 1.0]).validate().is_ok());
        assert_eq!(volume(vec![0.0, 1.0]).bounds().max, DVec3::ONE);
        assert!(volume(vec![0.0]).validate().unwrap_err().contains("1 values"));
        assert!(volume(vec![0.0, f32::NAN]).validate().unwrap_err().contains("value 1 is NaN"));
        assert!(volume(vec![0.0, 1.5]).validate().is_err());
    }

    /// Each value tells its cell: x + 10 y + 100 z.
    fn numbered(cells: [u32; 3]) -> Volume {
        let [nx, ny, nz] = cells;
        let value = |(z, y, x)| (x + 10 * y + 100 * z) as f32;
        Volume {
            cells,
            spacing_m: DVec3::new(1.0, 2.0, 3.0),
            data: iproduct!(0..nz, 0..ny, 0..nx).map(value).collect(),
            ..Volume::default()
        }
    }

    #[test]
    fn reducing_takes_means_and_keeps_the_rest_of_the_border() {
        let reduced = numbered([4, 3, 2]).reduced(2);
        assert_eq!(reduced.cells, [2, 2, 1]);
        assert_eq!(reduced.spacing_m, DVec3::new(2.0, 4.0, 6.0));
        assert_eq!(reduced.data, [55.5, 57.5, 70.5, 72.5]);
        assert_eq!(numbered([4, 3, 2]).reduced(1), numbered([4, 3, 2]));
    }

    #[test]
    fn turning_upright_is_a_rotation() {
        let z_up = numbered([2, 3, 4]).upright(Up::Z);
        assert_eq!((z_up.cells, z_up.spacing_m.y), ([2, 4, 3], 3.0));
        // Stored (1, 0, 3) lies at x = 1, y = 3 and the far end of z.
        assert_eq!(z_up.value([1, 3, 2]), 301.0);
        let x_up = numbered([2, 3, 4]).upright(Up::X);
        assert_eq!((x_up.cells, x_up.spacing_m), ([4, 2, 3], DVec3::new(3.0, 1.0, 2.0)));
        assert_eq!(x_up.value([3, 1, 2]), 321.0);
    }

    #[test]
    fn a_window_is_linear_and_clamps() {
        let windowed = |window| {
            let mut samples = numbered([4, 1, 1]);
            samples.windowed(window);
            samples.data
        };
        assert_eq!(windowed([1.0, 2.0]), [0.0, 0.0, 1.0, 1.0]);
        let falling = windowed([3.0, 0.0]);
        assert_eq!((falling[0], falling[3]), (1.0, 0.0));
    }
}
