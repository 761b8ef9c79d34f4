//! Polygons of mesh files, cut into triangles.

use earcut::Earcut;
use glam::{DVec3, Vec3};
use itertools::Itertools;

/// A triangle that lies outside by less than this share of the polygon's area may do so by rounding: three corners stand in a line.
const ROUNDING: f64 = 1e-6;

/// Rotates the corners of a polygon, so that they begin at the same one wherever its file begins: the smallest of all rotations.
/// Triangles stay as they are.
pub fn rotate_to_first<T: Ord>(corners: &mut [T]) {
    let rotated = |first: &usize| corners[*first..].iter().chain(&corners[..*first]);
    let first = (0..corners.len()).min_by(|a, b| rotated(a).cmp(rotated(b)));
    if let Some(first) = first.filter(|_| corners.len() > 3) {
        corners.rotate_left(first);
    }
}

/// The indices of triangles of polygons that have so many of these corners each; without `counts` all are triangles.
pub fn triangles(positions: &[[f32; 3]], corners: Vec<u32>, counts: &[u32]) -> Vec<u32> {
    if counts.is_empty() {
        return corners;
    }
    let mut indices = Vec::with_capacity(corners.len());
    let mut rest = &corners[..];
    for count in counts {
        let (face, others) = rest.split_at(*count as usize);
        rest = others;
        cut(positions, face, &mut indices);
    }
    indices
}

/// Adds the triangles of one polygon: a fan where none of its triangles lies outside, as in all convex ones, else cut in its plane. One
/// without area becomes a fan.
fn cut(positions: &[[f32; 3]], face: &[u32], indices: &mut Vec<u32>) {
    let at = |corner: &u32| Vec3::from(positions[*corner as usize]).as_dvec3();
    let local: Vec<DVec3> = face.iter().map(|corner| at(corner) - at(&face[0])).collect();
    // Newell's normal.
    let normal: DVec3 = local.iter().circular_tuple_windows().map(|(a, b)| a.cross(*b)).sum();
    let is_outside =
        |(a, b): (&DVec3, &DVec3)| a.cross(*b).dot(normal) < -ROUNDING * normal.length_squared();
    let mut cut: Vec<u32> = Vec::new();
    let is_fan = !local.iter().tuple_windows().any(is_outside);
    if let Some(normal) = normal.try_normalize().filter(|_| !is_fan) {
        let (u, v) = normal.any_orthonormal_pair();
        let plane = local.iter().map(|point| [point.dot(u), point.dot(v)]);
        Earcut::new().earcut(plane, &[], &mut cut);
    }
    if cut.is_empty() {
        cut.extend((2..face.len() as u32).flat_map(|last| [0, last - 1, last]));
    }
    indices.extend(cut.iter().map(|corner| face[*corner as usize]));
}
