//! `ao/compose`: deferred direct light with shadows, and ambient light times visibility. VAO §6.

use crate::picture::Picture;
use crate::prelude::*;

pub const INFO: StageInfo = StageInfo {
    name: "ao/compose",
    about: "deferred direct light with shadows, and ambient light times visibility",
    source: "VAO §6",
};

pub struct LitInputs<'a> {
    /// Its scale: irradiance of the ambient light over that of the direct light.
    pub picture: Picture<'a>,
    /// 1 − A, at any size.
    pub visibility: &'a wgpu::Texture,
    /// The light's depth.
    pub shadow: &'a wgpu::Texture,
}

/// With `shows_occlusion` the picture is the visibility itself, as it is.
pub fn new(
    resources: &Resources<'_>,
    shared: &Shared,
    lit: &LitInputs<'_>,
    shows_occlusion: bool,
) -> Result<Stage<wgpu::Texture>, GpuError> {
    let LitInputs { picture, visibility, shadow } = lit;
    let defs = [("SHOW_OCCLUSION", i32::from(shows_occlusion))];
    // Visibility and depth; and for the picture albedo, normal and four texels of the shadow map. The background has no colour, and
    // surfaces that face away from the light ask no shadow map.
    let texels = [if shows_occlusion { 2 } else { 8 }, 2];
    let own: [&dyn Bind; 2] = [*visibility, *shadow];
    let stage = picture.stage(resources, shared, &INFO, &defs, &own, texels)?;
    let meaning = if shows_occlusion { "visibility" } else { "display value, gamma 2.2" };
    Ok(stage.dump_as("image", "the final image", Column::display(meaning)))
}
