//! `godrays/lines`: a wide line from water entry to hit for each photon, added up. UW §3.4.

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
    name: "godrays/lines",
    about: "a wide line from water entry to hit for each photon, added up in a float target: its intensity across the whole width (paper), or shared over it (conserving)",
    source: "UW §3.4",
};

/// Host twin of `Lines` in `shaders/godrays/lines.wgsl`.
#[derive(Clone, Debug, PartialEq, ShaderType)]
pub struct LinesUniforms {
    pub size_px: Vec2,
    pub width_px: f32,
    pub phase_k: f32,
    pub photon_w: f32,
    pub photons_per_instance: u32,
    pub photons: u32,
}

/// What a texel of the godray buffer holds.
pub fn column(conserving: bool) -> Column {
    if conserving {
        return Column {
            name: "intensity",
            unit: "W/sr/px",
            meaning: "sum over the lines that cover the pixel of their photons' attenuated flux × phase function, over the line's width in pixels",
        };
    }
    Column {
        name: "intensity",
        unit: "W/sr per photon, not divided by the width of its line",
        meaning: "sum over the lines that cover the pixel of their photons' attenuated flux × phase function (UW §3.4)",
    }
}

pub struct Lines {
    additive: Additive,
    conserving: bool,
    photons: u64,
    fragments: u64,
}

impl Lines {
    /// `typical_px` is the length of a line on the screen, for the declared work.
    pub fn new(
        resources: &Resources<'_>,
        shared: &Shared,
        inputs: (&Photons, &wgpu::Texture),
        settings: &LinesUniforms,
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
            fragments: (photons as f64 * typical_px * f64::from(settings.width_px)) as u64,
        })
    }

    pub fn texture(&self) -> &wgpu::Texture {
        &self.additive.target
    }
}

impl Stage for Lines {
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
