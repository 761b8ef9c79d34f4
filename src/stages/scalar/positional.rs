//! `scalar/positional`: participating media with positional ambient occlusion. VAO §5.2.4.

use crate::prelude::*;
use crate::ray_cast::{self, Cast, CastUniforms};
use crate::scalar_field::ScalarField;

pub const INFO: StageInfo = StageInfo {
    name: "scalar/positional",
    about: "participating media, with positional ambient occlusion of each sample over the whole sphere",
    source: "VAO §5.2.4",
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
