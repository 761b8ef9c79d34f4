//! Photon splats: regulated point size, intensity, and a rasterizer twin in f64 (UW §3.3).

use itertools::iproduct;

use super::image::Image;
use super::optics::transmittance;
use super::plane::CameraDepth;

/// Point size in pixels as a function of the distance from the viewer, `s = a + b / d` (UW §3.3):
/// `s_max` at the near plane and `s_min` at the far plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointSize {
    a_px: f64,
    b_px_m: f64,
}

impl PointSize {
    pub fn new(min_px: f64, max_px: f64, near_m: f64, far_m: f64) -> PointSize {
        let slope = (max_px - min_px) / (far_m - near_m);
        PointSize { a_px: max_px - far_m * slope, b_px_m: near_m * far_m * slope }
    }

    /// Side of the splat in pixels at a distance from the viewer in metres.
    pub fn at(&self, distance_m: f64) -> f64 {
        self.a_px + self.b_px_m / distance_m
    }
}

/// How the intensity of a splat depends on its size.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Intensity {
    /// The paper's rule: every pixel of a splat gets the photon's whole intensity.
    Paper,
    /// The intensity is divided by the splat's area, so that a photon keeps its energy.
    Conserving,
}

/// Value that a splat adds to each pixel it covers: `I · exp(−γ d_surface)` (UW §3.3), divided by
/// the area in pixels where energy is conserved.
pub fn splat_value(
    rule: Intensity,
    photon: f64,
    gamma_per_m: f64,
    surface_distance_m: f64,
    size_px: f64,
) -> f64 {
    let intensity = photon * transmittance(gamma_per_m, surface_distance_m);
    match rule {
        Intensity::Paper => intensity,
        Intensity::Conserving => intensity / (size_px * size_px),
    }
}

/// A square of one value, parallel to the image, at one depth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Splat {
    /// Centre in pixels, row 0 on top.
    pub center_px: [f64; 2],
    /// 0 near … 1 far.
    pub depth: f64,
    pub size_px: f64,
    pub value: f64,
}

/// Adds splats to an image, as a rasterizer does: a pixel is covered if its centre lies in the
/// half-open square (top-left rule), and drawn if the splat is not behind the depth stored there by
/// more than `bias`. `depth` may have another resolution; it is read at the nearest texel.
pub fn rasterize(target: &mut Image, splats: &[Splat], depth: &Image, bias: f64) {
    let size = target.size();
    for splat in splats {
        splat.draw(target, |at| {
            let [u, v] = [0, 1].map(|k| (at[k] as f64 + 0.5) / f64::from(size[k]));
            splat.depth <= depth.nearest(u, v) + bias
        });
    }
}

impl Splat {
    /// Adds its value to the covered pixels where it is seen.
    fn draw(&self, target: &mut Image, is_seen: impl Fn([i64; 2]) -> bool) {
        let [columns, rows] =
            [0, 1].map(|k| covered(self.center_px[k], self.size_px, target.size()[k]));
        for (y, x) in iproduct!(rows, columns).filter(|(y, x)| is_seen([*x, *y])) {
            target.add(x, y, self.value);
        }
    }
}

/// A splat in the plane of its photon's surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceSplat {
    /// Its depth is nearer than the photon's by the bias.
    pub splat: Splat,
    /// Device depth of the photon.
    pub photon_depth: f64,
    /// Change of device depth of its surface per pixel of the image, to the right and downwards.
    pub slope: [f64; 2],
}

/// Adds splats to an image where their own surface is seen: a pixel is drawn if the biased splat is not behind it, and if it is
/// no more than `reach_m` behind the splat's plane along the view.
pub fn rasterize_within_surfaces(
    target: &mut Image,
    splats: &[SurfaceSplat],
    seen: &CameraDepth<'_>,
    reach_m: f64,
) {
    let size = target.size();
    for SurfaceSplat { splat, photon_depth, slope } in splats {
        splat.draw(target, |at| {
            let rise = [0, 1].map(|k| slope[k] * (at[k] as f64 + 0.5 - splat.center_px[k]));
            let rise = rise[0] + rise[1];
            let [column, row] = seen.texel(at, size);
            let z = seen.depth.clamped(column, row);
            let behind_m = seen.view_m(z) - seen.view_m(photon_depth + rise);
            splat.depth + rise <= z && behind_m <= reach_m
        });
    }
}

