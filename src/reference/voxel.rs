//! Which voxels a surface occupies, in f64: by the separating axis theorem, and by sampling at the pixels of three axes.
//!
//! Overlap is judged by the widest gap between triangle and voxel over the axes that can separate them, in voxels: negative
//! where they overlap. Voxels whose gap is within a borderline band are counted apart, as rounding to f32 decides there.

use glam::{DVec2, DVec3};
use itertools::iproduct;

use fathom_scene::{Grid, Object};

/// Half width of the band of gaps that f32 cannot decide, voxels.
pub const BORDERLINE_VOXELS: f64 = 1e-4;

/// Steps per pixel to which a rasterizer may round corners: the fewest that Vulkan allows (`subPixelPrecisionBits` 4).
pub const MIN_SUBPIXELS: u32 = 16;

/// A triangle's corners, metres or voxels.
pub type Corners = [DVec3; 3];

/// All triangles of some objects, metres.
pub fn triangles(objects: &[Object]) -> Vec<Corners> {
    let meshes = objects.iter().map(|o| &o.mesh);
    meshes.flat_map(|m| (0..m.triangle_count()).map(|index| m.triangle(index))).collect()
}

/// The thirteen axes that can separate a triangle from a cube, of unit length; those without a direction are left out.
fn axes([a, b, c]: &Corners) -> Vec<DVec3> {
    let edges = [*b - *a, *c - *b, *a - *c];
    let crossed = edges.iter().flat_map(|edge| DVec3::AXES.map(|axis| axis.cross(*edge)));
    let normal = (*b - *a).cross(*c - *a);
    crossed.chain([normal]).filter_map(DVec3::try_normalize).chain(DVec3::AXES).collect()
}

/// The smallest gap between any of the triangles (metres) and each voxel, voxels, in the order of [`Grid::index`]. Infinite
/// where no triangle's box is near.
pub fn gaps(triangles: &[Corners], grid: &Grid) -> Vec<f64> {
    let mut gaps = vec![f64::INFINITY; grid.count() as usize];
    for corners in triangles {
        let corners = corners.map(|corner| grid.to_cells(corner));
        let spans: Vec<(DVec3, f64, f64)> = axes(&corners)
            .into_iter()
            .map(|axis| {
                let places = corners.map(|corner| corner.dot(axis));
                let low = places.into_iter().fold(f64::INFINITY, f64::min);
                let high = places.into_iter().fold(f64::NEG_INFINITY, f64::max);
                // Half of a unit cube's.
                let extent = 0.5 * axis.abs().element_sum();
                (axis, low - extent, high + extent)
            })
            .collect();
        for cell in near(&corners, grid) {
            let center = DVec3::from(cell.map(f64::from)) + 0.5;
            let apart = |&(axis, low, high): &(DVec3, f64, f64)| {
                let place = center.dot(axis);
                (low - place).max(place - high)
            };
            let gap = spans.iter().map(apart).fold(f64::NEG_INFINITY, f64::max);
            let index = grid.index(cell) as usize;
            gaps[index] = gaps[index].min(gap);
        }
    }
    gaps
}

/// Voxels of a triangle's box, grown by the borderline band.
fn near(corners: &Corners, grid: &Grid) -> impl Iterator<Item = [u32; 3]> + use<> {
    let [a, b, c] = *corners;
    let low = (a.min(b).min(c) - BORDERLINE_VOXELS).ceil() - 1.0;
    let high = (a.max(b).max(c) + BORDERLINE_VOXELS).floor();
    let cells = grid.cells;
    let range = move |k: usize| {
        let last = high[k].min(f64::from(cells[k]) - 1.0);
        low[k].max(0.0) as i64..=last.max(-1.0) as i64
    };
    iproduct!(range(2), range(1), range(0)).map(|(z, y, x)| [x, y, z].map(|k| k as u32))
}

/// What a voxelization found against what there is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct VoxelErrors {
    /// Voxels that a triangle occupies beyond doubt.
    pub occupied: u64,
    /// Of these, voxels not found.
    pub false_negatives: u64,
    /// Voxels found that no triangle occupies, beyond doubt.
    pub false_positives: u64,
    /// Voxels in the borderline band, left out of all other counts.
    pub borderline: u64,
}

