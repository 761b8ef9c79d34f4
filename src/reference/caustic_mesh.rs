//! A caustic mesh in f64: triangles of neighbouring photons, lit by the ratio of areas, drawn exactly.

use std::ops::Range;

use glam::DVec3;
use itertools::iproduct;

use super::image::Image;
use super::plane::CameraDepth;
use super::rays::PixelRays;
use fathom_scene::LightKind;

/// A photon that has landed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corner {
    pub entry: DVec3,
    pub hit: DVec3,
    /// Share of its energy that is left at the hit.
    pub left: f64,
}

/// A refracted triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lit {
    pub hits: [DVec3; 3],
    /// Shares that are left at the corners, linear between them.
    pub left: [f64; 3],
    /// W.
    pub flux_w: f64,
}

/// Where the light of a mesh comes from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Beam {
    pub kind: LightKind,
    pub position: DVec3,
    pub forward: DVec3,
    /// W/m² across a directional light, W/sr of a point light.
    pub strength: f64,
    /// Longest edge after refraction over the longest before.
    pub most_stretch: f64,
}

impl Lit {
    pub fn area_m2(&self) -> f64 {
        let [a, b, c] = self.hits;
        0.5 * (b - a).cross(c - a).length()
    }

    /// Flux that reaches the triangle: the mean of what is left over its area.
    pub fn landed_w(&self) -> f64 {
        self.flux_w * self.left.iter().sum::<f64>() / 3.0
    }

    /// Irradiance where a ray meets the triangle's plane, and the point; none beside the triangle.
    fn at(&self, origin: DVec3, direction: DVec3) -> Option<(f64, DVec3)> {
        let [a, b, c] = self.hits;
        let normal = (b - a).cross(c - a);
        let point = origin + direction * ((a - origin).dot(normal) / direction.dot(normal));
        let part = |from: DVec3, to: DVec3| (to - from).cross(point - from).dot(normal);
        let weights = [part(b, c), part(c, a), part(a, b)].map(|w| w / normal.length_squared());
        let inside = weights.iter().all(|w| *w >= 0.0);
        let left: f64 = weights.iter().zip(self.left).map(|(w, left)| w * left).sum();
        inside.then(|| (self.flux_w / self.area_m2() * left, point))
    }
}

impl Beam {
    /// Both triangles of each square of neighbours that have landed, over rows of `columns` photons.
    pub fn triangles(&self, photons: &[Option<Corner>], columns: usize) -> Vec<Lit> {
        let at = |x: usize, y: usize| photons[y * columns + x];
        let squares = iproduct!(0..columns - 1, 0..columns - 1);
        let both = squares.flat_map(|(y, x)| {
            let (right, up) = (at(x + 1, y), at(x, y + 1));
            [[at(x, y), right, up], [at(x + 1, y + 1), up, right]]
        });
        both.filter_map(|[a, b, c]| self.lit([a?, b?, c?])).collect()
    }

    fn lit(&self, corners: [Corner; 3]) -> Option<Lit> {
        let [entries, hits] = [corners.map(|c| c.entry), corners.map(|c| c.hit)];
        let lit = Lit { hits, left: corners.map(|c| c.left), flux_w: self.flux_w(entries) };
        let one_surface = longest(hits) <= self.most_stretch * longest(entries);
        (one_surface && lit.area_m2() > 0.0).then_some(lit)
    }

    /// Through a triangle that turns counter-clockwise as the light sees it; negative the other way.
    fn flux_w(&self, [a, b, c]: [DVec3; 3]) -> f64 {
        match self.kind {
            LightKind::Directional => {
                // Corners moved along the light into one plane across it.
                let flat = |p: DVec3| p - self.forward * p.dot(self.forward);
                let [a, b, c] = [flat(a), flat(b), flat(c)];
                -0.5 * self.strength * (b - a).cross(c - a).dot(self.forward)
            }
            LightKind::Point => {
                // Girard: a spherical triangle's area is the sum of its angles less π.
                let [a, b, c] = [a, b, c].map(|p| (p - self.position).normalize());
                let angle = |at: DVec3, p: DVec3, q: DVec3| at.cross(p).angle_between(at.cross(q));
                let sum = angle(a, b, c) + angle(b, c, a) + angle(c, a, b);
                -a.cross(b).dot(c).signum() * self.strength * (sum - std::f64::consts::PI)
            }
        }
    }
}

fn longest([a, b, c]: [DVec3; 3]) -> f64 {
    a.distance(b).max(b.distance(c)).max(c.distance(a))
}

