//! `scalar/direct`: direct volume rendering with ambient occlusion over the hemisphere down the gradient. VAO §5.2.2.

use crate::prelude::*;
use crate::ray_cast::{self, Cast, CastUniforms};
use crate::scalar_field::ScalarField;

pub const INFO: StageInfo = StageInfo {
    name: "scalar/direct",
    about: "direct volume rendering, with ambient occlusion of each sample over the hemisphere down the gradient",
    source: "VAO §5.2.2, §5.2.3",
};

/// `beer`: values are densities (Eq. 5), else opacities (Eq. 7). `rejection`: Eq. 4.
pub fn new(
    resources: &Resources<'_>,
    shared: &Shared,
    field: &ScalarField,
    settings: &CastUniforms,
    beer: bool,
    rejection: bool,
) -> Result<Stage<Cast>, GpuError> {
    let defs = [("BEER", beer), ("REJECTION", rejection)];
    ray_cast::new(resources, &INFO, shared, field, &defs, false, settings)
}