/// Holds voxels that were found against gaps of [`gaps`].
pub fn errors(found: &[bool], gaps: &[f64]) -> VoxelErrors {
    let mut errors = VoxelErrors::default();
    for (found, gap) in found.iter().zip(gaps) {
        if gap.abs() <= BORDERLINE_VOXELS {
            errors.borderline += 1;
        } else if *gap < 0.0 {
            errors.occupied += 1;
            errors.false_negatives += u64::from(!found);
        } else {
            errors.false_positives += u64::from(*found);
        }
    }
    errors
}

/// What sampling says of a voxel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Cover {
    /// No sample falls into it.
    Never,
    /// One may, within the rasterizer's sub-pixel steps and the borderline band.
    Maybe,
    /// One does.
    Surely,
}

/// The voxels of a rasterization along each of `axes` (0 x, 1 y, 2 z): a voxel for each pixel whose centre a triangle covers, at
/// the triangle's depth there. VAO §4.1 and §4.2 take all three axes. `subpixels`: steps per pixel to which corners may be rounded.
pub fn sampled(triangles: &[Corners], grid: &Grid, axes: &[usize], subpixels: u32) -> Vec<Cover> {
    let mut covers = vec![Cover::Never; grid.count() as usize];
    for corners in triangles {
        let corners = corners.map(|corner| grid.to_cells(corner));
        for &axis in axes {
            sample(&corners, axis, subpixels, grid, &mut covers);
        }
    }
    covers
}

/// Voxels on which a rasterization and what sampling says of it disagree.
pub fn disagreements(found: &[bool], sampled: &[Cover]) -> u64 {
    let wrong = |(found, sampled): (&bool, &Cover)| match sampled {
        Cover::Never => *found,
        Cover::Maybe => false,
        Cover::Surely => !found,
    };
    found.iter().zip(sampled).filter(|pair| wrong(*pair)).count() as u64
}

/// One triangle's samples along one axis.
fn sample(corners: &Corners, axis: usize, subpixels: u32, grid: &Grid, found: &mut [Cover]) {
    let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
    let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
    // Rounding moves corners, and edges with them, by half a step at most in each of two directions.
    let step = std::f64::consts::FRAC_1_SQRT_2 / f64::from(subpixels) + BORDERLINE_VOXELS;
    let slope = normal[u].hypot(normal[v]) / normal[axis].abs();
    let blur = BORDERLINE_VOXELS + slope * step;
    for cell in flat(corners, axis, grid) {
        let center = DVec2::new(f64::from(cell[u]) + 0.5, f64::from(cell[v]) + 0.5);
        let inside = edge_distance(corners.map(|corner| DVec2::new(corner[u], corner[v])), center);
        if inside < -step {
            continue;
        }
        let (du, dv) = (center.x - corners[0][u], center.y - corners[0][v]);
        let depth = corners[0][axis] - (normal[u] * du + normal[v] * dv) / normal[axis];
        if !(depth.is_finite() && blur.is_finite()) {
            continue;
        }
        let last = f64::from(grid.cells[axis]) - 1.0;
        let (near, far) = ((depth - blur).floor(), (depth + blur).floor());
        let sure = inside > step && near == far;
        for slice in near.max(0.0) as i64..=far.min(last).max(-1.0) as i64 {
            let mut cell = cell;
            cell[axis] = slice as u32;
            let state = &mut found[grid.index(cell) as usize];
            *state = (*state).max(if sure { Cover::Surely } else { Cover::Maybe });
        }
    }
}

/// The voxels of a triangle's box in the first slice along `axis`: one for each pixel.
fn flat(corners: &Corners, axis: usize, grid: &Grid) -> impl Iterator<Item = [u32; 3]> + use<> {
    let mut flattened = *corners;
    flattened.iter_mut().for_each(|corner| corner[axis] = 0.5);
    near(&flattened, grid)
}

