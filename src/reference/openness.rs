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
