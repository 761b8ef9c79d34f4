//! The part of a box that a camera sees.

use glam::{DMat4, DVec2, DVec3, DVec4};

use super::{bounds::Bounds, camera::Camera};

/// Corner indices of the six faces of a [`Bounds`].
const BOX_FACES: [[usize; 4]; 6] =
    [[0, 2, 6, 4], [1, 3, 7, 5], [0, 1, 5, 4], [2, 3, 7, 6], [0, 1, 3, 2], [4, 5, 7, 6]];

/// Corner indices of the six faces of [`Camera::frustum_corners`].
const FRUSTUM_FACES: [[usize; 4]; 6] =
    [[0, 1, 2, 3], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]];

/// The corners of the camera frustum's intersection with `bounds` (some repeated); none if they do
/// not meet. Each lies on a face of one solid cut by the planes of the other.
pub fn visible_points(camera: &Camera, aspect: f64, bounds: &Bounds) -> Vec<DVec3> {
    let corners = camera.frustum_corners(aspect);
    let frustum_planes = frustum_planes(&camera.view_projection(aspect));
    let box_planes = planes(bounds);
    let frustum_faces = FRUSTUM_FACES
        .iter()
        .map(|face| clip_polygon(face.map(|i| corners[i]).to_vec(), &box_planes));
    frustum_faces.flatten().chain(surface_within(bounds, &frustum_planes)).collect()
}

/// The corners of what is left of a box's faces inside all planes (n, d), n·p + d ≥ 0 (some repeated).
pub fn surface_within(bounds: &Bounds, planes: &[DVec4]) -> Vec<DVec3> {
    let corners = bounds.corners();
    let faces =
        BOX_FACES.iter().map(|face| clip_polygon(face.map(|i| corners[i]).to_vec(), planes));
    faces.flatten().collect()
}

/// The six planes (n, d) of what a view-projection matrix shows, with n·p + d ≥ 0 inside: those of the four sides first.
pub fn frustum_planes(m: &DMat4) -> [DVec4; 6] {
    let (x, y, z, w) = (m.row(0), m.row(1), m.row(2), m.row(3));
    [w + x, w - x, w + y, w - y, z, w - z]
}

/// The planes (n, d) of a box with n·p + d ≥ 0 inside.
pub fn planes(bounds: &Bounds) -> [DVec4; 6] {
    std::array::from_fn(|i| {
        let axis = DVec3::AXES[i / 2];
        match i % 2 {
            0 => axis.extend(-bounds.min.dot(axis)),
            _ => (-axis).extend(bounds.max.dot(axis)),
        }
    })
}

/// What is left of a convex polygon inside all planes (Sutherland and Hodgman).
pub fn clip_polygon(polygon: Vec<DVec3>, planes: &[DVec4]) -> Vec<DVec3> {
    planes.iter().fold(polygon, |polygon, plane| {
        let height = |p: DVec3| plane.dot(p.extend(1.0));
        let mut clipped = Vec::with_capacity(polygon.len() + 1);
        for (i, &a) in polygon.iter().enumerate() {
            let b = polygon[(i + 1) % polygon.len()];
            let (ha, hb) = (height(a), height(b));
            if ha >= 0.0 {
                clipped.push(a);
            }
            if (ha >= 0.0) != (hb >= 0.0) {
                clipped.push(a.lerp(b, ha / (ha - hb)));
            }
        }
        clipped
    })
}

/// A rectangle across a light's axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rectangle {
    pub min: DVec2,
    pub max: DVec2,
}

impl Rectangle {
    /// Centred on the axis.
    pub fn square(half: f64) -> Rectangle {
        Rectangle { min: DVec2::splat(-half), max: DVec2::splat(half) }
    }

    pub fn from_points(points: impl IntoIterator<Item = DVec2>) -> Rectangle {
        let empty = Rectangle { min: DVec2::INFINITY, max: DVec2::NEG_INFINITY };
        points.into_iter().fold(empty, |r, p| Rectangle { min: r.min.min(p), max: r.max.max(p) })
    }

    /// The part of this rectangle inside `other`; `other` itself if that part has no area.
    pub fn intersection(&self, other: &Rectangle) -> Rectangle {
        let cut = Rectangle { min: self.min.max(other.min), max: self.max.min(other.max) };
        if cut.max.cmpgt(cut.min).all() { cut } else { *other }
    }

    pub fn area(&self) -> f64 {
        let size = self.max - self.min;
        size.x * size.y
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Camera {
        Camera::new([0.3, 0.2, 4.0], [0.0; 3], 50.0, [0.5, 9.0])
    }

    #[test]
    fn the_smaller_of_box_and_frustum_is_seen_whole_and_nothing_behind_the_camera() {
        let around = |half: f64| Bounds { min: DVec3::splat(-half), max: DVec3::splat(half) };
        let frustum = Bounds::from_points(camera().frustum_corners(1.3));
        for (bounds, whole, off) in
            [(around(0.5), around(0.5), 1e-9), (around(50.0), frustum, 1e-6)]
        {
            let seen = Bounds::from_points(visible_points(&camera(), 1.3, &bounds));
            assert!((seen.min - whole.min).length() < off);
            assert!((seen.max - whole.max).length() < off);
        }
        let behind = Bounds { min: DVec3::new(-1.0, -1.0, 6.0), max: DVec3::new(1.0, 1.0, 8.0) };
        assert!(visible_points(&camera(), 1.0, &behind).is_empty());
    }
}
