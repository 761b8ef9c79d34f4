//! `scalar/isosurface`: the first isosurface on each view ray, with ambient occlusion. VAO §5.2.1.

use crate::prelude::*;
use crate::ray_cast::{self, Cast, CastUniforms};
use crate::scalar_field::ScalarField;

pub const INFO: StageInfo = StageInfo {
    name: "scalar/isosurface",
    about: "first isosurface of a scalar field on each view ray, with ambient occlusion by marching the field",
    source: "VAO §5.2.1, §5.2.3",
};

/// How rays from the surface end and what they gather.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RayRules {
    /// They stop at |V − iso| < tolerance, else at V ≥ threshold.
    pub at_isosurface: bool,
    /// ρ = 1 − d / r_max, else 1.
    pub linear: bool,
    /// They gather γ of Eq. 7, else ρ where they end.
    pub opacity: bool,
    /// Samples of falling value do not count (Eq. 4).
    pub rejection: bool,
}

pub fn new(
    resources: &Resources<'_>,
    shared: &Shared,
    field: &ScalarField,
    settings: &CastUniforms,
    rays: RayRules,
) -> Result<Stage<Cast>, GpuError> {
    let defs = [
        ("AT_ISOSURFACE", rays.at_isosurface),
        ("LINEAR", rays.linear),
        ("OPACITY", rays.opacity),
        ("REJECTION", rays.rejection),
    ];
    ray_cast::new(resources, &INFO, shared, field, &defs, true, settings)
}
