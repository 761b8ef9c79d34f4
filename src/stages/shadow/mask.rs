//! `shadow/mask`: the water surface as the light sees it first. UW §3 step 2b.

use crate::prelude::*;

pub const INFO: StageInfo = StageInfo {
    name: "shadow/mask",
    about: "water surface visible from the light; photons that land elsewhere are dropped",
    source: "UW §3 step 2b",
};

shader_struct! {
    pub struct MaskUniforms {
        pub cells: u32,
    }
}

/// `depth` is the light's depth; the water is a grid of `cells`² quads.
pub fn new(
    resources: &Resources<'_>,
    shared: &Shared,
    depth: &wgpu::Texture,
    cells: u32,
) -> Result<Stage<wgpu::Texture>, GpuError> {
    let settings = resources.uniform(INFO.name, &MaskUniforms { cells });
    let groups = [&shared.group, &Bindings::new(&[&settings])];
    let targets = [kit::opaque(wgpu::TextureFormat::R8Unorm)];
    let defs = [shared.water_def()];
    let spec = RenderSpec {
        depth: Some(Depth::behind(depth)),
        ..RenderSpec::new((INFO.name, &defs), &groups, &targets)
    };
    let pass = DrawPass::new(resources, &spec, kit::size_px(depth), wgpu::Color::BLACK)?;
    let (quads, texels) = (cells * cells, pass.pixels());
    let work = Work {
        triangles: u64::from(cells) * u64::from(cells) * 2,
        bytes_read: texels * 4,
        bytes_written: texels,
        ..Work::default()
    };
    // Where there is no water, no depth is compared.
    let min_work = Work { bytes_read: 0, ..work };
    let stage = pass.drawing(&INFO, work, move |pass| pass.draw(0..quads * 6, 0..1));
    let meaning = "1 where the light meets the water first; row 0 is ndc y = +1 of the light";
    let column = Column::new("water", "1", "1 water, 0 other");
    Ok(stage.with_min_work(min_work).dump_as("mask", meaning, vec![column]))
}
