//! `hsao/filter`: joint bilateral filter and up-scaling of the ambient-occlusion buffer. VAO §6.

use crate::gpu::{GpuError, StageScope};
use crate::record::Work;
use crate::stages::bilateral::{self, BilateralUniforms, Inputs};
use crate::stages::frame::Shared;
use crate::stages::kit::Resources;
use crate::stages::{Output, Stage, StageInfo};

pub const INFO: StageInfo = StageInfo {
    name: "hsao/filter",
    about: "joint bilateral filter guided by depth, and up-scaling, of screen-space occlusion",
    source: "VAO §6",
};

pub struct Filter(bilateral::Bilateral);

impl Filter {
    /// The result has the size of `inputs.depth`.
    pub fn new(
        resources: &Resources<'_>,
        shared: &Shared,
        inputs: &Inputs<'_>,
        settings: &BilateralUniforms,
    ) -> Result<Self, GpuError> {
        bilateral::Bilateral::new(resources, INFO.name, shared, inputs, settings).map(Self)
    }

    pub fn texture(&self) -> &wgpu::Texture {
        &self.0.target
    }
}

impl Stage for Filter {
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
        self.0.outputs()
    }
}
