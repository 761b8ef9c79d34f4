//! Screen-space ambient occlusion of the composed picture (UW §3 step 7b), twin of the GPU's.

use std::f64::consts::TAU;

use glam::DVec3;

use super::filter::GOLDEN_ANGLE;
use super::image::Image;
use super::rays::PixelRays;
use fathom_scene::Camera;

/// Cosine to the normal below which a tap does not block.
const LEAST_COSINE: f64 = 0.1;

/// Taps over a disc of a radius at the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Openness {
    pub taps: u32,
    pub radius_m: f64,
}

impl Openness {
    /// Share of the sky that is open at a pixel whose surface has this normal; 1 where nothing is seen.
    pub fn at(&self, camera: &Camera, depth: &Image, normal: DVec3, x: u32, y: u32) -> f64 {
        let [width, height] = depth.size();
        let z = depth.clamped(x.into(), y.into());
        if z >= 1.0 || self.taps == 0 {
            return 1.0;
        }
        let rays = PixelRays::new(camera, width, height);
        let [column, row] = [x, y].map(|k| f64::from(k) + 0.5);
        let position = rays.unproject(column, row, z);
        let opening = 2.0 * (camera.fov_y_deg.to_radians() / 2.0).tan();
        let radius_px = self.radius_m * f64::from(height) / (opening * camera.view_depth_m(z));
        let blocked = (0..self.taps).map(|i| {
            let angle = f64::from(i) * GOLDEN_ANGLE + turn(x, y);
            let reach = radius_px * ((f64::from(i) + 0.5) / f64::from(self.taps)).sqrt();
            let texel = [column + reach * angle.cos(), row + reach * angle.sin()].map(f64::floor);
            if !depth.contains(texel[0] as i64, texel[1] as i64) {
                return 0.0;
            }
            let seen = depth.clamped(texel[0] as i64, texel[1] as i64);
            let tap = rays.unproject(texel[0] + 0.5, texel[1] + 0.5, seen) - position;
            let near = (1.0 - tap.length() / self.radius_m).clamp(0.0, 1.0);
            near * (tap.normalize_or_zero().dot(normal) - LEAST_COSINE).clamp(0.0, 1.0)
        });
        1.0 - blocked.sum::<f64>() / f64::from(self.taps)
    }
}

/// Interleaved gradient noise (Jimenez 2014) as an angle.
fn turn(x: u32, y: u32) -> f64 {
    let place = f64::from(x) * 0.067_110_56 + f64::from(y) * 0.005_837_15;
    TAU * (52.982_918_9 * place.fract()).fract()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::pixels;

    const SIZE: [u32; 2] = [64, 48];
    const METHOD: Openness = Openness { taps: 64, radius_m: 0.6 };

    /// Depth of what is nearest of planes through points with normals.
    fn seen(camera: &Camera, planes: &[(DVec3, DVec3)]) -> Image {
        let rays = PixelRays::new(camera, SIZE[0], SIZE[1]);
        Image::of(SIZE, |x, y| {
            let (origin, direction, length) = rays.ray(x, y);
            let hits = planes.iter().filter_map(|(point, normal)| {
                let t = (*point - origin).dot(*normal) / direction.dot(*normal);
                (t > 0.0 && t < length).then_some(t)
            });
            let t = hits.fold(f64::INFINITY, f64::min);
            if t.is_finite() {
                rays.project(origin + direction * t).map_or(1.0, |p| p.depth)
            } else {
                1.0
            }
        })
    }

    #[test]
    fn a_plane_is_open_and_a_corner_is_not() {
        let camera = Camera::new([0.0, 1.0, 3.0], [0.0, 0.3, 0.0], 50.0, [0.5, 20.0]);
        let floor = (DVec3::ZERO, DVec3::Y);
        let wall = (DVec3::ZERO, DVec3::Z);
        let plane = seen(&camera, &[floor]);
        let open = pixels(SIZE).map(|(x, y)| METHOD.at(&camera, &plane, DVec3::Y, x, y));
        assert!(open.clone().all(|value| (value - 1.0).abs() < 1e-12));
        let corner = seen(&camera, &[floor, wall]);
        let rays = PixelRays::new(&camera, SIZE[0], SIZE[1]);
        // On the floor, openness falls towards the wall.
        let on_floor = |from_wall: f64| {
            let at = rays.project(DVec3::new(0.0, 0.0, from_wall)).unwrap();
            METHOD.at(&camera, &corner, DVec3::Y, at.x_px as u32, at.y_px as u32)
        };
        assert!(on_floor(0.05) < on_floor(0.3) && on_floor(0.3) < on_floor(0.9));
        assert!(on_floor(0.05) < 0.95 && on_floor(0.9) > 0.999);
    }
}
