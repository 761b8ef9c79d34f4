//! `godrays/filter`: multi-tap low-pass with a kernel rotated per pixel. UW §3.5.

use crate::gpu::{GpuError, StageScope};
use crate::record::Work;
use crate::stages::kit::Resources;
use crate::stages::low_pass::{FilterUniforms, LowPass};
use crate::stages::{Column, Output, Stage, StageInfo};

pub const INFO: StageInfo = StageInfo {
    name: "godrays/filter",
    about: "multi-tap low-pass with a kernel rotated per pixel",
    source: "UW §3.5",
};

pub struct Filter(LowPass);

impl Filter {
    pub fn new(
        resources: &Resources<'_>,
        source: (&wgpu::Texture, Column),
        settings: &FilterUniforms,
    ) -> Result<Self, GpuError> {
        LowPass::new(resources, INFO.name, source, settings).map(Self)
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
