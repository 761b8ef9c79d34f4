//! `caustics/splat`: a square of regulated size for each photon, added up. UW §3.3.
//!
//! The rasterizer does it as in the paper ([`raster`]), or a compute shader ([`scatter`]). What binds each was measured as CPU time on one
//! core, with lavapipe of Mesa 22.3, 160,000 photons of scene `tank` (half of them in view), 512 × 512 pixels and the coverage `surface`;
//! ms:
//!
//! | | clearing, depth, result | photons or vertices | triangles | pixels at 5 px | all at 5 px | 10 px | 20 px |
//! |---|---|---|---|---|---|---|---|
//! | rasterizer | 1.9 | 23.5 | 12.7 | 16.3 | 54.4 | 79.3 | 172 |
//! | compute | 2.7 | 7.0 | – | 12.2 | 21.9 | 48.7 | 139 |
//!
//! Vertices and triangle set-up bind the rasterizer at the paper's size. Atomic additions, about 4 ns each, bind the compute shader. With
//! the coverage `square` the rasterizer takes 34.9 ms at 5 px and compute 14.7 ms; at 20 px compute takes 9 % more. On a GPU, whose
//! hardware blends, this has not been measured.
//!
//! For the rasterizer these were no faster, and are not kept: a triangle of twice the size in place of two (11 % slower at 5 px, 23 % at
//! 20 px), leaving the vertex shader early for squares beyond the picture, and another order of indices (both within 1.5 %). In the compute
//! shader, sums of 32-bit floats by compare-and-exchange took 18 % more at 5 px and 27 % more at 20 px.

use glam::Vec2;
use serde::{Deserialize, Serialize};

use crate::photon::Photons;
use crate::prelude::*;
use crate::splatting::{self, SplatDrawing, SplatSums, summing};

pub const INFO: StageInfo = StageInfo {
    name: "caustics/splat",
    about: "a square of regulated size for each photon, added up in a float target: its flux in every pixel (paper), or shared among them (conserving)",
    source: "UW §3.3",
};

shader_struct! {
    pub struct SplatUniforms {
        /// Pixels of the caustics buffer.
        pub size_px: Vec2,
        /// s = size_a_px + size_b_px_m / distance to the viewer (UW §3.3).
        pub size_a_px: f32,
        pub size_b_px_m: f32,
        /// I_photon: flux of a photon, W.
        pub photon_w: f32,
        /// Splats are tested this much nearer to the camera than their photon, so that the surface they lie on does not hide them.
        /// SURFACE 1: pixels whose surface is this much farther than the splat are left out too.
        pub depth_bias_m: f32,
        /// Steps of a fixed-point sum in a unit of intensity.
        pub steps: f32,
        pub photons: u32,
        /// Photons that one instance of the rasterizer's index pattern draws.
        pub photons_per_instance: u32,
    }
}

/// Where a splat is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SplatCoverage {
    /// UW §3.3: a square that faces the camera, in front of all that is farther than its photon.
    Square,
    /// The part of the square behind which the photon's own surface is seen.
    Surface,
}

fathom_base::choices!(SplatCoverage);

impl SplatCoverage {
    fn def(self) -> (&'static str, i32) {
        ("SURFACE", i32::from(self == Self::Surface))
    }
}

/// The point size rule s = a + b / distance. UW §3.3.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointSize {
    pub a_px: f64,
    pub b_px_m: f64,
}

impl PointSize {
    /// Sizes `min_px` at `far_m` and `max_px` at `near_m` from the viewer.
    pub fn new(min_px: f64, max_px: f64, near_m: f64, far_m: f64) -> Self {
        let slope = (max_px - min_px) / (far_m - near_m);
        Self { a_px: max_px - far_m * slope, b_px_m: near_m * far_m * slope }
    }

    pub fn size_px(&self, distance_m: f64) -> f64 {
        self.a_px + self.b_px_m / distance_m
    }
}

/// What a texel of the caustics buffer holds.
fn column(conserving: bool) -> Column {
    if conserving {
        return Column {
            name: "flux",
            unit: "W/px",
            meaning: "sum over the splats seen in the pixel of their photons' attenuated flux over the splat's area in pixels; the sum over the buffer is the flux that lands in view, W, less what splats carry out of the picture or onto other surfaces, and with what they carry into it",
        };
    }
    Column {
        name: "intensity",
        unit: "W per photon, not divided by the area of its splat",
        meaning: "sum over the splats that cover the pixel of their photons' whole attenuated flux (UW §3.3); the sum over the buffer counts each photon once for every pixel that its splat covers",
    }
}

