//! Water given as a height map: a periodic tile of heights from a `.npy` file.

use std::io::Read;
use std::path::Path;

use glam::{DVec2, DVec3};

use super::check;
use fathom_base::{input, npy, settings};

/// Most samples along a side: every adapter holds a texture of this size.
pub const MAX_SIDE: usize = 4096;
/// Largest file, bytes: so many heights of 8 bytes along both sides, and the longest header of version 1.
const MAX_FILE: u64 = (8 * MAX_SIDE * MAX_SIDE + (1 << 16)) as u64;
/// Greatest height, metres, as of the other kinds of water.
const MAX_HEIGHT_M: f64 = 100.0;

settings! {
    /// Where the heights are and how they lie.
    pub struct HeightMap {
        /// A `.npy` file of two dimensions, f32 or f64, metres: a row per z, a column per x.
        file: String = String::new();
        /// Size of the tile along x and z; it repeats without end. 1 mm at least where a file is named.
        tile_m: [f64; 2] = [0.0; 2] => 0.0 ..= 1e5, "m";
        /// Where the first sample of the first row lies: x, z.
        origin_m: [f64; 2] = [0.0; 2] => -1e5 ..= 1e5, "m";
    }
}

impl HeightMap {
    pub fn is_given(&self) -> bool {
        !self.file.is_empty()
    }

    /// Whether the tile can be laid; the file is not opened.
    pub fn validate(&self) -> Result<(), String> {
        check::within_ranges("water.height_map", self)?;
        if !self.is_given() {
            return Ok(());
        }
        for (i, side_m) in self.tile_m.iter().enumerate() {
            check::within(&format!("water.height_map.tile_m[{i}]"), *side_m, 1e-3, check::FAR_M)?;
        }
        Ok(())
    }

    /// Reads the file.
    pub fn load(&self) -> Result<Tile, String> {
        let path = Path::new(&self.file);
        let fault = |what: String| format!("water.height_map.file {}: {what}", path.display());
        let source = input::unpacked(path, MAX_FILE).map_err(|e| fault(e.to_string()))?;
        let (columns, heights_m) = parse(source).map_err(fault)?;
        Tile::new(columns, heights_m, self).map_err(fault)
    }

    /// The map with its file found from `folder`.
    pub(super) fn found_from(&self, folder: &Path) -> HeightMap {
        let mut map = self.clone();
        if self.is_given() {
            map.file = folder.join(&self.file).to_string_lossy().into_owned();
        }
        map
    }
}

/// Columns, and heights row by row.
fn parse(source: impl Read) -> Result<(usize, Vec<f64>), String> {
    let npy::Array { shape, values } =
        npy::read(source, MAX_SIDE * MAX_SIDE).map_err(|error| error.to_string())?;
    let &[rows, columns] = &shape[..] else {
        return Err(format!("an array of {} dimensions; heights have two", shape.len()));
    };
    if !(1..=MAX_SIDE).contains(&rows) || !(1..=MAX_SIDE).contains(&columns) {
        return Err(format!("{rows} × {columns} heights; each side has 1 to {MAX_SIDE}"));
    }
    match values.iter().position(|h| h.is_nan() || h.abs() > MAX_HEIGHT_M) {
        None => Ok((columns, values)),
        Some(i) => {
            let (row, column, h) = (i / columns, i % columns, values[i]);
            Err(format!(
                "row {row}, column {column}: a height of {h} m; heights lie within ±{MAX_HEIGHT_M} m"
            ))
        }
    }
}

/// A tile of heights in memory. Between samples it is the bicubic Catmull–Rom spline: it passes through every
/// sample, and its slope, which gives the normal, is continuous.
#[derive(Clone, Debug, PartialEq)]
pub struct Tile {
    rows: usize,
    columns: usize,
    heights_m: Vec<f64>,
    tile_m: DVec2,
    origin_m: DVec2,
    bound_m: f64,
    steepest: f64,
}

/// Greatest factor by which a Catmull–Rom spline overshoots along an axis: Σ|w| at the middle is 1.25.
const OVERSHOOT: f64 = 1.25 * 1.25;
/// The same of its slope: −1/8, 5/4 and −1/8 of the differences along the axis at the middle, and 1.25 across.
const SLOPE_OVERSHOOT: f64 = 1.5 * 1.25;

