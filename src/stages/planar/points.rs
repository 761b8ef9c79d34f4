//! `planar/points`: each photon is a point of one texel in the illumination map of the pool's face that it meets. SPT §1.1, Fig. 2.

use crate::frame::Shared;
use crate::kit::{self, Bind, Group, Raster, RenderSpec, Resources};
use crate::pool::{Pool, map_output};
use crate::screen_ray::{Transfer, Transfers};
use crate::shader_struct;
use crate::{Output, Stage, StageInfo};
use fathom_gpu::{ColorTarget, GpuError, StageScope, Targets};
use fathom_record::Work;

pub const INFO: StageInfo = StageInfo {
    name: "planar/points",
    about: "a point of one texel for each photon in the illumination map of the pool's floor and walls",
    source: "SPT §1.1, Fig. 2",
};

shader_struct! {
    /// `Points` in `shaders/planar/points.wgsl`.
    pub struct PointUniforms {
        pub photon_w: f32,
    }
}

pub struct Points {
    raster: Raster,
    groups: Vec<wgpu::BindGroup>,
    view: wgpu::TextureView,
    /// W/m². 16-bit targets, where the adapter blends no others, stop to grow at about 2,000 photons of a texel.
    pub map: wgpu::Texture,
    photons: u32,
}

impl Points {
    /// `photon_w` is the flux of a photon in the middle of the light's frustum.
    pub fn new(
        resources: &Resources<'_>,
        shared: &Shared,
        transfers: &Transfers,
        pool: &Pool,
        photon_w: f64,
    ) -> Result<Self, GpuError> {
        let settings = PointUniforms { photon_w: photon_w as f32 };
        let settings = resources.uniform(INFO.name, &settings);
        let pool_uniform = pool.uniform(resources);
        let binds =
            [Bind::Uniform(&settings), Bind::Uniform(&pool_uniform), Bind::Read(&transfers.buffer)];
        let group = Group::new(resources.gpu, INFO.name, &binds);
        let groups = [&shared.group, &group];
        let format = kit::accumulation_format(resources.gpu);
        let targets = [kit::additive(format)];
        let defs = [shared.water_def(), shared.fresnel_def()];
        let spec = RenderSpec {
            topology: wgpu::PrimitiveTopology::PointList,
            ..RenderSpec::new(INFO.name, (INFO.name, &defs[..]), &groups, &targets)
        };
        let map = resources.target(INFO.name, pool.map_px(), format);
        Ok(Self {
            raster: Raster::new(resources, &spec)?,
            groups: kit::bare(&groups),
            view: kit::view(&map),
            map,
            photons: transfers.count,
        })
    }
}

impl Stage for Points {
    fn info(&self) -> &'static StageInfo {
        &INFO
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        let clear = Some(wgpu::Color::BLACK);
        let color = [ColorTarget { view: &self.view, clear, slice: None }];
        scope.render(&Targets { color: &color, depth: None }, |pass| {
            self.raster.bind(pass);
            kit::bind_groups(pass, &self.groups);
            pass.draw(0..self.photons, 0..1);
        });
    }

    fn work(&self) -> Work {
        let photons = u64::from(self.photons);
        Work {
            photons,
            primitives: photons,
            fragments: photons,
            bytes_read: photons * size_of::<Transfer>() as u64,
            bytes_written: photons * 4,
            ..Work::default()
        }
    }

    /// Photons may lie outside the map.
    fn least_work(&self) -> Work {
        Work { fragments: 0, bytes_written: 0, ..self.work() }
    }

    fn outputs(&self) -> Vec<Output> {
        vec![map_output(&self.map)]
    }
}
