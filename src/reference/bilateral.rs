//! Joint bilateral filter and up-scaling of an ambient-occlusion buffer (VAO §6; Kopf et al., Joint Bilateral Upsampling,
//! 2007), twin of the GPU's.

use glam::DVec3;

use super::filter::{GOLDEN_ANGLE, from_edges};
use super::image::{Image, behind};
use super::plane::{CameraDepth, SurfacePlane};
use fathom_scene::Camera;

/// What the filter is told.
#[derive(Clone, Debug, PartialEq)]
pub struct Bilateral {
    pub taps: u32,
    /// Radius of the disc and standard deviation of its Gaussian, texels of the buffer that is filtered.
    pub radius_px: f64,
    pub sigma_px: f64,
    /// Standard deviation of a tap's distance from the pixel's tangent plane along the view, over the pixel's view depth.
    pub depth_sigma: f64,
    /// Standard deviation of the distance between the unit normals of a tap and of the pixel.
    pub normal_sigma: f64,
}

/// The filter over one pair of buffers.
pub struct Guided<'a> {
    filter: &'a Bilateral,
    /// 1 − A, at any size.
    visibility: &'a Image,
    seen: CameraDepth<'a>,
    /// Of any length, in rows at the size of the viewport.
    normals: &'a [DVec3],
    /// Metres that a pixel of the viewport spans at 1 m.
    pixel_tangent: f64,
}

/// The surface at a pixel: its plane in device depth, and how the disc lies on it.
struct Tilted {
    plane: SurfacePlane,
    view_m: f64,
    /// Unit direction of the steepest change of depth in the picture.
    uphill: [f64; 2],
    /// Cosine of the tilt.
    cosine: f64,
}

impl Bilateral {
    pub fn over<'a>(
        &'a self,
        visibility: &'a Image,
        (depth, normals): (&'a Image, &'a [DVec3]),
        camera: &'a Camera,
    ) -> Guided<'a> {
        let half = (camera.fov_y_deg.to_radians() / 2.0).tan();
        let pixel_tangent = 2.0 * half / f64::from(depth.height());
        let seen = CameraDepth { depth, camera };
        Guided { filter: self, visibility, seen, normals, pixel_tangent }
    }

    /// Tap i before it is laid on the surface, texels: a Vogel spiral from the middle to the rim.
    fn tap(&self, i: u32) -> [f64; 2] {
        let (sin, cos) = (f64::from(i) * GOLDEN_ANGLE).sin_cos();
        let share = f64::from(i) / f64::from(self.taps.max(2) - 1);
        let radius = self.radius_px * share.sqrt();
        [radius * cos, radius * sin]
    }
}

impl Guided<'_> {
    /// The filtered buffer, at the viewport's size.
    pub fn apply(&self) -> Image {
        Image::of(self.seen.depth.size(), |x, y| self.at(x, y))
    }

    /// Filtered visibility at a pixel of the viewport; 1 where nothing was drawn.
    pub fn at(&self, x: u32, y: u32) -> f64 {
        let Some(surface) = self.surface(x, y) else {
            return 1.0;
        };
        let middle = self.middle(x, y);
        let normal = self.normal([x, y].map(i64::from));
        let (mut sum, mut weights) = (0.0, 0.0);
        let (mut nearest, mut nearest_m) = (1.0, f64::INFINITY);
        for place in self.places(x, y, &surface) {
            let size = self.visibility.size().map(f64::from);
            let texel = [0, 1].map(|k| place[k].floor().clamp(0.0, size[k] - 1.0));
            let seen = behind(texel, self.visibility.size(), self.seen.depth.size());
            if self.seen.depth.clamped(seen[0], seen[1]) >= 1.0 {
                continue;
            }
            let off_m = self.seen.beyond_m(&surface.plane, seen).abs();
            let value = self.visibility.clamped(texel[0] as i64, texel[1] as i64);
            if off_m < nearest_m {
                (nearest, nearest_m) = (value, off_m);
            }
            let across = (texel[0] + 0.5 - middle[0]).hypot(texel[1] + 0.5 - middle[1])
                / self.filter.sigma_px;
            let along = off_m / (self.filter.depth_sigma * surface.view_m);
            let turned = self.normal(seen).distance(normal) / self.filter.normal_sigma;
            let weight = (-0.5 * (across * across + along * along + turned * turned)).exp();
            sum += weight * value;
            weights += weight;
        }
        if weights < 1e-4 { nearest } else { sum / weights }
    }

    fn normal(&self, [x, y]: [i64; 2]) -> DVec3 {
        self.normals[(y * i64::from(self.seen.depth.width()) + x) as usize].normalize()
    }

    /// Smallest distance of a tap of a pixel from a texel's edge, texels: where it is tiny, single precision may read the
    /// neighbour. Infinite where nothing was drawn.
    pub fn edge_distance(&self, x: u32, y: u32) -> f64 {
        let Some(surface) = self.surface(x, y) else {
            return f64::INFINITY;
        };
        // The first tap is the pixel's own place, which is exact.
        from_edges(self.places(x, y, &surface).skip(1))
    }

    fn middle(&self, x: u32, y: u32) -> [f64; 2] {
        let [x, y] = [x, y].map(|t| f64::from(t) + 0.5);
        let ([w, h], [of_w, of_h]) = (self.visibility.size(), self.seen.depth.size());
        [x * f64::from(w) / f64::from(of_w), y * f64::from(h) / f64::from(of_h)]
    }

    /// Where the taps fall, texels of the buffer that is filtered.
    fn places(&self, x: u32, y: u32, surface: &Tilted) -> impl Iterator<Item = [f64; 2]> {
        let middle = self.middle(x, y);
        let [ux, uy] = surface.uphill;
        let shrink = 1.0 - surface.cosine;
        (0..self.filter.taps).map(move |i| {
            let [dx, dy] = self.filter.tap(i);
            let along = shrink * (dx * ux + dy * uy);
            [middle[0] + dx - along * ux, middle[1] + dy - along * uy]
        })
    }

    fn surface(&self, x: u32, y: u32) -> Option<Tilted> {
        let plane = self.seen.plane([x, y].map(i64::from));
        if plane.z >= 1.0 {
            return None;
        }
        let CameraDepth { camera, .. } = self.seen;
        let view_m = self.seen.view_m(plane.z);
        // Chain rule: ∂(view depth)/∂(device depth) = view² (f − n) / (f n), over the pixel's width view · tangent.
        let (n, f) = (camera.z_near_m, camera.z_far_m);
        let tilt = plane.slope.map(|s| s * view_m * (f - n) / (f * n) / self.pixel_tangent);
        let steepness = tilt[0].hypot(tilt[1]);
        Some(Tilted {
            plane,
            view_m,
            uphill: tilt.map(|t| t / steepness.max(1e-6)),
            cosine: 1.0 / (1.0 + steepness * steepness).sqrt(),
        })
    }
}
