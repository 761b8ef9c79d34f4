//! Polygons of mesh files, cut into triangles.

use std::cmp::Ordering;

use earcut::Earcut;
use glam::{DVec3, Vec3};
use itertools::Itertools;

/// Polygons of more corners are never fans.
const MAX_FAN_CORNERS: usize = 8;

/// The smallest triangle of a fan has at least this share of the polygon's area: the length of a sliver without area costs as much as
/// that of any triangle.
const MIN_FAN_SHARE: f64 = 1e-6;

/// Rotates the corners of a polygon, so that they begin at the same one wherever its file begins: the smallest of all rotations.
/// Triangles stay as they are.
pub fn rotate_to_first<T: Ord>(corners: &mut [T]) {
    let count = corners.len();
    if count <= 3 {
        return;
    }
    // Of two candidates that agree in `same` corners and then differ, the larger goes, and with it those that begin within what agreed.
    let (mut a, mut b, mut same) = (0, 1, 0);
    while a.max(b) < count && same < count {
        match corners[(a + same) % count].cmp(&corners[(b + same) % count]) {
            Ordering::Equal => {
                same += 1;
                continue;
            }
            Ordering::Greater => a += same + 1,
            Ordering::Less => b += same + 1,
        }
        b += usize::from(a == b);
        same = 0;
    }
    corners.rotate_left(a.min(b));
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
        if *count == 3 {
            indices.extend(face);
        } else {
            cut(positions, face, &mut indices);
        }
    }
    indices
}

/// Adds the triangles of one polygon: of all fans that whose smallest triangle is largest, or where some triangle of each lies outside or
/// has no area the polygon cut in its plane.
fn cut(positions: &[[f32; 3]], face: &[u32], indices: &mut Vec<u32>) {
    let count = face.len();
    let at = |corner: &u32| Vec3::from(positions[*corner as usize]).as_dvec3();
    let local: Vec<DVec3> = face.iter().map(|corner| at(corner) - at(&face[0])).collect();
    // Newell's normal.
    let normal: DVec3 = local.iter().circular_tuple_windows().map(|(a, b)| a.cross(*b)).sum();
    let fan = |first: usize| (2..count).map(move |n| [0, n - 1, n].map(|n| (first + n) % count));
    let smallest = |first: &usize| {
        let areas = fan(*first).map(|triangle| {
            let [a, b, c] = triangle.map(|corner| local[corner]);
            (b - a).cross(c - a).dot(normal)
        });
        areas.fold(f64::INFINITY, f64::min)
    };
    let firsts = (0..count.min(MAX_FAN_CORNERS)).rev();
    let first = firsts.max_by(|a, b| smallest(a).total_cmp(&smallest(b))).unwrap_or(0);
    let is_fan =
        count <= MAX_FAN_CORNERS && smallest(&first) >= MIN_FAN_SHARE * normal.length_squared();
    let mut cut: Vec<u32> = Vec::new();
    if let Some(normal) = normal.try_normalize().filter(|_| !is_fan) {
        let (u, v) = normal.any_orthonormal_pair();
        let plane = local.iter().map(|point| [point.dot(u), point.dot(v)]);
        Earcut::new().earcut(plane, &[], &mut cut);
    }
    if cut.is_empty() {
        cut.extend(fan(first).flatten().map(|corner| corner as u32));
    }
    indices.extend(cut.iter().map(|corner| face[*corner as usize]));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corners_begin_at_the_smallest_of_all_rotations() {
        for corners in (4..8).flat_map(|count| (0..count).map(|_| 0..3).multi_cartesian_product()) {
            let rotations =
                (0..corners.len()).map(|first| [&corners[first..], &corners[..first]].concat());
            let smallest = rotations.min().unwrap();
            let mut rotated = corners;
            rotate_to_first(&mut rotated);
            assert_eq!(rotated, smallest);
        }
    }
}
