//! `shadow/depth`: scene depth from the light. UW §3 step 2a.

use crate::gpu::{DepthTarget, Gpu, GpuError, StageScope, Targets};
use crate::record::Work;
use crate::stages::frame::Shared;
use crate::stages::geometry::Geometry;
use crate::stages::kit::{self, RenderSpec, Resources};
use crate::stages::{Column, Output, OutputData, Stage, StageInfo};

pub const INFO: StageInfo = StageInfo {
    name: "shadow/depth",
    about: "scene depth from the light, for the image-space estimator",
    source: "UW §3 step 2a",
};

pub struct Depth {
    pipeline: wgpu::RenderPipeline,
    shared: wgpu::BindGroup,
    geometry: Geometry,
    depth: wgpu::Texture,
    view: wgpu::TextureView,
}

impl Depth {
    /// `size` texels per side.
    pub fn new(
        resources: &Resources<'_>,
        shared: &Shared,
        geometry: &Geometry,
        size: u32,
    ) -> Result<Self, GpuError> {
        let gpu: &Gpu = resources.gpu;
        let shader = gpu.shader(INFO.name, &[])?;
        let pipeline = kit::render_pipeline(
            gpu,
            &RenderSpec {
                label: INFO.name,
                shader: &shader,
                vertex: "vertex",
                fragment: None,
                groups: &[&shared.group],
                buffers: &[Geometry::layout(true)],
                targets: &[],
                depth: Some(kit::depth_state(wgpu::CompareFunction::Less, true)),
            },
        );
        let depth = resources.target(INFO.name, [size, size], kit::DEPTH_FORMAT);
        Ok(Self {
            pipeline,
            shared: shared.group.group.clone(),
            geometry: geometry.clone(),
            view: kit::view(&depth),
            depth,
        })
    }

    pub fn texture(&self) -> &wgpu::Texture {
        &self.depth
    }
}

impl Stage for Depth {
    fn name(&self) -> &'static str {
        INFO.name
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        let targets = Targets {
            color: &[],
            depth: Some(DepthTarget { view: &self.view, clear: Some(1.0), read_only: false }),
        };
        scope.render(&targets, |pass| {
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, &self.shared, &[]);
            self.geometry.draw(pass);
        });
    }

    fn work(&self) -> Work {
        let texels = u64::from(self.depth.width()) * u64::from(self.depth.height());
        Work {
            triangles: self.geometry.triangles(),
            bytes_read: self.geometry.bytes(),
            bytes_written: texels * 4,
            ..Work::default()
        }
    }

    fn outputs(&self) -> Vec<Output> {
        vec![Output {
            name: "depth".into(),
            meaning: "depth of the scene along the light, 0 near plane to 1 far plane; row 0 is ndc y = +1".into(),
            columns: vec![Column {
                name: "depth",
                unit: "1",
                meaning: "normalised device depth of the light",
            }],
            data: OutputData::Texture(self.depth.clone()),
        }]
    }
}
