//! `godrays/lines`: a wide line from water entry to hit for each photon, added up. UW §3.4.

use glam::Vec2;

use crate::photon::Photons;
use crate::prelude::*;
use crate::splatting::{self, SplatDrawing, SplatSums};

pub const INFO: StageInfo = StageInfo {
    name: "godrays/lines",
    about: "a wide line from water entry to hit for each photon, added up in a float target: its intensity across the whole width (paper), or shared over it (conserving)",
    source: "UW §3.4",
};

shader_struct! {
    pub struct LinesUniforms {
        /// Pixels of the godray buffer.
        pub size_px: Vec2,
        /// Its sides in squares of a pixel's area: lines are as wide in all directions, whatever the shape of pixels.
        pub square_px: Vec2,
        pub width_px: f32,
        /// Schlick's k: −1 backward … 1 forward scattering.
        pub phase_k: f32,
        /// I_photon: flux of a photon, W.
        pub photon_w: f32,
        /// Photons that one instance of the index pattern draws.
        pub photons_per_instance: u32,
        pub photons: u32,
    }
}

/// What a texel of the godray buffer holds.
fn column(conserving: bool) -> Column {
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

/// `typical_px` is the length of a line on the screen, for the declared work.
pub fn new(
    resources: &Resources<'_>,
    shared: &Shared,
    photons: &Photons,
    scene_depth: &wgpu::Texture,
    settings: &LinesUniforms,
    conserving: bool,
    typical_px: f64,
) -> Result<Stage<SplatSums>, GpuError> {
    let drawing = SplatDrawing {
        uniforms: &resources.uniform(INFO.name, settings),
        size_px: settings.size_px.as_uvec2().to_array(),
        def: None,
        conserving,
        fragments: (f64::from(photons.count) * typical_px * f64::from(settings.width_px)) as u64,
        column: column(conserving),
    };
    splatting::new(resources, &INFO, shared, photons, scene_depth, drawing)
}
