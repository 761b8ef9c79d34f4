//! `refraction/compose`: the picture, through glass by its exit rays. SPT §4.

use glam::DVec3;

use super::Exits;
use crate::gbuffer::GBuffer;
use crate::picture::Picture;
use crate::prelude::*;
use crate::screen_ray::{WalkUniforms, walk_iterations, walk_without_layers};
use fathom_scene::Bounds;

pub const INFO: StageInfo = StageInfo {
    name: "refraction/compose",
    about: "the picture: the environment, what stands in it, and what is seen of it through glass",
    source: "SPT §4",
};

/// Fewest steps of a ray: a straight one stays in its pixel.
const MIN_STEPS: u32 = 8;
/// Depths that a step reads: its pixel's and those around it.
const FETCHES: u64 = 5;

/// `opaque` are the bounds of what the G-buffer shows, none where that is nothing.
pub fn new(
    resources: &Resources<'_>,
    shared: &Shared,
    gbuffer: &GBuffer,
    exits: &Exits,
    opaque: Option<Bounds>,
    exposure: f64,
) -> Result<Stage<wgpu::Texture>, GpuError> {
    let size_px = kit::size_px(&gbuffer.depth);
    let bounds = opaque.unwrap_or(Bounds::from_points([DVec3::ZERO]));
    let mut walk = walk_without_layers(size_px, bounds, MIN_STEPS);
    if opaque.is_none() {
        walk = WalkUniforms { min_steps: 0, max_steps: 0, ..walk };
    }
    resources.iterations("view", 2 * walk_iterations(walk.max_steps, 0));
    let steps = 2 * u64::from(walk.max_steps);
    let walk = resources.uniform(INFO.name, &walk);
    let rays: [&dyn Bind; 3] = [&exits.positions, &exits.directions, &walk];
    let texels = [5 + FETCHES * steps, 1];
    let picture = Picture::new(gbuffer, exposure, 0.0);
    Ok(picture.stage(resources, shared, &INFO, &[], &rays, texels)?.image())
}
