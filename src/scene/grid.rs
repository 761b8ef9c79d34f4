//! Grids of cubic voxels.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::Bounds;

/// A box of cubic voxels in the world. Voxel (i, j, k) spans `origin_m + voxel_m · (i, j, k)` to
/// `origin_m + voxel_m · (i + 1, j + 1, k + 1)`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Grid {
    /// Voxels along x, y and z.
    pub cells: [u32; 3],
    /// The corner of smallest coordinates, metres.
    pub origin_m: DVec3,
    /// Edge of a voxel, metres.
    pub voxel_m: f64,
}

/// Empty space between the box that a grid is fitted to and the grid's border, voxels. Half a voxel more than one, so that
/// walls along the box pass through the middle of voxels and not between them.
const MARGIN_VOXELS: f64 = 1.5;

impl Grid {
    /// The grid that holds `bounds` with a margin of 1.5 voxels on all sides, `resolution` voxels along the longest one.
    ///
    /// # Errors
    /// Fewer than four voxels, and bounds that hold nothing.
    pub fn fit(bounds: &Bounds, resolution: u32) -> Result<Grid, String> {
        let size = bounds.size();
        let longest = size.max_element();
        if resolution < 4 {
            return Err(format!(
                "a grid of {resolution} voxels has no room for its margin: use at least 4"
            ));
        }
        if !longest.is_finite() || longest <= 0.0 {
            return Err("there is nothing to lay a grid around".into());
        }
        let voxel_m = longest / (f64::from(resolution) - 2.0 * MARGIN_VOXELS);
        // The longest side comes out at the resolution whatever the rounding.
        let inner = (size / voxel_m - 1e-6).ceil() + 2.0 * MARGIN_VOXELS;
        let cells = inner.to_array().map(|n| (n as u32).clamp(4, resolution));
        Ok(Grid { cells, origin_m: bounds.min - MARGIN_VOXELS * voxel_m, voxel_m })
    }

    /// A cube of `edge_m` around a point, `resolution` voxels along each side.
    ///
    /// # Errors
    /// No voxels, and an edge that is not positive.
    pub fn around(center: DVec3, edge_m: f64, resolution: u32) -> Result<Grid, String> {
        if resolution == 0 || !(edge_m.is_finite() && edge_m > 0.0) {
            return Err(format!("a box of {edge_m} m and {resolution} voxels is no grid"));
        }
        Ok(Grid {
            cells: [resolution; 3],
            origin_m: center - edge_m / 2.0,
            voxel_m: edge_m / f64::from(resolution),
        })
    }

    pub fn count(&self) -> u64 {
        self.cells.iter().map(|n| u64::from(*n)).product()
    }

    /// 32-bit words that hold a bit for each voxel.
    pub fn words(&self) -> u64 {
        self.count().div_ceil(32)
    }

    /// Extents, metres.
    pub fn size_m(&self) -> DVec3 {
        self.voxel_m * DVec3::from(self.cells.map(f64::from))
    }

    pub fn bounds(&self) -> Bounds {
        Bounds { min: self.origin_m, max: self.origin_m + self.size_m() }
    }

    /// A world point in voxels from the origin.
    pub fn to_cells(&self, point: DVec3) -> DVec3 {
        (point - self.origin_m) / self.voxel_m
    }

    /// Centre of a voxel in the world.
    pub fn center(&self, cell: [u32; 3]) -> DVec3 {
        self.origin_m + self.voxel_m * (DVec3::from(cell.map(f64::from)) + 0.5)
    }

    /// Place of a voxel in memory: x runs fastest, then y, then z. Its bit is bit `index % 32` of word `index / 32`.
    pub fn index(&self, cell: [u32; 3]) -> u64 {
        let [nx, ny, _] = self.cells.map(u64::from);
        let [x, y, z] = cell.map(u64::from);
        x + nx * (y + ny * z)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bounds(size: [f64; 3]) -> Bounds {
        let min = DVec3::new(1.0, -2.0, 3.0);
        Bounds { min, max: min + DVec3::from(size) }
    }

    #[test]
    fn a_fitted_grid_holds_its_box_with_a_margin() {
        for resolution in [4, 5, 64, 128, 257] {
            let inner = bounds([2.0, 1.0, 0.3]);
            let grid = Grid::fit(&inner, resolution).unwrap();
            assert_eq!(grid.cells[0], resolution);
            let outer = grid.bounds();
            let low = (inner.min - outer.min) / grid.voxel_m;
            let high = (outer.max - inner.max) / grid.voxel_m;
            assert!(low.min_element() > 1.49 && high.min_element() > 1.49, "{low} {high}");
            assert!(high.max_element() < 4.0, "{high}");
        }
    }

    #[test]
    fn flat_boxes_and_bad_ones() {
        assert_eq!(Grid::fit(&bounds([1.0, 0.0, 1.0]), 64).unwrap().cells, [64, 4, 64]);
        assert!(Grid::fit(&bounds([0.0; 3]), 64).is_err());
        assert!(Grid::fit(&Bounds::EMPTY, 64).is_err());
        assert!(Grid::fit(&bounds([1.0; 3]), 3).is_err());
        assert!(Grid::around(DVec3::ZERO, 0.0, 8).is_err());
    }

    #[test]
    fn centres_and_indices_agree() {
        let grid = Grid::around(DVec3::ONE, 4.0, 8).unwrap();
        let cell = [3, 5, 7];
        assert_eq!(grid.to_cells(grid.center(cell)), DVec3::new(3.5, 5.5, 7.5));
        assert_eq!(grid.index(cell), 3 + 8 * (5 + 8 * 7));
        assert_eq!(grid.words(), 16);
    }
}
