//! Stored values of a volume, as its file or generator gives them, on the way to a [`super::Volume`].

use std::io::{self, Read};
use std::path::Path;

use glam::DVec3;
use itertools::iproduct;
use serde::{Deserialize, Serialize};

use super::raw::{self, Raw};
use super::{nifti, read};

/// Most cells of a volume: 512³, which are 512 MiB of 32-bit floats.
pub const MAX_CELLS: u64 = 1 << 27;

/// Values that are read at a time.
const CHUNK: usize = 1 << 14;

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

/// Values on a grid, x fastest, then y, then z.
#[derive(Clone, Debug, PartialEq)]
pub struct VolumeSamples {
    pub cells: [u32; 3],
    /// Edges of a cell, metres.
    pub spacing_m: DVec3,
    pub data: Vec<f32>,
    /// The stored values that stand for 0 and for 1.
    pub window: [f64; 2],
}

/// Reads `.nii` and `.nii.gz` by their header; everything else, plain or compressed by gzip, is the cells that `raw` tells.
pub fn read(path: &Path, raw: Option<&Raw>) -> Result<VolumeSamples, String> {
    let malformed = |what| format!("volume {}: {what}", path.display());
    let mut source =
        read::open(path).map_err(|e| format!("cannot read the volume {}: {e}", path.display()))?;
    let samples = match (is_nifti(path), raw) {
        (true, None) => nifti::parse(&mut source),
        (true, Some(_)) => Err("its header tells `cells` and `format`: leave them out".into()),
        (false, Some(raw)) => raw::parse(&mut source, raw),
        (false, None) => Err("a raw file needs `cells` and `format`".into()),
    };
    let samples = samples.map_err(malformed)?;
    // To the end of the archive, whose checksum stands there.
    io::copy(&mut source, &mut io::sink()).map_err(|e| malformed(e.to_string()))?;
    samples.check_finite().map_err(malformed)?;
    Ok(samples)
}

/// Reads up to `count` values of so many bytes each: fewer where the source ends before. Gives the bytes that were read, too.
pub fn values(
    source: &mut dyn Read,
    count: usize,
    bytes: usize,
    value: impl Fn(&[u8]) -> f32,
) -> Result<(Vec<f32>, usize), String> {
    let (mut values, mut read) = (Vec::new(), 0);
    while values.len() < count {
        let wanted = (count - values.len()).min(CHUNK) * bytes;
        let chunk = up_to(source, wanted)?;
        values.extend(chunk.chunks_exact(bytes).map(&value));
        read += chunk.len();
        if chunk.len() < wanted {
            break;
        }
    }
    Ok((values, read))
}

/// The next bytes: fewer where the source ends before.
pub fn up_to(source: &mut dyn Read, wanted: usize) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::with_capacity(wanted);
    source.take(wanted as u64).read_to_end(&mut bytes).map_err(|error| error.to_string())?;
    Ok(bytes)
}

fn is_nifti(path: &Path) -> bool {
    let name = path.to_string_lossy().to_ascii_lowercase();
    name.ends_with(".nii") || name.ends_with(".nii.gz")
}

/// The number of cells, if so many can be held in memory.
pub fn cell_count(cells: [u32; 3]) -> Result<usize, String> {
    let [x, y, z] = cells;
    match cells.iter().try_fold(1u64, |n, c| n.checked_mul(u64::from(*c))) {
        Some(0) => {
            Err(format!("{x} × {y} × {z} cells: there must be one at least along each axis"))
        }
        Some(count) if count <= MAX_CELLS => Ok(count as usize),
        _ => Err(format!("{x} × {y} × {z} cells: at most {MAX_CELLS} are held")),
    }
}

impl VolumeSamples {
    fn at(&self, [x, y, z]: [u32; 3]) -> f32 {
        let [nx, ny, _] = self.cells.map(|n| n as usize);
        self.data[x as usize + nx * (y as usize + ny * z as usize)]
    }

    /// The error counts values that are not finite and names the first.
    fn check_finite(&self) -> Result<(), String> {
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
    pub fn reduced(self, factor: u32) -> VolumeSamples {
        if factor <= 1 {
            return self;
        }
        let cells = self.cells.map(|n| n.div_ceil(factor));
        let span = |axis: usize, i: u32| i * factor..((i + 1) * factor).min(self.cells[axis]);
        let mean = |(z, y, x)| {
            let (mut sum, mut count) = (0.0, 0u32);
            for (k, j, i) in iproduct!(span(2, z), span(1, y), span(0, x)) {
                sum += f64::from(self.at([i, j, k]));
                count += 1;
            }
            (sum / f64::from(count)) as f32
        };
        let data = iproduct!(0..cells[2], 0..cells[1], 0..cells[0]).map(mean).collect();
        VolumeSamples {
            cells,
            spacing_m: self.spacing_m * f64::from(factor),
            data,
            window: self.window,
        }
    }

    /// Turned so that `up` is y.
    #[must_use]
    pub fn upright(self, up: Up) -> VolumeSamples {
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
                Up::X => self.at([y, z, x]),
                _ => self.at([x, ny - 1 - z, y]),
            }));
        }
        VolumeSamples { cells, spacing_m, data, window: self.window }
    }

    /// The values brought to 0 … 1, linear within `window` (low, high) and clamped outside of it.
    pub fn windowed(&mut self, [low, high]: [f64; 2]) {
        let scale = 1.0 / (high - low);
        for v in &mut self.data {
            *v = ((f64::from(*v) - low) * scale).clamp(0.0, 1.0) as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Each value tells its cell: x + 10 y + 100 z.
    fn numbered(cells: [u32; 3]) -> VolumeSamples {
        let [nx, ny, nz] = cells;
        let value = |(z, y, x)| (x + 10 * y + 100 * z) as f32;
        VolumeSamples {
            cells,
            spacing_m: DVec3::new(1.0, 2.0, 3.0),
            data: iproduct!(0..nz, 0..ny, 0..nx).map(value).collect(),
            window: [0.0, 1.0],
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
        assert_eq!(z_up.at([1, 3, 2]), 301.0);
        let x_up = numbered([2, 3, 4]).upright(Up::X);
        assert_eq!((x_up.cells, x_up.spacing_m), ([4, 2, 3], DVec3::new(3.0, 1.0, 2.0)));
        assert_eq!(x_up.at([3, 1, 2]), 321.0);
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

    #[test]
    fn values_that_are_not_finite_are_counted_and_the_first_named() {
        let mut samples = numbered([2, 2, 2]);
        samples.data[5] = f32::NAN;
        samples.data[6] = f32::INFINITY;
        let fault = samples.check_finite().unwrap_err();
        assert!(fault.contains("2 of 8"), "{fault}");
        assert!(fault.contains("NaN, lies in cell (1, 0, 1)"), "{fault}");
    }

    #[test]
    fn cells_are_counted_within_limits() {
        assert_eq!(cell_count([512; 3]), Ok(1 << 27));
        assert!(cell_count([513, 512, 512]).unwrap_err().contains("at most"));
        assert!(cell_count([u32::MAX; 3]).unwrap_err().contains("at most"));
        assert!(cell_count([4, 0, 4]).unwrap_err().contains("one at least"));
    }
}
