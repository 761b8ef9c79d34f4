//! `sprites/compose`: the picture, lit by sprites and sky.

use crate::gbuffer::GBuffer;
use crate::picture::{Picture, Shafts};
use crate::prelude::*;

pub const INFO: StageInfo = StageInfo {
    name: "sprites/compose",
    about: "the picture: what the camera sees, lit by sprites and sky",
    source: "SPT §3",
};

/// What is made of the light.
pub enum SpriteOutput<'a> {
    /// A picture, with the water between the camera and what it sees.
    Picture { shafts: Option<Shafts<'a>>, exposure: f64 },
    /// The radiance of what the camera sees, without the water, W/(m² sr).
    Dry,
}

pub fn new(
    resources: &Resources<'_>,
    shared: &Shared,
    gbuffer: &GBuffer,
    irradiance: &wgpu::Texture,
    composed: &SpriteOutput<'_>,
) -> Result<Stage<wgpu::Texture>, GpuError> {
    let display = Picture::new(gbuffer, 0.0, 0.0);
    let (shafts, picture) = match composed {
        SpriteOutput::Picture { shafts, exposure } => {
            let scale = shafts.map_or(0.0, |shafts| shafts.scale);
            (*shafts, Picture { exposure: *exposure, scale, ..display })
        }
        SpriteOutput::Dry => {
            (None, Picture { format: wgpu::TextureFormat::Rgba16Float, ..display })
        }
    };
    let dry = i32::from(matches!(composed, SpriteOutput::Dry));
    let defs = [("DRY", dry), ("SHAFTS", i32::from(shafts.is_some()))];
    let mut own: Vec<&dyn Bind> = vec![irradiance];
    own.extend(shafts.map(|shafts| shafts.flux as &dyn Bind));
    Ok(picture.stage(resources, shared, &INFO, &defs, &own, [4, 1])?.image())
}
