//! `scalar/isosurface`: the first isosurface on each view ray, with ambient occlusion. VAO §5.2.1.

use crate::gpu::{GpuError, StageScope};
use crate::record::Work;
use crate::stages::frame::Shared;
use crate::stages::kit::Resources;
use crate::stages::ray_cast::{MarchUniforms, RayCast};
use crate::stages::scalar_field::ScalarField;
use crate::stages::{Output, Stage, StageInfo};

pub const INFO: StageInfo = StageInfo {
    name: "scalar/isosurface",
    about: "first isosurface of a scalar field on each view ray, with ambient occlusion by marching the field",
    source: "VAO §5.2.1",
};

pub struct Isosurface(pub RayCast);

impl Isosurface {
    /// `at_isosurface`: rays stop at |V − iso| < tolerance, else at V ≥ threshold. `linear`: ρ = 1 − d / r_max, else 1.
    pub fn new(
        resources: &Resources<'_>,
        shared: &Shared,
        field: &ScalarField,
        settings: &MarchUniforms,
        at_isosurface: bool,
        linear: bool,
    ) -> Result<Self, GpuError> {
        let defs = [("AT_ISOSURFACE", at_isosurface), ("LINEAR", linear)];
        RayCast::new(resources, shared, field, INFO.name, &defs, true, settings).map(Self)
    }
}

impl Stage for Isosurface {
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
