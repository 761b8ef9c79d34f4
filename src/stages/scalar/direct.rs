//! `scalar/direct`: direct volume rendering with ambient occlusion over the hemisphere down the gradient. VAO §5.2.2.

use crate::gpu::{GpuError, StageScope};
use crate::record::Work;
use crate::stages::frame::Shared;
use crate::stages::kit::Resources;
use crate::stages::ray_cast::{MarchUniforms, RayCast};
use crate::stages::scalar_field::ScalarField;
use crate::stages::{Output, Stage, StageInfo};

pub const INFO: StageInfo = StageInfo {
    name: "scalar/direct",
    about: "direct volume rendering, with ambient occlusion of each sample over the hemisphere down the gradient",
    source: "VAO §5.2.2, §5.2.3",
};

pub struct Direct(pub RayCast);

impl Direct {
    /// `beer`: values are densities (Eq. 5), else opacities (Eq. 7). `rejection`: Eq. 4.
    pub fn new(
        resources: &Resources<'_>,
        shared: &Shared,
        field: &ScalarField,
        settings: &MarchUniforms,
        beer: bool,
        rejection: bool,
    ) -> Result<Self, GpuError> {
        let defs = [("BEER", beer), ("REJECTION", rejection)];
        RayCast::new(resources, shared, field, INFO.name, &defs, false, settings).map(Self)
    }
}

impl Stage for Direct {
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
