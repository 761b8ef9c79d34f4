//! `shafts/lines`: a line from start to hit for each photon, fading with its way, added up. SPT §3.2.

use crate::photon::Photons;
use crate::prelude::*;
use crate::splatting::SplatSums;

pub const INFO: StageInfo = StageInfo {
    name: "shafts/lines",
    about: "a line from start to hit for each photon, fading with its way through the medium",
    source: "SPT §3.2",
};

shader_struct! {
    pub struct ShaftUniforms {
        /// Flux of a photon, W.
        pub photon_w: f32,
        pub photons: u32,
    }
}

/// Over the camera's `depth`. `length_px` is that of a line in the middle of the view, for the declared work.
pub fn new(
    resources: &Resources<'_>,
    shared: &Shared,
    photons: &Photons,
    weights: &Buffer,
    depth: &wgpu::Texture,
    photon_w: f64,
    length_px: f64,
) -> Result<Stage<SplatSums>, GpuError> {
    let count = photons.count;
    let settings = ShaftUniforms { photon_w: photon_w as f32, photons: count };
    let settings = resources.uniform(INFO.name, &settings);
    let groups = [&shared.group, &Bindings::new(&[&settings, photons, depth, weights])];
    let targets = [kit::additive(kit::accumulation_format(resources.gpu))];
    let spec = RenderSpec {
        topology: wgpu::PrimitiveTopology::LineList,
        ..RenderSpec::new(INFO.name, &groups, &targets)
    };
    let pass = DrawPass::new(resources, &spec, kit::size_px(depth), wgpu::Color::BLACK)?;
    let fragments = (f64::from(count) * length_px) as u64;
    let work = Work {
        photons: count.into(),
        primitives: count.into(),
        fragments,
        bytes_read: Photons::bytes(count.into()),
        bytes_written: fragments * 4,
        ..Work::default()
    };
    // Lines may lie outside the picture.
    let min_work = Work { fragments: 0, bytes_written: 0, ..work };
    let column = Column::new(
        "flux",
        "W",
        "flux of the photons whose lines cross the pixel, less what the medium took",
    );
    let stage =
        pass.drawing(&INFO, work, move |pass| pass.draw(0..2, 0..count)).with_min_work(min_work);
    let stage = stage.dump_as("lines", "lines before the blur", vec![column.clone()]);
    let texture = stage.output.clone();
    Ok(stage.with_output(SplatSums { texture, column }))
}