/// Pixels of a row whose centres lie in [centre − size/2, centre + size/2), cut to the image.
fn covered(center: f64, size: f64, count: u32) -> std::ops::Range<i64> {
    let first = (center - 0.5 * size - 0.5).ceil().max(0.0) as i64;
    let end = (center + 0.5 * size - 0.5).ceil().min(f64::from(count)) as i64;
    first..end
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn sizes_at_both_planes_are_the_limits() {
        let size = PointSize::new(5.0, 20.0, 0.1, 60.0);
        assert!((size.at(0.1) - 20.0).abs() < 1e-12);
        assert!((size.at(60.0) - 5.0).abs() < 1e-12);
    }

    #[test]
    fn the_top_left_rule_assigns_each_pixel_once() {
        let far = Image::constant(8, 8, 1.0);
        let mut image = Image::constant(8, 8, 0.0);
        let tile = |x, y| Splat { center_px: [x, y], depth: 0.5, size_px: 4.0, value: 1.0 };
        // Edges run through pixel centres, where two squares meet.
        let tiles = [tile(2.5, 2.5), tile(6.5, 2.5), tile(2.5, 6.5), tile(6.5, 6.5)];
        rasterize(&mut image, &tiles, &far, 0.0);
        assert!(image.data().iter().all(|v| *v <= 1.0), "covered twice");
        assert_eq!(image.clamped(4, 4), 1.0);
        assert_eq!(image.sum(), 64.0);
    }

    #[test]
    fn depth_hides_splats_beyond_the_bias() {
        let depth = Image::constant(1, 1, 0.5);
        let at = |depth| Splat { center_px: [4.0, 4.0], depth, size_px: 2.0, value: 1.0 };
        let mut image = Image::constant(8, 8, 0.0);
        rasterize(&mut image, &[at(0.51)], &depth, 0.001);
        assert_eq!(image.sum(), 0.0);
        rasterize(&mut image, &[at(0.51), at(0.4)], &depth, 0.02);
        assert_eq!(image.sum(), 8.0);
    }

    proptest! {
        #[test]
        fn size_is_monotonic_in_distance(near in 0.05..1.0f64, d in 0.0..1.0f64) {
            let far = near + 50.0;
            let size = PointSize::new(5.0, 20.0, near, far);
            let at = near + d * 49.0;
            prop_assert!(size.at(at) > size.at(at + 1.0));
            prop_assert!((5.0..=20.0 + 1e-9).contains(&size.at(at)));
        }

        #[test]
        fn a_splat_of_whole_size_keeps_its_energy(x in 10.0..22.0f64, y in 10.0..22.0f64, side in 1u32..12) {
            let size_px = f64::from(side);
            let value = splat_value(Intensity::Conserving, 3.0, 0.13, 2.0, size_px);
            let mut image = Image::constant(32, 32, 0.0);
            let splat = Splat { center_px: [x, y], depth: 0.2, size_px, value };
            rasterize(&mut image, &[splat], &Image::constant(1, 1, 1.0), 0.0);
            prop_assert!((image.sum() - 3.0 * (-0.26f64).exp()).abs() < 1e-9);
        }
    }

    #[test]
    fn fractional_sizes_keep_energy_on_average() {
        let mut image = Image::constant(64, 64, 0.0);
        let steps = 40;
        let value = splat_value(Intensity::Conserving, 1.0, 0.0, 0.0, 5.3);
        let splat = |i: u32| {
            let center_px = [i % steps, i / steps].map(|k| 30.0 + f64::from(k) / f64::from(steps));
            Splat { center_px, depth: 0.0, size_px: 5.3, value }
        };
        let splats: Vec<Splat> = (0..steps * steps).map(splat).collect();
        rasterize(&mut image, &splats, &Image::constant(1, 1, 1.0), 0.0);
        let mean = image.sum() / f64::from(steps * steps);
        assert!((mean - 1.0).abs() < 0.01, "mean energy {mean}");
    }
}