/// The steps of a fixed-point sum in a unit of intensity, where photons add `least` to `most` and rarely more or less. One that adds `most`
/// adds 2²⁴ steps, as fine as the fraction of an f32. It adds up to 2⁴⁰ where one that adds `least` would else add less than 2¹²: the sum
/// has room for 2²⁴ such photons.
pub fn steps([min, max]: [f64; 2]) -> f32 {
    let power = |bits: i32| 2f64.powi(bits);
    let steps = (power(24) / max).max((power(12) / min).min(power(40) / max));
    steps.min(f32::MAX.into()) as f32
}

/// How splats are drawn.
#[derive(Clone, Copy)]
pub struct SplatStyle {
    /// Pixels share the flux of a splat's photon; else each of them gets all of it.
    pub conserving: bool,
    pub coverage: SplatCoverage,
    /// Side of a splat in the middle of the view, for the declared work.
    pub typical_px: f64,
    /// No splat has a longer side.
    pub max_px: f64,
}

/// A square is drawn as two triangles, and blending adds it up.
///
/// # Errors
/// What the GPU reports.
pub fn raster(
    resources: &Resources<'_>,
    shared: &Shared,
    photons: &Photons,
    scene_depth: &wgpu::Texture,
    settings: &SplatUniforms,
    style: SplatStyle,
) -> Result<Stage<SplatSums>, GpuError> {
    let drawing = SplatDrawing {
        uniforms: &resources.uniform(INFO.name, settings),
        size_px: settings.size_px.as_uvec2().to_array(),
        def: Some(style.coverage.def()),
        conserving: style.conserving,
        fragments: fragments(photons, style.typical_px),
        column: column(style.conserving),
    };
    splatting::new(resources, &INFO, shared, photons, scene_depth, drawing)
}

fn fragments(photons: &Photons, typical_px: f64) -> u64 {
    (f64::from(photons.count) * typical_px * typical_px) as u64
}

/// Invocations of a workgroup over pixels, all in a row, and rows of each, as in the shader.
const COLUMNS: u32 = 64;
const ROWS: u32 = 8;
/// Rows of a splat that an invocation adds, as in the shader.
const SPLAT_ROWS: u64 = 32;
/// Bytes of a pixel: its sum, its depth, its value in the picture.
const PIXEL_BYTES: u64 = 8 + 4 + 4;

/// An invocation for each photon adds it to fixed-point sums of 64 bits. Sums do not depend on the order of photons, so they are the
/// same in every frame, and need no target that the adapter can blend.
///
/// # Errors
/// What the GPU reports.
pub fn scatter(
    resources: &Resources<'_>,
    shared: &Shared,
    photons: &Photons,
    scene_depth: &wgpu::Texture,
    settings: &SplatUniforms,
    style: SplatStyle,
) -> Result<Stage<SplatSums>, GpuError> {
    let [width, height] = settings.size_px.as_uvec2().to_array();
    let pixels = u64::from(width) * u64::from(height);
    let image = resources.image(INFO.name, [width, height], wgpu::TextureFormat::R32Float);
    let uniforms = resources.uniform(INFO.name, settings);
    let sums = resources.storage("caustics/splat sums", pixels * 8);
    let depths = resources.storage("caustics/splat depths", pixels * 4);
    let own = Bindings::new(&[&uniforms, photons, scene_depth, &sums, &depths, &image]);
    let groups = [&shared.group, &own];
    let step = |number: i32, workgroups| {
        let conserving = ("CONSERVING", i32::from(style.conserving));
        let defs = [("STEP", number), conserving, style.coverage.def(), shared.fresnel_def()];
        Dispatch::new(resources, (INFO.name, &defs), &groups, workgroups)
    };
    let of_pixels = [width.div_ceil(COLUMNS), height.div_ceil(ROWS), 1];
    let side = style.max_px.floor() as u64 + 1;
    let parts = side.min(height.into()).div_ceil(SPLAT_ROWS);
    let iterations = 1 + SPLAT_ROWS * (side.min(width.into()) + 2);
    resources.iterations("view.width of caustics.buffer", iterations);
    let [x, y, _] = kit::linear_workgroups(photons.count.into());
    let of_photons = [x, y, parts as u32];
    // Sums cleared, photons added, sums turned into the picture.
    let steps = [step(0, of_pixels)?, step(1, of_photons)?, step(2, of_pixels)?];
    let (count, fragments) = (u64::from(photons.count), fragments(photons, style.typical_px));
    let work = Work {
        photons: count,
        fragments,
        texel_fetches: pixels,
        bytes_read: Photons::bytes(count),
        bytes_written: fragments * 4 + pixels * PIXEL_BYTES,
        ..Work::default()
    };
    // Splats may lie outside the picture, and no rasterizer draws them.
    let min_work = Work { fragments: 0, bytes_written: pixels * PIXEL_BYTES, ..work };
    let stage = Dispatch::stage(steps, &INFO, work).with_min_work(min_work).with_output(image);
    Ok(summing(stage, column(style.conserving)))
}
