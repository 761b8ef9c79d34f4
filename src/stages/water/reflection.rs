//! `water/reflection`: what the water mirrors, drawn from the camera mirrored about y = 0. UW §3 step 4.

use crate::gpu::{GpuError, StageScope};
use crate::record::Work;
use crate::stages::frame::Shared;
use crate::stages::geometry::Geometry;
use crate::stages::kit::Resources;
use crate::stages::lit_scene::LitScene;
use crate::stages::{Output, Stage, StageInfo};

pub const INFO: StageInfo = StageInfo {
    name: "water/reflection",
    about: "what the water mirrors, drawn from the camera mirrored about y = 0",
    source: "UW §3 step 4",
};

pub struct Reflection(LitScene);

impl Reflection {
    pub fn new(
        resources: &Resources<'_>,
        shared: &Shared,
        geometry: &Geometry,
        size_px: [u32; 2],
    ) -> Result<Self, GpuError> {
        LitScene::new(resources, shared, geometry, INFO.name, size_px).map(Self)
    }

    pub fn texture(&self) -> &wgpu::Texture {
        &self.0.color
    }
}

impl Stage for Reflection {
    fn name(&self) -> &'static str {
        INFO.name
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        self.0.encode(scope);
    }

    fn work(&self) -> Work {
        self.0.work()
    }

    fn outputs(&self) -> Vec<Output> {
        self.0.outputs(INFO.about)
    }
}
