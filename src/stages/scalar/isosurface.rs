//! `scalar/isosurface`: the first isosurface on each view ray, with ambient occlusion. VAO §5.2.1.

use crate::gpu::GpuError;
use crate::stages::StageInfo;
use crate::stages::frame::Shared;
use crate::stages::kit::Resources;
use crate::stages::ray_cast::{CastUniforms, RayCast};
use crate::stages::scalar_field::ScalarField;

pub const INFO: StageInfo = StageInfo {
    name: "scalar/isosurface",
    about: "first isosurface of a scalar field on each view ray, with ambient occlusion by marching the field",
    source: "VAO §5.2.1",
};

/// `at_isosurface`: rays stop at |V − iso| < tolerance, else at V ≥ threshold. `linear`: ρ = 1 − d / r_max, else 1.
pub fn new(
    resources: &Resources<'_>,
    through: (&Shared, &ScalarField),
    settings: &CastUniforms,
    at_isosurface: bool,
    linear: bool,
) -> Result<RayCast, GpuError> {
    let defs = [("AT_ISOSURFACE", at_isosurface), ("LINEAR", linear)];
    RayCast::new(resources, &INFO, through, &defs, true, settings)
}
