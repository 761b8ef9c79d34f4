//! The toolkit of the generators: closed shapes, outward normals, counter-clockwise triangles.
//! Unless said otherwise a shape stands on y = 0 with its axis on the y axis.

use std::f64::consts::{PI, TAU};
use std::ops::{Add, Mul, Sub};

use glam::{DMat4, DQuat, DVec2, DVec3};
use itertools::iproduct;

use super::mesh::Mesh;

/// A parametric surface over u, v ∈ [0, 1] of `columns` × `rows` quads, its normal along ∂u × ∂v.
/// A wrapped direction joins its end to its start.
pub fn surface(
    (columns, rows): (usize, usize),
    (wrap_u, wrap_v): (bool, bool),
    point: impl Fn(f64, f64) -> DVec3,
) -> Mesh {
    let (nu, nv) = (columns + usize::from(!wrap_u), rows + usize::from(!wrap_v));
    let mut mesh = Mesh::default();
    for (j, i) in iproduct!(0..nv, 0..nu) {
        let p = point(i as f64 / columns as f64, j as f64 / rows as f64);
        mesh.positions.push(p.as_vec3().to_array());
    }
    let at = |i: usize, j: usize| (j % nv * nu + i % nu) as u32;
    for (j, i) in iproduct!(0..rows, 0..columns) {
        let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
        push_triangle(&mut mesh, [a, b, c]);
        push_triangle(&mut mesh, [a, c, d]);
    }
    mesh.recompute_normals();
    mesh
}

/// A [`surface`] without a wrapped direction.
pub fn sheet(quads: (usize, usize), point: impl Fn(f64, f64) -> DVec3) -> Mesh {
    surface(quads, (false, false), point)
}

/// Adds a triangle unless two of its corners fall together.
fn push_triangle(mesh: &mut Mesh, corners: [u32; 3]) {
    let [a, b, c] = corners.map(|i| mesh.positions[i as usize]);
    if a != b && b != c && c != a {
        mesh.indices.extend(corners);
    }
}

/// A flat quad a, b, c, d, counter-clockwise.
pub fn quad(corners: [DVec3; 4]) -> Mesh {
    let [a, b, c, d] = corners;
    sheet((1, 1), |u, v| a.lerp(b, u).lerp(d.lerp(c, u), v))
}

/// A box between two corners.
pub fn cuboid(min: impl Into<DVec3>, max: impl Into<DVec3>) -> Mesh {
    let ends = [min.into(), max.into()];
    let p = |x: usize, y: usize, z: usize| DVec3::new(ends[x].x, ends[y].y, ends[z].z);
    let faces = [
        [p(1, 0, 1), p(1, 0, 0), p(1, 1, 0), p(1, 1, 1)],
        [p(0, 0, 0), p(0, 0, 1), p(0, 1, 1), p(0, 1, 0)],
        [p(0, 1, 1), p(1, 1, 1), p(1, 1, 0), p(0, 1, 0)],
        [p(0, 0, 0), p(1, 0, 0), p(1, 0, 1), p(0, 0, 1)],
        [p(0, 0, 1), p(1, 0, 1), p(1, 1, 1), p(0, 1, 1)],
        [p(1, 0, 0), p(0, 0, 0), p(0, 1, 0), p(1, 1, 0)],
    ];
    merged(faces.map(quad))
}

/// A box standing on y = 0, centred on the axis.
pub fn block(width: f64, height: f64, depth: f64) -> Mesh {
    cuboid([-0.5 * width, 0.0, -0.5 * depth], [0.5 * width, height, 0.5 * depth])
}

/// A profile of (radius, y) points, bottom to top, turned about y. A point given twice makes a crease.
pub fn lathe(profile: &[(f64, f64)], segments: usize) -> Mesh {
    turned(profile, segments, |_, _| 1.0)
}

/// A lathe of a smooth profile through `knots`, closed below and above with sharp edges.
pub fn smooth_solid(knots: &[(f64, f64)], steps: usize, segments: usize) -> Mesh {
    let (low, high) = (knots[0], knots[knots.len() - 1]);
    let profile = smooth_profile(knots, steps);
    lathe(&[&[(0.0, low.1), low][..], &profile, &[high, (0.0, high.1)]].concat(), segments)
}

/// A lathe whose radius is multiplied by `swell(angle, y)`.
pub fn turned(profile: &[(f64, f64)], segments: usize, swell: impl Fn(f64, f64) -> f64) -> Mesh {
    let rows = profile.len() - 1;
    surface((segments, rows), (true, false), |u, v| {
        let (radius, y) = profile[(v * rows as f64).round() as usize];
        let r = radius * swell(TAU * u, y);
        let (sin, cos) = (-TAU * u).sin_cos();
        DVec3::new(r * cos, y, r * sin)
    })
}

