//! What `caustics/filter` and `godrays/filter` share: a multi-tap low-pass with a kernel rotated per pixel. UW §3.5.

use crate::prelude::*;
use crate::splatting::SplatSums;

pub(crate) const fn info(name: &'static str) -> StageInfo {
    StageInfo {
        name,
        about: "multi-tap low-pass with a kernel rotated per pixel",
        source: "UW §3.5",
    }
}

/// A pixel reads so many texels, and so many at least.
pub(crate) fn stage(
    resources: &Resources<'_>,
    info: &'static StageInfo,
    groups: &[&Bindings],
    source: &SplatSums,
    [texels, min]: [u64; 2],
) -> Result<Stage<wgpu::Texture>, GpuError> {
    let targets = [kit::opaque(source.texture.format())];
    let spec = RenderSpec::new(info.name, groups, &targets);
    let pass = DrawPass::new(resources, &spec, kit::size_px(&source.texture), wgpu::Color::BLACK)?;
    let (work, min_work) = (pass.work(texels, 4), pass.work(min, 4));
    let meaning = "what the photons add up to, averaged over the low-pass's disc";
    let stage = pass.stage(info, work).with_min_work(min_work);
    Ok(stage.dump_as("filtered", meaning, vec![source.column.clone()]))
}
