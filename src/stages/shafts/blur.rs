//! `shafts/blur`: a Gaussian of constant width on the screen. SPT §3.2.

use glam::IVec2;

use crate::prelude::*;
use crate::splatting::SplatSums;

pub const INFO: StageInfo = StageInfo {
    name: "shafts/blur",
    about: "Gaussian blur of the shafts, rows and then columns",
    source: "SPT §3.2",
};

shader_struct! {
    pub struct ShaftBlurUniforms {
        /// (1, 0) along rows, (0, 1) along columns.
        pub along: IVec2,
        /// Texels to either side.
        pub reach: i32,
        /// −1 / (2 σ²), 1/px².
        pub falloff: f32,
    }
}

/// The kernel ends here, in standard deviations: what is left is 0.3 % of its sum.
const REACH_SIGMAS: f64 = 3.0;

/// Of a texture of one channel. The result has the source's column.
pub fn new(
    resources: &Resources<'_>,
    source: &SplatSums,
    sigma_px: f64,
) -> Result<Stage<wgpu::Texture>, GpuError> {
    let reach = (REACH_SIGMAS * sigma_px).ceil();
    let pass = |source: &wgpu::Texture, along: IVec2| {
        let falloff = (-0.5 / (sigma_px * sigma_px)) as f32;
        let settings = ShaftBlurUniforms { along, reach: reach as i32, falloff };
        let settings = resources.loop_settings(INFO.name, &settings);
        let group = Bindings::new(&[&settings, source]);
        let (groups, targets) = ([&group], [kit::opaque(source.format())]);
        let spec = RenderSpec::new(INFO.name, &groups, &targets);
        DrawPass::new(resources, &spec, kit::size_px(source), wgpu::Color::BLACK)
    };
    let rows = pass(&source.texture, IVec2::X)?;
    let columns = pass(rows.texture(), IVec2::Y)?;
    let fragments = 2 * rows.pixels();
    let work = Work {
        fragments,
        texel_fetches: fragments * (2 * reach as u64 + 1),
        bytes_written: fragments * 4,
        ..Work::default()
    };
    let blurred = columns.texture().clone();
    let stage = Stage::new(&INFO, work, move |scope| {
        rows.render(scope, kit::draw_fullscreen);
        columns.render(scope, kit::draw_fullscreen);
    });
    let column = source.column.clone();
    Ok(stage.with_output(blurred).dump_as("blurred", "lines after the blur", vec![column]))
}
