//! The pass that `water/reflection` and `water/refraction` share: the scene lit without photons.

use super::frame::Shared;
use super::geometry::Geometry;
use super::kit::{self, Bind, Group, RenderSpec, Resources};
use super::{Column, Output, OutputData};
use crate::gpu::{ColorTarget, DepthTarget, GpuError, StageScope, Targets};
use crate::record::Work;

const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;

pub struct LitScene {
    pipeline: wgpu::RenderPipeline,
    shared: wgpu::BindGroup,
    group: Group,
    geometry: Geometry,
    pub color: wgpu::Texture,
    color_view: wgpu::TextureView,
    depth_view: wgpu::TextureView,
}

impl LitScene {
    /// `name` is the stage's, and names its shader.
    pub fn new(
        resources: &Resources<'_>,
        shared: &Shared,
        geometry: &Geometry,
        name: &'static str,
        size_px: [u32; 2],
    ) -> Result<Self, GpuError> {
        let gpu = resources.gpu;
        let shader = gpu.shader(name, &[])?;
        let group = Group::new(gpu, name, &[Bind::Read(&geometry.materials)]);
        let pipeline = kit::render_pipeline(
            gpu,
            &RenderSpec {
                label: name,
                shader: &shader,
                vertex: "vertex",
                fragment: Some("fragment"),
                groups: &[&shared.group, &group],
                buffers: &[Geometry::layout(false)],
                targets: &[kit::opaque(FORMAT)],
                depth: Some(kit::depth_state(wgpu::CompareFunction::Less, true)),
            },
        );
        let color = resources.target(name, size_px, FORMAT);
        let depth = resources.target(name, size_px, kit::DEPTH_FORMAT);
        Ok(Self {
            pipeline,
            shared: shared.group.group.clone(),
            group,
            geometry: geometry.clone(),
            color_view: kit::view(&color),
            depth_view: kit::view(&depth),
            color,
        })
    }

    pub fn encode(&self, scope: &mut StageScope<'_>) {
        let targets = Targets {
            color: &[ColorTarget {
                view: &self.color_view,
                clear: Some(wgpu::Color::TRANSPARENT),
                slice: None,
            }],
            depth: Some(DepthTarget { view: &self.depth_view, clear: Some(1.0), read_only: false }),
        };
        scope.render(&targets, |pass| {
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, &self.shared, &[]);
            pass.set_bind_group(1, &self.group.group, &[]);
            self.geometry.draw(pass);
        });
    }

    pub fn work(&self) -> Work {
        let pixels = u64::from(self.color.width()) * u64::from(self.color.height());
        Work {
            triangles: self.geometry.triangles(),
            bytes_read: self.geometry.bytes(),
            bytes_written: pixels * (8 + 4),
            ..Work::default()
        }
    }

    pub fn outputs(&self, meaning: &str) -> Vec<Output> {
        let column = |name| Column { name, unit: "W/(m² sr)", meaning: "radiance" };
        vec![Output {
            name: "radiance".into(),
            meaning: meaning.into(),
            columns: vec![
                column("red"),
                column("green"),
                column("blue"),
                Column { name: "covered", unit: "1", meaning: "1 where geometry was drawn" },
            ],
            data: OutputData::Texture(self.color.clone()),
        }]
    }
}
