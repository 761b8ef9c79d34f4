//! `caustics/splat`: a square of regulated size for each photon, added up. UW §3.3.

use encase::ShaderType;
use glam::Vec2;

use crate::gpu::{GpuError, StageScope};
use crate::record::Work;
use crate::stages::frame::Shared;
use crate::stages::kit::Resources;
use crate::stages::photon::Photons;
use crate::stages::splatting::Additive;
use crate::stages::{Column, Output, Stage, StageInfo};

pub const INFO: StageInfo = StageInfo {
    name: "caustics/splat",
    about: "a square of regulated size for each photon, added up in a float target: its flux in every pixel (paper), or shared among them (conserving)",
    source: "UW §3.3",
};

/// Host twin of `Splat` in `shaders/caustics/splat.wgsl`.
#[derive(Clone, Debug, PartialEq, ShaderType)]
pub struct SplatUniforms {
    pub size_px: Vec2,
    pub size_a_px: f32,
    pub size_b_px_m: f32,
    pub photon_w: f32,
    pub depth_bias_m: f32,
    pub photons_per_instance: u32,
    pub photons: u32,
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
pub fn column(conserving: bool) -> Column {
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

pub struct Splat {
    additive: Additive,
    conserving: bool,
    photons: u64,
    fragments: u64,
}

impl Splat {
    /// `typical_px` is the side of a splat in the middle of the view, for the declared work.
    pub fn new(
        resources: &Resources<'_>,
        shared: &Shared,
        inputs: (&Photons, &wgpu::Texture),
        settings: &SplatUniforms,
        conserving: bool,
        typical_px: f64,
    ) -> Result<Self, GpuError> {
        let uniforms = resources.uniform(INFO.name, settings);
        let defs = [("CONSERVING", i32::from(conserving)), shared.fresnel_def()];
        let size_px = settings.size_px.as_uvec2().to_array();
        let photons = u64::from(inputs.0.count);
        let additive =
            Additive::new(resources, shared, INFO.name, &defs, &uniforms, inputs, size_px)?;
        Ok(Self {
            additive,
            conserving,
            photons,
            fragments: (photons as f64 * typical_px * typical_px) as u64,
        })
    }

    pub fn texture(&self) -> &wgpu::Texture {
        &self.additive.target
    }
}

impl Stage for Splat {
    fn name(&self) -> &'static str {
        INFO.name
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        self.additive.encode(scope);
    }

    fn work(&self) -> Work {
        Work {
            photons: self.photons,
            primitives: self.photons * 2,
            fragments: self.fragments,
            bytes_read: Photons::bytes(self.photons),
            bytes_written: self.fragments * 4 + self.additive.pixels() * 8,
            ..Work::default()
        }
    }

    fn outputs(&self) -> Vec<Output> {
        self.additive.outputs(column(self.conserving))
    }
}