/// A smooth profile through `knots` (Catmull–Rom), with `steps` points between two of them.
pub fn smooth_profile(knots: &[(f64, f64)], steps: usize) -> Vec<(f64, f64)> {
    let knots: Vec<DVec2> = knots.iter().map(|&(r, y)| DVec2::new(r, y)).collect();
    smooth_path(&knots, steps).into_iter().map(|p| (p.x.max(0.0), p.y)).collect()
}

/// A path through `knots` (Catmull–Rom), with `steps` points between two of them.
pub fn smooth_path<V>(knots: &[V], steps: usize) -> Vec<V>
where
    V: Copy + Add<Output = V> + Sub<Output = V> + Mul<f64, Output = V>,
{
    let last = knots.len() - 1;
    let tangent = |i: usize| (knots[(i + 1).min(last)] - knots[i.saturating_sub(1)]) * 0.5;
    let mut points = Vec::with_capacity(last * steps + 1);
    for i in 0..last {
        for s in 0..steps {
            let t = s as f64 / steps as f64;
            let (t2, t3) = (t * t, t * t * t);
            points.push(
                knots[i] * (2.0 * t3 - 3.0 * t2 + 1.0)
                    + tangent(i) * (t3 - 2.0 * t2 + t)
                    + knots[i + 1] * (3.0 * t2 - 2.0 * t3)
                    + tangent(i + 1) * (t3 - t2),
            );
        }
    }
    points.push(knots[last]);
    points
}

/// A cylinder with caps.
pub fn cylinder(radius: f64, height: f64, segments: usize) -> Mesh {
    let (r, h) = (radius, height);
    lathe(&[(0.0, 0.0), (r, 0.0), (r, 0.0), (r, h), (r, h), (0.0, h)], segments)
}

/// A sphere about the origin with `rows` rings and twice as many segments.
pub fn sphere(radius: f64, rows: usize) -> Mesh {
    displaced_sphere(rows, |d| d * radius)
}

/// A sphere whose points are moved: `place` takes a unit direction to a point.
pub fn displaced_sphere(rows: usize, place: impl Fn(DVec3) -> DVec3) -> Mesh {
    surface((2 * rows, rows), (true, false), |u, v| {
        let (sin_v, cos_v) = (PI * v).sin_cos();
        let (sin_u, cos_u) = (-TAU * u).sin_cos();
        // Exact poles, so that their slivers fall together and are left out.
        let ring = if v == 0.0 || v == 1.0 { 0.0 } else { sin_v };
        place(DVec3::new(ring * cos_u, -cos_v, ring * sin_u))
    })
}

/// A ring of the given radius in the plane y = 0, its tube `tube` thick in radius.
pub fn torus(radius: f64, tube: f64, segments: usize, sides: usize) -> Mesh {
    surface((segments, sides), (true, true), |u, v| {
        let (sin_u, cos_u) = (-TAU * u).sin_cos();
        let (sin_v, cos_v) = (TAU * v).sin_cos();
        let r = radius + tube * cos_v;
        DVec3::new(r * cos_u, tube * sin_v, r * sin_u)
    })
}

/// A round tube along a path, with its own radius at each point; its ends are closed unless the
/// path is `closed`, when the last point joins the first.
pub fn tube(path: &[DVec3], radii: &[f64], sides: usize, closed: bool) -> Mesh {
    let n = path.len();
    let frames = parallel_frames(path, closed);
    let rows = if closed { n } else { n + 1 };
    surface((sides, rows), (true, closed), |u, v| {
        let row = (v * rows as f64).round() as usize;
        // An open tube starts and ends with a row drawn together to the path itself.
        let (i, radius) = match (closed, row) {
            (true, row) => (row % n, radii[row % n]),
            (false, 0) => (0, 0.0),
            (false, row) if row > n => (n - 1, 0.0),
            (false, row) => (row - 1, radii[row - 1]),
        };
        let (side, up) = frames[i];
        let (sin, cos) = (TAU * u).sin_cos();
        path[i] + radius * (cos * side + sin * up)
    })
}

