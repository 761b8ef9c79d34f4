//! Photon splats: regulated point size, intensity, and a rasterizer twin in f64 (UW §3.3).

use itertools::iproduct;

use super::image::Image;
use super::optics::transmittance;

/// Point size in pixels as a function of the distance from the viewer, `s = a + b / d` (UW §3.3):
/// `s_max` at the near plane and `s_min` at the far plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SplatSize {
    a_px: f64,
    b_px_m: f64,
}

impl SplatSize {
    pub fn new(min_px: f64, max_px: f64, near_m: f64, far_m: f64) -> SplatSize {
        let slope = (max_px - min_px) / (far_m - near_m);
        SplatSize { a_px: max_px - far_m * slope, b_px_m: near_m * far_m * slope }
    }

    /// Side of the splat in pixels at a distance from the viewer in metres.
    pub fn size_px(&self, distance_m: f64) -> f64 {
        self.a_px + self.b_px_m / distance_m
    }
}

/// Value that a splat adds to each pixel it covers: `I · exp(−γ d_surface)` (UW §3.3), divided by
/// the area in pixels where energy is conserved.
pub fn splat_value(
    conserving: bool,
    photon: f64,
    gamma_per_m: f64,
    surface_distance_m: f64,
    size_px: f64,
) -> f64 {
    let intensity = photon * transmittance(gamma_per_m, surface_distance_m);
    if conserving { intensity / (size_px * size_px) } else { intensity }
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
        let [columns, rows] = [0, 1].map(|k| covered(splat.center_px[k], splat.size_px, size[k]));
        for (y, x) in iproduct!(rows, columns) {
            let [u, v] =
                [(x, size[0]), (y, size[1])].map(|(k, of)| (k as f64 + 0.5) / f64::from(of));
            if splat.depth <= depth.nearest(u, v) + bias {
                target.add(x, y, splat.value);
            }
        }
    }
}

/// Pixels of a row whose centres lie in [centre − size/2, centre + size/2), cut to the image.
fn covered(center: f64, size: f64, count: u32) -> std::ops::Range<i64> {
    let first = (center - 0.5 * size - 0.5).ceil().max(0.0) as i64;
    let end = (center + 0.5 * size - 0.5).ceil().min(f64::from(count)) as i64;
    first..end
}
