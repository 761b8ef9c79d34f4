//! `planar/points`: each photon is a point of one texel in the illumination map of the pool's face that it meets. SPT §1.1, Fig. 2.

use crate::pool::Pool;
use crate::prelude::*;
use crate::screen_ray::{Transfer, Transfers};

pub const INFO: StageInfo = StageInfo {
    name: "planar/points",
    about: "a point of one texel for each photon in the illumination map of the pool's floor and walls",
    source: "SPT §1.1, Fig. 2",
};

shader_struct! {
    pub struct PointUniforms {
        /// Flux of a photon in the middle of the light's frustum, W.
        pub photon_w: f32,
    }
}

/// The map holds W/m². 16-bit targets, where the adapter blends no others, stop to grow at about 2,000 photons of a texel. `photon_w` is
/// the flux of a photon in the middle of the light's frustum.
pub fn new(
    resources: &Resources<'_>,
    shared: &Shared,
    transfers: &Transfers,
    pool: &Pool,
    photon_w: f64,
) -> Result<Stage<wgpu::Texture>, GpuError> {
    let settings = resources.uniform(INFO.name, &PointUniforms { photon_w: photon_w as f32 });
    let own = Bindings::new(&[&settings, &resources.uniform("pool", pool), transfers]);
    let groups = [&shared.group, &own];
    let targets = [kit::additive(kit::accumulation_format(resources.gpu))];
    let defs = [shared.water_def(), shared.fresnel_def()];
    let spec = RenderSpec {
        topology: wgpu::PrimitiveTopology::PointList,
        ..RenderSpec::new((INFO.name, &defs), &groups, &targets)
    };
    let pass = DrawPass::new(resources, &spec, pool.map_px(), wgpu::Color::BLACK)?;
    let (points, photons) = (transfers.count, u64::from(transfers.count));
    let work = Work {
        photons,
        primitives: photons,
        fragments: photons,
        bytes_read: photons * size_of::<Transfer>() as u64,
        bytes_written: photons * 4,
        ..Work::default()
    };
    // Photons may lie outside the map.
    let min_work = Work { fragments: 0, bytes_written: 0, ..work };
    let stage =
        pass.drawing(&INFO, work, move |pass| pass.draw(0..points, 0..1)).with_min_work(min_work);
    let meaning = "faces side by side: the floor (row 0 at −z), then the walls at −x, +x, −z, +z (row 0 at the top)";
    let column = Column::new("irradiance", "W/m²", "what the photons bring to the texel");
    Ok(stage.dump_as("map", meaning, vec![column]))
}
