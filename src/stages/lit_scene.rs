//! What `water/reflection` and `water/refraction` are: the scene lit without photons.

use super::frame::Shared;
use super::geometry::Geometry;
use super::kit::{Bind, Group, Resources, ScenePass};
use super::{Column, Output, Stage, StageInfo};
use fathom_gpu::{GpuError, StageScope};
use fathom_record::Work;

pub struct LitScene {
    info: &'static StageInfo,
    pass: ScenePass,
}

impl LitScene {
    /// The stage `info`.
    pub fn new(
        resources: &Resources<'_>,
        info: &'static StageInfo,
        shared: &Shared,
        geometry: &Geometry,
        size_px: [u32; 2],
    ) -> Result<Self, GpuError> {
        let group = Group::new(resources.gpu, info.name, &[Bind::Read(&geometry.materials)]);
        let formats = [wgpu::TextureFormat::Rgba16Float];
        let groups = [&shared.group, &group];
        let pass = ScenePass::new(resources, info.name, &groups, geometry, &formats, size_px)?;
        Ok(Self { info, pass })
    }

    pub fn texture(&self) -> &wgpu::Texture {
        &self.pass.colors[0]
    }
}

impl Stage for LitScene {
    fn info(&self) -> &'static StageInfo {
        self.info
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        self.pass.encode(scope);
    }

    fn work(&self) -> Work {
        self.pass.work(8 + 4)
    }

    fn least_work(&self) -> Work {
        self.pass.least_work(8 + 4)
    }

    fn outputs(&self) -> Vec<Output> {
        let mut columns = ["red", "green", "blue"]
            .map(|name| Column::new(name, "W/(m² sr)", "radiance"))
            .to_vec();
        columns.push(Column::new("covered", "1", "1 where geometry was drawn"));
        vec![Output::texture("radiance", self.info.about, columns, self.texture())]
    }
}
