//! `godrays/trace`: the light's photon grid through the water to the scene. UW §3.4.

use crate::gpu::{GpuError, StageScope};
use crate::record::Work;
use crate::stages::frame::Shared;
use crate::stages::kit::Resources;
use crate::stages::photon::{TraceUniforms, Tracing};
use crate::stages::{Output, Stage, StageInfo};

pub const INFO: StageInfo = StageInfo {
    name: "godrays/trace",
    about: "photon grid: water intersection, refraction, image-space estimator",
    source: "UW §3.4",
};

pub struct Trace(pub Tracing);

impl Trace {
    /// `depth` and `mask` are the light's; see [`Tracing::new`].
    pub fn new(
        resources: &Resources<'_>,
        shared: &Shared,
        textures: (&wgpu::Texture, &wgpu::Texture),
        settings: TraceUniforms,
        dynamic: bool,
    ) -> Result<Self, GpuError> {
        Tracing::new(resources, shared, INFO.name, textures, settings, dynamic).map(Self)
    }

    /// See [`Tracing::weighted`].
    #[must_use]
    pub fn weighted(self, conserving: bool) -> Self {
        Self(self.0.weighted(conserving))
    }
}

impl Stage for Trace {
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
