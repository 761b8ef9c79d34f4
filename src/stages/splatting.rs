//! What the additive stages share: quads pulled from the photon buffer, drawn over the camera's depth.

use super::frame::Shared;
use super::kit::{self, Bind, Group, RenderSpec, Resources};
use super::photon::Photons;
use super::{Column, Output, OutputData};
use crate::gpu::{ColorTarget, DepthTarget, GpuError, StageScope, Targets};

/// Photons drawn by one instance of the index pattern: 16,384 vertices, so that 16-bit indices do, and few instances
/// even for millions of photons.
pub const PHOTONS_PER_INSTANCE: u32 = 4096;

pub struct Additive {
    depth_pipeline: wgpu::RenderPipeline,
    pipeline: wgpu::RenderPipeline,
    shared: wgpu::BindGroup,
    group: Group,
    indices: wgpu::Buffer,
    photons: u32,
    pub target: wgpu::Texture,
    target_view: wgpu::TextureView,
    depth_view: wgpu::TextureView,
}

impl Additive {
    /// `name` is the stage's, and names its shader, compiled with `defs`; the target has `size_px` pixels.
    pub fn new(
        resources: &Resources<'_>,
        shared: &Shared,
        name: &'static str,
        defs: &[(&str, i32)],
        uniforms: &wgpu::Buffer,
        (photons, scene_depth): (&Photons, &wgpu::Texture),
        size_px: [u32; 2],
    ) -> Result<Self, GpuError> {
        let gpu = resources.gpu;
        let shader = gpu.shader(name, defs)?;
        let binds =
            [Bind::Uniform(uniforms), Bind::Read(&photons.buffer), Bind::Depth(scene_depth)];
        let group = Group::new(gpu, name, &binds);
        let format = kit::accumulation_format(gpu);
        let target = resources.target(name, size_px, format);
        let depth = resources.target(name, size_px, kit::DEPTH_FORMAT);
        let spec = RenderSpec {
            label: name,
            shader: &shader,
            vertex: "vertex",
            fragment: Some("fragment"),
            groups: &[&shared.group, &group],
            buffers: &[],
            targets: &[kit::additive(format)],
            depth: Some(kit::depth_state(wgpu::CompareFunction::LessEqual, false)),
        };
        let pipeline = kit::render_pipeline(gpu, &spec);
        let unwritten = wgpu::ColorTargetState {
            write_mask: wgpu::ColorWrites::empty(),
            ..kit::opaque(format)
        };
        let depth_pipeline = kit::render_pipeline(
            gpu,
            &RenderSpec {
                vertex: "depth_vertex",
                fragment: Some("depth_fragment"),
                targets: &[unwritten],
                depth: Some(kit::depth_state(wgpu::CompareFunction::Always, true)),
                ..spec
            },
        );
        Ok(Self {
            depth_pipeline,
            pipeline,
            shared: shared.group.group.clone(),
            group,
            indices: index_pattern(resources),
            photons: photons.count,
            target_view: kit::view(&target),
            depth_view: kit::view(&depth),
            target,
        })
    }

    pub fn encode(&self, scope: &mut StageScope<'_>) {
        let targets = Targets {
            color: &[ColorTarget {
                view: &self.target_view,
                clear: Some(wgpu::Color::BLACK),
                slice: None,
            }],
            depth: Some(DepthTarget { view: &self.depth_view, clear: Some(1.0), read_only: false }),
        };
        scope.render(&targets, |pass| {
            pass.set_bind_group(0, &self.shared, &[]);
            pass.set_bind_group(1, &self.group.group, &[]);
            pass.set_pipeline(&self.depth_pipeline);
            pass.draw(0..3, 0..1);
            pass.set_pipeline(&self.pipeline);
            pass.set_index_buffer(self.indices.slice(..), wgpu::IndexFormat::Uint16);
            let instances = self.photons.div_ceil(PHOTONS_PER_INSTANCE);
            pass.draw_indexed(0..PHOTONS_PER_INSTANCE * 6, 0, 0..instances);
        });
    }

    pub fn pixels(&self) -> u64 {
        u64::from(self.target.width()) * u64::from(self.target.height())
    }

    /// `column` says what the sum is.
    pub fn outputs(&self, column: Column) -> Vec<Output> {
        vec![Output {
            name: "intensity".into(),
            meaning: "what the photons add up to, before the low-pass".into(),
            columns: vec![column],
            data: OutputData::Texture(self.target.clone()),
        }]
    }
}

/// Two triangles for each of [`PHOTONS_PER_INSTANCE`] quads.
fn index_pattern(resources: &Resources<'_>) -> wgpu::Buffer {
    let indices: Vec<u16> = (0..PHOTONS_PER_INSTANCE as u16)
        .flat_map(|quad| [0, 1, 2, 2, 1, 3].map(|corner| quad * 4 + corner))
        .collect();
    resources.filled("quad indices", bytemuck::cast_slice(&indices), wgpu::BufferUsages::INDEX)
}