/// Two unit vectors across the path at each point, turned as little as possible along it.
fn parallel_frames(path: &[DVec3], closed: bool) -> Vec<(DVec3, DVec3)> {
    let n = path.len();
    let tangent = |i: usize| {
        let (before, after) = if closed {
            (path[(i + n - 1) % n], path[(i + 1) % n])
        } else {
            (path[i.saturating_sub(1)], path[(i + 1).min(n - 1)])
        };
        (after - before).normalize_or(DVec3::Y)
    };
    let mut side = tangent(0).any_orthonormal_vector();
    let mut frames: Vec<(DVec3, DVec3)> = Vec::with_capacity(n);
    for i in 0..n {
        let t = tangent(i);
        side = side.reject_from(t).normalize_or(t.any_orthonormal_vector());
        frames.push((side, t.cross(side)));
    }
    if closed {
        untwist(&mut frames, tangent(0));
    }
    frames
}

/// Spreads the turn between a closed path's last and first frames over all of them.
fn untwist(frames: &mut [(DVec3, DVec3)], axis: DVec3) {
    let n = frames.len() as f64;
    let (first, last) = (frames[0], frames[frames.len() - 1]);
    let side = last.0.reject_from(axis).normalize_or(first.0);
    let angle = first.0.dot(axis.cross(side)).atan2(first.0.dot(side));
    for (i, (side, up)) in frames.iter_mut().enumerate() {
        let (sin, cos) = (angle * i as f64 / n).sin_cos();
        (*side, *up) = (cos * *side + sin * *up, cos * *up - sin * *side);
    }
}

pub fn moved(mesh: Mesh, x: f64, y: f64, z: f64) -> Mesh {
    mesh.transformed(&DMat4::from_translation(DVec3::new(x, y, z)))
}

/// Four of these, at (±x, ±z).
pub fn at_corners(mesh: &Mesh, x: f64, z: f64) -> Mesh {
    let corners = [(-x, -z), (x, -z), (x, z), (-x, z)];
    merged(corners.map(|(x, z)| moved(mesh.clone(), x, 0.0, z)))
}

/// The mesh moved up or down until it touches y = 0.
pub fn grounded(mesh: Mesh) -> Mesh {
    let lowest = mesh.bounds().min.y;
    moved(mesh, 0.0, -lowest, 0.0)
}

pub fn scaled(mesh: Mesh, factor: f64) -> Mesh {
    mesh.transformed(&DMat4::from_scale(DVec3::splat(factor)))
}

/// A bar of square section between two points.
pub fn bar(from: impl Into<DVec3>, to: impl Into<DVec3>, thickness: f64) -> Mesh {
    let from = from.into();
    let along = to.into() - from;
    let rotation = DQuat::from_rotation_arc(DVec3::Y, along.normalize_or(DVec3::Y));
    block(thickness, along.length(), thickness)
        .transformed(&DMat4::from_rotation_translation(rotation, from))
}

pub fn merged(meshes: impl IntoIterator<Item = Mesh>) -> Mesh {
    let mut all = Mesh::default();
    for mesh in meshes {
        all.append(&mesh);
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(a: f64, b: f64) -> bool {
        (a - b).abs() < 0.03 * b
    }

    #[test]
    fn closed_shapes_face_outward_and_have_their_volume() {
        let v = |mesh: Mesh| {
            mesh.validate().expect("valid");
            mesh.volume()
        };
        assert!(close(v(block(2.0, 3.0, 4.0)), 24.0));
        assert!(close(v(sphere(1.5, 40)), 4.0 / 3.0 * PI * 1.5f64.powi(3)));
        assert!(close(v(cylinder(0.5, 2.0, 64)), PI * 0.25 * 2.0));
        assert!(close(v(torus(2.0, 0.5, 64, 32)), 2.0 * PI * PI * 2.0 * 0.25));
        let path = [DVec3::ZERO, DVec3::Z, DVec3::Z * 2.0];
        assert!(close(v(tube(&path, &[0.3; 3], 48, false)), PI * 0.09 * 2.0));
        let ring: [DVec3; 64] = std::array::from_fn(|i| {
            let angle = TAU * i as f64 / 64.0;
            DVec3::new(2.0 * angle.cos(), 2.0 * angle.sin(), 0.3 * (2.0 * angle).sin())
        });
        assert!(v(tube(&ring, &[0.5; 64], 32, true)) > 0.9 * 2.0 * PI * PI * 2.0 * 0.25);
    }

    #[test]
    fn smooth_curves_pass_their_knots() {
        let knots = [(0.0, 0.0), (1.0, 0.5), (0.4, 2.0)];
        let profile = smooth_profile(&knots, 4);
        assert_eq!(profile.len(), 9);
        assert_eq!((profile[0], profile[4], profile[8]), (knots[0], knots[1], knots[2]));
    }
}