/// Irradiance of the pixels whose surface lies within `bias_m` of a triangle along the view.
pub fn draw(size_px: [u32; 2], triangles: &[Lit], seen: &CameraDepth<'_>, bias_m: f64) -> Image {
    let [width, height] = size_px;
    let rays = PixelRays::new(seen.camera, width, height);
    let (eye, along) = (seen.camera.position(), seen.camera.direction());
    let mut image = Image::constant(width, height, 0.0);
    for triangle in triangles {
        for (x, y) in covered(size_px, &rays, triangle) {
            let (origin, direction, _) = rays.ray(x, y);
            let Some((irradiance, point)) = triangle.at(origin, direction) else { continue };
            let [column, row] = seen.texel([x.into(), y.into()], size_px);
            let off_m = seen.view_m(seen.depth.clamped(column, row)) - (point - eye).dot(along);
            if off_m.abs() <= bias_m {
                image.add(x.into(), y.into(), irradiance);
            }
        }
    }
    image
}

/// Pixels around the triangle; all where a corner lies behind the camera.
fn covered(
    [width, height]: [u32; 2],
    rays: &PixelRays,
    triangle: &Lit,
) -> impl Iterator<Item = (u32, u32)> + use<> {
    let corners: Option<Vec<_>> = triangle.hits.iter().map(|hit| rays.project(*hit)).collect();
    let [columns, rows] = match corners {
        Some(at) => [
            span([at[0].x_px, at[1].x_px, at[2].x_px], width),
            span([at[0].y_px, at[1].y_px, at[2].y_px], height),
        ],
        None => [0..width, 0..height],
    };
    iproduct!(rows, columns).map(|(y, x)| (x, y))
}

/// Whole pixels of a side that these places lie around.
fn span(places: [f64; 3], side: u32) -> Range<u32> {
    let low = places.into_iter().fold(f64::INFINITY, f64::min).floor().max(0.0);
    let high = places.into_iter().fold(0.0, f64::max).ceil().min(f64::from(side));
    low as u32..high as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    fn corner(x: f64, z: f64, magnified: f64) -> Option<Corner> {
        let entry = DVec3::new(x, 0.0, z);
        let hit = DVec3::new(x * magnified, -2.0, z * magnified);
        Some(Corner { entry, hit, left: 0.5 })
    }

    /// From straight above; the light's x runs along +x and its y along −z.
    fn beam(kind: LightKind) -> Beam {
        let (position, forward) = (DVec3::Y * 3.0, DVec3::NEG_Y);
        Beam { kind, position, forward, strength: 8.0, most_stretch: 4.0 }
    }

    fn square(magnified: f64) -> Vec<Option<Corner>> {
        let places = [(0.0, 0.0), (0.1, 0.0), (0.0, -0.1), (0.1, -0.1)];
        places.iter().map(|(x, z)| corner(*x, *z, magnified)).collect()
    }

    #[test]
    fn irradiance_is_the_light_s_over_the_magnified_area() {
        for magnified in [0.5, 1.0, 3.0] {
            let lit = beam(LightKind::Directional).triangles(&square(magnified), 2);
            assert_eq!(lit.len(), 2);
            for triangle in lit {
                let expected = 8.0 / (magnified * magnified);
                assert!((triangle.flux_w / triangle.area_m2() / expected - 1.0).abs() < 1e-9);
                assert!((triangle.landed_w() - 0.5 * 8.0 * 0.005).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn a_point_light_gives_intensity_times_solid_angle() {
        let lit = beam(LightKind::Point).triangles(&square(1.0), 2);
        let flux: f64 = lit.iter().map(|triangle| triangle.flux_w).sum();
        // A corner of a rectangle a × b at a distance d: atan(a b / (d √(a² + b² + d²))).
        let exact = (0.01f64 / (3.0 * (0.02f64 + 9.0).sqrt())).atan() * 8.0;
        assert!((flux / exact - 1.0).abs() < 1e-6, "{flux} {exact}");
    }

    #[test]
    fn corners_apart_or_missing_make_no_triangle_and_turned_ones_take_away() {
        let beam = beam(LightKind::Directional);
        assert!(beam.triangles(&square(5.0), 2).is_empty());
        let mut one_missing = square(1.0);
        one_missing[3] = None;
        assert_eq!(beam.triangles(&one_missing, 2).len(), 1);
        let mut mirrored = square(1.0);
        mirrored.swap(0, 1);
        mirrored.swap(2, 3);
        assert!(beam.triangles(&mirrored, 2).iter().all(|triangle| triangle.flux_w < 0.0));
    }
}