/// How far inside a triangle a point lies: its distance from the nearest edge's line, negative outside; NaN without area.
fn edge_distance([a, b, c]: [DVec2; 3], point: DVec2) -> f64 {
    let sign = (b - a).perp_dot(c - a).signum();
    let distance = |a: DVec2, b: DVec2| {
        let along = b - a;
        sign * along.perp_dot(point - a) / along.x.hypot(along.y)
    };
    distance(a, b).min(distance(b, c)).min(distance(c, a))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(cells: [u32; 3]) -> Grid {
        Grid { cells, origin_m: DVec3::new(-1.0, 0.5, 2.0), voxel_m: 0.5 }
    }

    /// A triangle given in voxels.
    fn corners(grid: &Grid, voxels: [[f64; 3]; 3]) -> Corners {
        voxels.map(|p| grid.origin_m + grid.voxel_m * DVec3::from(p))
    }

    fn occupied(gaps: &[f64]) -> usize {
        gaps.iter().filter(|gap| **gap < 0.0).count()
    }

    #[test]
    fn a_slanted_plane_fills_the_cubes_it_cuts() {
        let grid = grid([8, 8, 8]);
        // The plane x + y = 8.1, all through the grid.
        let far = 100.0;
        let at = |x: f64, z: f64| [x, 8.1 - x, z];
        let plane = [
            corners(&grid, [at(-far, -far), at(far, -far), at(-far, far)]),
            corners(&grid, [at(far, -far), at(far, far), at(-far, far)]),
        ];
        // Cubes with i + j < 8.1 < i + j + 2: of i + j = 7 there are 8, of i + j = 8 there are 7, eight layers of each.
        assert_eq!(occupied(&gaps(&plane, &grid)), 8 * (8 + 7));
    }

    #[test]
    fn triangles_smaller_than_a_voxel_and_without_area_fill_what_holds_them() {
        let grid = grid([4, 4, 4]);
        let small = corners(&grid, [[1.2, 2.3, 3.4], [1.3, 2.3, 3.4], [1.2, 2.4, 3.5]]);
        let found = gaps(&[small], &grid);
        assert_eq!(occupied(&found), 1);
        assert!(found[grid.index([1, 2, 3]) as usize] < 0.0);
        let needle = corners(&grid, [[0.5, 0.5, 0.5], [3.5, 0.5, 0.5], [2.0, 0.5, 0.5]]);
        assert_eq!(occupied(&gaps(&[needle], &grid)), 4);
        let outside = corners(&grid, [[9.0, 9.0, 9.0], [9.5, 9.0, 9.0], [9.0, 9.5, 9.0]]);
        assert_eq!(occupied(&gaps(&[outside], &grid)), 0);
    }

    #[test]
    fn a_cube_beside_a_corner_is_apart_though_their_boxes_meet() {
        let grid = grid([4, 4, 4]);
        let cut = corners(&grid, [[0.0, 2.4, 0.5], [2.4, 0.0, 0.5], [0.0, 0.0, 0.5]]);
        let found = gaps(&[cut], &grid);
        assert!(found[grid.index([2, 2, 0]) as usize] > 0.0);
        assert!(found[grid.index([1, 1, 0]) as usize] < 0.0);
        let gap = found[grid.index([1, 2, 0]) as usize];
        assert!((gap - 0.6 / 2f64.sqrt()).abs() < 1e-12, "{gap}");
    }

    #[test]
    fn samples_lie_in_voxels_that_the_surface_touches() {
        let grid = grid([16, 16, 16]);
        let slanted = corners(&grid, [[1.1, 2.2, 3.3], [14.7, 5.1, 9.9], [4.2, 13.3, 7.1]]);
        let touched = gaps(&[slanted], &grid);
        let sampled = sampled(&[slanted], &grid, &[0, 1, 2], 256);
        let found: Vec<bool> = sampled.iter().map(|s| *s == Cover::Surely).collect();
        let errors = errors(&found, &touched);
        assert!(found.iter().filter(|found| **found).count() > 50);
        assert_eq!(errors.false_positives, 0);
        let missed = errors.false_negatives as f64 / errors.occupied as f64;
        assert!(0.0 < missed && missed < 0.6, "{missed}");
        assert_eq!(disagreements(&found, &sampled), 0);
        let inverted: Vec<bool> = found.iter().map(|found| !found).collect();
        assert!(disagreements(&inverted, &sampled) > 1000);
    }
}
