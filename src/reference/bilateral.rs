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

#[cfg(test)]
mod tests {
    use super::super::filter::pcg;
    use super::super::rays::PixelRays;
    use super::*;
    use glam::DVec3;

    const SIZE: [u32; 2] = [48, 32];

    fn camera() -> Camera {
        Camera::new([0.0; 3], [0.0, 0.0, -1.0], 50.0, [0.1, 30.0])
    }

    fn filter() -> Bilateral {
        Bilateral { taps: 17, radius_px: 4.0, sigma_px: 2.0, depth_sigma: 0.005, normal_sigma: 0.3 }
    }

    /// Device depth of planes `normal · p = offset`, chosen by column.
    fn depth(plane: impl Fn(u32) -> Option<(DVec3, f64)>) -> Image {
        let rays = PixelRays::new(&camera(), SIZE[0], SIZE[1]);
        let at = |x, y| {
            let (_, direction, _) = rays.ray(x, y);
            plane(x).map_or(1.0, |(normal, offset)| {
                rays.project(direction * (offset / normal.dot(direction))).unwrap().depth
            })
        };
        Image::of(SIZE, at)
    }

    /// Normals that are the same everywhere.
    fn facing() -> Vec<DVec3> {
        vec![DVec3::Z; (SIZE[0] * SIZE[1]) as usize]
    }

    /// White from a column on.
    fn step(size: [u32; 2], column: u32) -> Image {
        Image::of(size, |x, _| f64::from(u32::from(x >= column)))
    }

    fn noise() -> Image {
        Image::of(SIZE, |x, y| f64::from(pcg(x + SIZE[0] * y)) / 4_294_967_296.0)
    }

    /// Floor that recedes at 55 degrees from the picture's plane.
    fn slanted(_: u32) -> Option<(DVec3, f64)> {
        let (sin, cos) = 55f64.to_radians().sin_cos();
        Some((DVec3::new(0.0, sin, cos), -3.0))
    }

    fn most_off(image: &Image, expected: &Image) -> f64 {
        let pairs = image.data().iter().zip(expected.data());
        pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    }

    fn mean_and_deviation(image: &Image) -> (f64, f64) {
        let count = image.data().len() as f64;
        let mean = image.sum() / count;
        let square: f64 = image.data().iter().map(|v| (v - mean).powi(2)).sum();
        (mean, (square / count).sqrt())
    }

    #[test]
    fn constants_steps_of_depth_and_background_stay_and_nothing_bleeds() {
        let slanted = depth(slanted);
        let wall = depth(|x| Some((DVec3::Z, if x < 20 { -2.0 } else { -2.2 })));
        let ends = depth(|x| (x < 20).then_some((DVec3::Z, -2.0)));
        let grey = |[width, height]: [u32; 2]| Image::constant(width, height, 0.25);
        let open = step(SIZE, 20).map(|open| 0.25 + 0.75 * open);
        let none = Bilateral { radius_px: 0.0, ..filter() };
        let cases = [
            ("a constant", filter(), grey(SIZE), &slanted, grey(SIZE), 1e-12),
            ("a smaller one", filter(), grey([24, 16]), &slanted, grey(SIZE), 1e-12),
            ("at no whole scale", filter(), grey([13, 7]), &slanted, grey(SIZE), 1e-12),
            ("a step of depth", filter(), step(SIZE, 20), &wall, step(SIZE, 20), 1e-6),
            ("a smaller step", filter(), step([24, 16], 10), &wall, step(SIZE, 20), 1e-6),
            ("a disc of no radius", none, noise(), &slanted, noise(), 1e-12),
            ("background is open and gives nothing", filter(), grey(SIZE), &ends, open, 1e-12),
        ];
        for (name, filter, input, depth, expected, most) in cases {
            let filtered = filter.over(&input, (depth, &facing()), &camera()).apply();
            assert!(most_off(&filtered, &expected) < most, "{name}");
        }
    }

    #[test]
    fn nothing_bleeds_around_an_edge_without_a_step() {
        // One depth, two normals: as where a wall meets a floor in the picture.
        let depth = depth(|_| Some((DVec3::Z, -2.0)));
        let input = step(SIZE, 20);
        let side = |i: u32| if i % SIZE[0] < 20 { DVec3::X } else { DVec3::Y };
        let normals: Vec<DVec3> = (0..SIZE[0] * SIZE[1]).map(side).collect();
        let off = |normal_sigma: f64| {
            let filter = Bilateral { normal_sigma, ..filter() };
            most_off(&filter.over(&input, (&depth, &normals), &camera()).apply(), &input)
        };
        assert!(off(0.3) < 1e-3, "{}", off(0.3));
        assert!(off(1e3) > 0.3, "{}", off(1e3));
    }

    #[test]
    fn noise_falls_on_facing_and_on_slanted_surfaces() {
        let input = noise();
        let before = mean_and_deviation(&input);
        for (plane, at_most) in [(depth(|_| Some((DVec3::Z, -2.0))), 0.35), (depth(slanted), 0.6)] {
            let after =
                mean_and_deviation(&filter().over(&input, (&plane, &facing()), &camera()).apply());
            assert!((after.0 / before.0 - 1.0).abs() < 0.02);
            assert!(after.1 < at_most * before.1, "{} of {}", after.1, before.1);
        }
    }
}
