//! `caustics/splat`: a square of regulated size for each photon, added up. UW §3.3.

use glam::Vec2;
use serde::{Deserialize, Serialize};

use crate::gpu::GpuError;
use crate::shader_struct;
use crate::stages::frame::Shared;
use crate::stages::kit::Resources;
use crate::stages::photon::Photons;
use crate::stages::splatting::{Additive, Drawing};
use crate::stages::{Column, StageInfo};

pub const INFO: StageInfo = StageInfo {
    name: "caustics/splat",
    about: "a square of regulated size for each photon, added up in a float target: its flux in every pixel (paper), or shared among them (conserving)",
    source: "UW §3.3",
};

shader_struct! {
    /// `Splat` in `shaders/caustics/splat.wgsl`.
    pub struct SplatUniforms {
        pub size_px: Vec2,
        pub size_a_px: f32,
        pub size_b_px_m: f32,
        pub photon_w: f32,
        pub depth_bias_m: f32,
        pub photons_per_instance: u32,
        pub photons: u32,
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

    pub fn at(&self, distance_m: f64) -> f64 {
        self.a_px + self.b_px_m / distance_m
    }
}

/// What a texel of the caustics buffer holds.
fn column(conserving: bool) -> Column {
    if conserving {
        return Column {
            name: "flux",
            unit: "W/px",
            meaning: "flux of the photons that land in the pixel: each photon's, attenuated, over the area of its splat in pixels; the sum over the buffer is the flux that lands in view, W",
        };
    }
    Column {
        name: "intensity",
        unit: "W per photon, not divided by the area of its splat",
        meaning: "sum over the splats that cover the pixel of their photons' whole attenuated flux (UW §3.3); the sum over the buffer counts each photon once for every pixel that its splat covers",
    }
}

/// `typical_px` is the side of a splat in the middle of the view, for the declared work.
pub fn new(
    resources: &Resources<'_>,
    shared: &Shared,
    inputs: (&Photons, &wgpu::Texture),
    settings: &SplatUniforms,
    (conserving, coverage): (bool, SplatCoverage),
    typical_px: f64,
) -> Result<Additive, GpuError> {
    let drawing = Drawing {
        uniforms: &resources.uniform(INFO.name, settings),
        size_px: settings.size_px.as_uvec2().to_array(),
        def: Some(("SURFACE", i32::from(coverage == SplatCoverage::Surface))),
        conserving,
        fragments: (f64::from(inputs.0.count) * typical_px * typical_px) as u64,
        column: column(conserving),
    };
    Additive::new(resources, &INFO, shared, inputs, drawing)
}
