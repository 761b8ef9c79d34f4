//! `shadow/depth`: scene depth from the light. UW §3 step 2a.

use crate::frame::Shared;
use crate::geometry::Geometry;
use crate::kit::{Resources, ScenePass};
use crate::{Column, Output, Stage, StageInfo};
use fathom_gpu::{GpuError, StageScope};
use fathom_record::Work;

pub const INFO: StageInfo = StageInfo {
    name: "shadow/depth",
    about: "scene depth from the light, for the image-space estimator",
    source: "UW §3 step 2a",
};

pub struct Depth(ScenePass);

impl Depth {
    /// `size` texels per side.
    pub fn new(
        resources: &Resources<'_>,
        shared: &Shared,
        geometry: &Geometry,
        size: u32,
    ) -> Result<Self, GpuError> {
        let groups = [&shared.group];
        ScenePass::new(resources, INFO.name, &groups, geometry, &[], [size; 2]).map(Self)
    }

    pub fn texture(&self) -> &wgpu::Texture {
        &self.0.depth
    }
}

impl Stage for Depth {
    fn info(&self) -> &'static StageInfo {
        &INFO
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        self.0.encode(scope);
    }

    fn work(&self) -> Work {
        self.0.work(4)
    }

    fn least_work(&self) -> Work {
        self.0.least_work(4)
    }

    fn outputs(&self) -> Vec<Output> {
        let meaning =
            "depth of the scene along the light, 0 near plane to 1 far plane; row 0 is ndc y = +1";
        let column = Column::new("depth", "1", "normalised device depth of the light");
        vec![Output::texture("depth", meaning, vec![column], self.texture())]
    }
}
