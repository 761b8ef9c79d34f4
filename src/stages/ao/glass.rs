//! `ao/glass`: transparent objects over the composed picture. VAO §5.2.2, Fig. 6.

use std::ops::Range;

use crate::geometry::Geometry;
use crate::prelude::*;
use crate::uniforms::View;
use fathom_scene::Scene;

pub const INFO: StageInfo = StageInfo {
    name: "ao/glass",
    about: "transparent objects over the composed picture, back to front, by their opacities",
    source: "VAO §5.2.2, Fig. 6",
};

shader_struct! {
    pub struct GlassUniforms {
        pub exposure: f32,
        /// Irradiance of the ambient light over that of the direct light.
        pub ambient: f32,
    }
}

/// Back faces, then front faces.
const FACINGS: Range<u32> = 0..2;

/// Parts of the transparent objects in the order in which they are drawn: by the distance of their middles from the viewer.
fn farthest_first(scene: &Scene, parts: &[Range<u32>], view: &View) -> Vec<Range<u32>> {
    let eye = view.camera.position();
    let mut groups: Vec<(f64, Range<u32>)> = scene
        .objects
        .iter()
        .zip(parts)
        .filter(|(object, _)| !object.material.is_opaque())
        .map(|(object, part)| (object.mesh.bounds().center().distance(eye), part.clone()))
        .collect();
    groups.sort_by(|a, b| b.0.total_cmp(&a.0));
    groups.into_iter().map(|(_, part)| part).collect()
}

/// Draws over `picture` what `depth`, the camera's, does not hide. None where nothing is transparent.
///
/// # Errors
/// What the GPU reports.
pub fn new(
    resources: &Resources<'_>,
    (shared, view): (&Shared, &View),
    (scene, geometry): (&Scene, &Geometry),
    (picture, depth): (&wgpu::Texture, &wgpu::Texture),
    settings: &GlassUniforms,
) -> Result<Option<Stage>, GpuError> {
    let parts = farthest_first(scene, &geometry.objects, view);
    if parts.is_empty() {
        return Ok(None);
    }
    let uniforms = resources.uniform(INFO.name, settings);
    let groups = [&shared.group, &Bindings::new(&[&geometry.materials, &uniforms])];
    // The picture's own opacity stays 1.
    let targets = [wgpu::ColorTargetState {
        format: picture.format(),
        blend: Some(wgpu::BlendState::ALPHA_BLENDING),
        write_mask: wgpu::ColorWrites::COLOR,
    }];
    let spec = RenderSpec {
        buffers: &[Geometry::layout(false)],
        depth: Some(Depth::behind(depth)),
        ..RenderSpec::new(INFO.name, &groups, &targets)
    };
    let pass = DrawPass::onto(resources, &spec, picture)?;
    // Every transparent triangle once for each facing; the fragments depend on the view.
    let indices: u64 = parts.iter().map(|part| part.len() as u64).sum();
    let work = Work { triangles: indices / 3 * FACINGS.len() as u64, ..Work::default() };
    let geometry = geometry.clone();
    let stage = pass.drawing(&INFO, work, move |pass| {
        for part in &parts {
            geometry.draw_instances(pass, part.clone(), FACINGS);
        }
    });
    Ok(Some(stage.image().with_output(())))
}