/// Weights of the four samples about a place `f` of the way from the second to the third.
fn weights(f: f64) -> [f64; 4] {
    [
        f * (-0.5 + f * (1.0 - 0.5 * f)),
        1.0 + f * f * (-2.5 + 1.5 * f),
        f * (0.5 + f * (2.0 - 1.5 * f)),
        f * f * (-0.5 + 0.5 * f),
    ]
}

/// Their derivatives by `f`.
fn slopes(f: f64) -> [f64; 4] {
    [
        -0.5 + f * (2.0 - 1.5 * f),
        f * (-5.0 + 4.5 * f),
        0.5 + f * (4.0 - 4.5 * f),
        f * (-1.0 + 1.5 * f),
    ]
}

impl Tile {
    /// Heights row by row, laid as `map` says; its file plays no part.
    pub fn new(columns: usize, heights_m: Vec<f64>, map: &HeightMap) -> Result<Tile, String> {
        let rows = heights_m.len() / columns.max(1);
        if rows * columns != heights_m.len() || rows == 0 {
            return Err(format!("{} heights do not fill rows of {columns}", heights_m.len()));
        }
        let tile_m = DVec2::from(map.tile_m);
        let highest = heights_m.iter().fold(0.0, |most: f64, h| most.max(h.abs()));
        let rises = (0..heights_m.len()).map(|at| {
            let (row, column) = (at / columns, at % columns);
            let right = heights_m[row * columns + (column + 1) % columns];
            let below = heights_m[(row + 1) % rows * columns + column];
            (DVec2::new(right, below) - heights_m[at]).abs()
        });
        let per_m = DVec2::new(columns as f64, rows as f64) / tile_m;
        let steepest = SLOPE_OVERSHOOT * (rises.fold(DVec2::ZERO, DVec2::max) * per_m).length();
        Ok(Tile {
            rows,
            columns,
            tile_m,
            origin_m: DVec2::from(map.origin_m),
            bound_m: OVERSHOOT * highest,
            steepest,
            heights_m,
        })
    }

    pub fn size(&self) -> [u32; 2] {
        [self.columns as u32, self.rows as u32]
    }

    /// Elevation, metres, and its derivatives by x and z.
    pub fn at(&self, place: DVec2) -> DVec3 {
        let size = DVec2::new(self.columns as f64, self.rows as f64);
        let share = (place - self.origin_m) / self.tile_m;
        let texel = (share - share.floor()) * size;
        let base = texel.floor();
        let f = texel - base;
        let (wx, wz, dx, dz) = (weights(f.x), weights(f.y), slopes(f.x), slopes(f.y));
        let mut sum = DVec3::ZERO;
        for j in 0..4 {
            let row = (base.y as usize + self.rows + j).wrapping_sub(1) % self.rows;
            for i in 0..4 {
                let column = (base.x as usize + self.columns + i).wrapping_sub(1) % self.columns;
                let h = self.heights_m[row * self.columns + column];
                sum += h * DVec3::new(wx[i] * wz[j], dx[i] * wz[j], wx[i] * dz[j]);
            }
        }
        let per_m = size / self.tile_m;
        DVec3::new(sum.x, sum.y * per_m.x, sum.z * per_m.y)
    }

    /// Bound of the elevation's magnitude, metres.
    pub fn bound_m(&self) -> f64 {
        self.bound_m
    }

    /// Bound of the slope.
    pub fn steepest(&self) -> f64 {
        self.steepest
    }

    /// Smaller distance between neighbouring samples, metres.
    pub fn spacing_m(&self) -> f64 {
        (self.tile_m.x / self.columns as f64).min(self.tile_m.y / self.rows as f64)
    }

