//! Signed distances of simple solids, negative inside, and what is made of them.

use glam::{DVec2, DVec3};

/// A box about the origin.
pub fn cuboid(p: DVec3, half: DVec3) -> f64 {
    let q = p.abs() - half;
    q.max(DVec3::ZERO).length() + q.max_element().min(0.0)
}

/// A round bar about the origin, its axis along y.
pub fn cylinder(p: DVec3, radius: f64, half_height: f64) -> f64 {
    let q = DVec2::new(p.x.hypot(p.z) - radius, p.y.abs() - half_height);
    q.max(DVec2::ZERO).length() + q.max_element().min(0.0)
}

/// An ellipsoid about the origin, exact on its surface and near it.
pub fn ellipsoid(p: DVec3, radii: DVec3) -> f64 {
    let scaled = (p / radii).length();
    if scaled == 0.0 {
        return -radii.min_element();
    }
    scaled * (scaled - 1.0) / (p / (radii * radii)).length()
}

/// A limb between two points with a radius at each.
pub fn limb(p: DVec3, [start, end]: [DVec3; 2], [r0, r1]: [f64; 2]) -> f64 {
    let along = end - start;
    let t = ((p - start).dot(along) / along.length_squared()).clamp(0.0, 1.0);
    p.distance(start + along * t) - (r0 + (r1 - r0) * t)
}

/// What is in the first and not in the second.
pub fn without(solid: f64, hole: f64) -> f64 {
    solid.max(-hole)
}

/// Share of a solid at a signed distance from it, its border blurred over `width` as a scanner blurs it.
pub fn share(distance: f64, width: f64) -> f64 {
    let t = (0.5 - distance / width).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}
