//! `ao/glass`: transparent objects over the composed picture. VAO §5.2.2, Fig. 6.

use std::ops::Range;

use crate::frame::{Shared, View};
use crate::geometry::Geometry;
use crate::kit::{self, Bind, Group, Raster, RenderSpec, Resources};
use crate::shader_struct;
use crate::{Column, Output, Stage, StageInfo};
use fathom_gpu::{ColorTarget, DepthTarget, GpuError, StageScope, Targets};
use fathom_record::Work;
use fathom_scene::Scene;

pub const INFO: StageInfo = StageInfo {
    name: "ao/glass",
    about: "transparent objects over the composed picture, back to front, by their opacities",
    source: "VAO §5.2.2, Fig. 6",
};

shader_struct! {
    /// `Glass` in `shaders/ao/glass.wgsl`.
    pub struct GlassUniforms {
        pub exposure: f32,
        pub ambient: f32,
    }
}

pub struct Glass {
    raster: Raster,
    groups: Vec<wgpu::BindGroup>,
    geometry: Geometry,
    /// Of the transparent objects, the farthest first.
    parts: Vec<Range<u32>>,
    picture: wgpu::Texture,
    color: wgpu::TextureView,
    depth: wgpu::TextureView,
}

/// Back faces, then front faces.
const FACINGS: Range<u32> = 0..2;

/// Parts of the transparent objects in the order in which they are drawn: by the distance of their middles from the viewer.
fn farthest_first(scene: &Scene, parts: &[Range<u32>], view: &View) -> Vec<Range<u32>> {
    let eye = view.camera.position();
    let mut found: Vec<(f64, Range<u32>)> = scene
        .objects
        .iter()
        .zip(parts)
        .filter(|(object, _)| !object.material.is_opaque())
        .map(|(object, part)| (object.mesh.bounds().center().distance(eye), part.clone()))
        .collect();
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    found.into_iter().map(|(_, part)| part).collect()
}

impl Glass {
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
    ) -> Result<Option<Self>, GpuError> {
        let parts = farthest_first(scene, &geometry.objects, view);
        if parts.is_empty() {
            return Ok(None);
        }
        let uniforms = resources.uniform(INFO.name, settings);
        let binds = [Bind::Read(&geometry.materials), Bind::Uniform(&uniforms)];
        let group = Group::new(resources.gpu, INFO.name, &binds);
        let groups = [&shared.group, &group];
        // The picture's own opacity stays 1.
        let targets = [wgpu::ColorTargetState {
            format: picture.format(),
            blend: Some(wgpu::BlendState::ALPHA_BLENDING),
            write_mask: wgpu::ColorWrites::COLOR,
        }];
        let spec = RenderSpec {
            buffers: &[Geometry::layout(false)],
            depth: Some(kit::depth_state(wgpu::CompareFunction::Less, false)),
            ..RenderSpec::new(INFO.name, INFO.name, &groups, &targets)
        };
        Ok(Some(Self {
            raster: Raster::new(resources, &spec)?,
            groups: kit::bare(&groups),
            geometry: geometry.clone(),
            parts,
            color: kit::view(picture),
            depth: kit::view(depth),
            picture: picture.clone(),
        }))
    }
}

impl Stage for Glass {
    fn info(&self) -> &'static StageInfo {
        &INFO
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        let color = [ColorTarget { view: &self.color, clear: None, slice: None }];
        let depth = DepthTarget { view: &self.depth, clear: None, read_only: true };
        scope.render(&Targets { color: &color, depth: Some(depth) }, |pass| {
            self.raster.bind(pass);
            kit::bind_groups(pass, &self.groups);
            for part in &self.parts {
                self.geometry.draw_instances(pass, part.clone(), FACINGS);
            }
        });
    }

    /// Every transparent triangle once for each facing; the fragments depend on the view.
    fn work(&self) -> Work {
        let indices: u64 = self.parts.iter().map(|part| part.len() as u64).sum();
        Work { triangles: indices / 3 * FACINGS.len() as u64, ..Work::default() }
    }

    fn outputs(&self) -> Vec<Output> {
        let columns = Column::display("display value, gamma 2.2");
        vec![Output::texture("image", "the final image", columns, &self.picture)]
    }
}