    /// Heights row by row.
    pub fn texels(&self) -> Vec<f32> {
        self.heights_m.iter().map(|h| *h as f32).collect()
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;

    fn bytes(shape: &[usize], heights_m: &[f64]) -> Vec<u8> {
        let values = heights_m.iter().flat_map(|h| h.to_le_bytes());
        npy::header("<f8", shape).into_iter().chain(values).collect()
    }

    /// One wave along each axis, 24 rows of 32 columns over 4 m × 3 m.
    fn wavy() -> Tile {
        let height = |at: usize| {
            let (i, j) = ((at % 32) as f64, (at / 32) as f64);
            0.1 * (TAU * i / 32.0).cos() + 0.05 * (TAU * j / 24.0).sin()
        };
        let heights: Vec<f64> = (0..24 * 32).map(height).collect();
        let (columns, heights_m) = parse(&bytes(&[24, 32], &heights)[..]).unwrap();
        let map = HeightMap { tile_m: [4.0, 3.0], origin_m: [0.5, -0.25], ..HeightMap::default() };
        assert!(Tile::new(5, heights_m.clone(), &map).is_err());
        Tile::new(columns, heights_m, &map).unwrap()
    }

    #[test]
    fn it_passes_through_the_samples_and_repeats() {
        let tile = wavy();
        for (i, j) in [(0, 0), (5, 3), (31, 23)] {
            let at = tile.origin_m + DVec2::new(f64::from(i), f64::from(j)) * 0.125;
            let sample = tile.heights_m[j as usize * 32 + i as usize];
            assert!((tile.at(at).x - sample).abs() < 1e-12, "{i}, {j}");
            let far = at + DVec2::new(-3.0, 5.0) * tile.tile_m;
            assert!((tile.at(far) - tile.at(at)).length() < 1e-9);
        }
    }

    #[test]
    fn between_samples_it_follows_the_waves_that_were_sampled() {
        let tile = wavy();
        for i in 0..500 {
            let place = DVec2::new(f64::from(i).sin(), f64::from(i * 7).cos()) * 5.0;
            let angle = (place - tile.origin_m) * TAU / tile.tile_m;
            let height = 0.1 * angle.x.cos() + 0.05 * angle.y.sin();
            let slope = DVec2::new(-0.1 * angle.x.sin(), 0.05 * angle.y.cos()) * TAU / tile.tile_m;
            let at = tile.at(place);
            assert!((at.x - height).abs() < 2e-4, "{at} for {height}");
            assert!((DVec2::new(at.y, at.z) - slope).length() < 4e-3, "{at} for {slope}");
            assert!(at.x.abs() <= tile.bound_m());
            assert!(at.y.hypot(at.z) <= tile.steepest());
        }
    }

    #[test]
    fn slopes_are_those_of_the_heights_and_continuous() {
        let tile = wavy();
        let h = 1e-6;
        for i in 0..200 {
            let place = DVec2::new(f64::from(i) * 0.0625, f64::from(i).cos());
            let across =
                |step: DVec2| (tile.at(place + step).x - tile.at(place - step).x) / (2.0 * h);
            let at = tile.at(place);
            assert!((at.y - across(DVec2::X * h)).abs() < 1e-5);
            assert!((at.z - across(DVec2::Y * h)).abs() < 1e-5);
        }
    }

    #[test]
    fn both_widths_give_the_same_heights() {
        let heights = [0.0, 0.5, 1.0, 1.5, 2.0, 2.5];
        let whole = parse(&bytes(&[2, 3], &heights)[..]).unwrap();
        assert_eq!(whole, (3, heights.to_vec()));
        let mut narrow = Vec::new();
        npy::write(&mut narrow, &[2, 3], &heights.map(|h| h as f32)).unwrap();
        assert_eq!(parse(&narrow[..]).unwrap(), whole);
    }

    #[test]
    fn bad_files_are_answered_in_one_line() {
        let fault = |bytes: &[u8]| {
            let fault = parse(bytes).unwrap_err();
            assert!(!fault.contains('\n'), "{fault}");
            fault
        };
        assert!(fault(&bytes(&[2, 2], &[f64::NAN; 4])).contains("row 0, column 0"));
        assert!(fault(&bytes(&[2, 2], &[101.0; 4])).contains("101 m"));
        assert!(fault(&bytes(&[0, 4], &[])).contains("0 × 4"));
        assert!(fault(&bytes(&[1, 5000], &[0.0; 5000])).contains("1 to 4096"));
        assert!(fault(&bytes(&[4], &[0.0; 4])).contains("1 dimensions"));
        let good = bytes(&[4, 4], &[0.0; 16]);
        for cut in 0..good.len() {
            fault(&good[..cut]);
        }
    }

    #[test]
    fn tiles_without_size_are_refused() {
        let mut map = HeightMap { file: "sea.npy".into(), ..HeightMap::default() };
        assert!(map.validate().unwrap_err().contains("water.height_map.tile_m[0] is 0"));
        map.tile_m = [4.0, f64::NAN];
        assert!(map.validate().unwrap_err().contains("water.height_map.tile_m[1]"));
        map.tile_m = [4.0, 4.0];
        assert!(map.load().unwrap_err().starts_with("water.height_map.file sea.npy: "));
    }
}
