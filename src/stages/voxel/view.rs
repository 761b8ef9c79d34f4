//! `voxel/view`: full voxels as cubes, seen from the camera. VAO Fig. 2.

use crate::gpu::{ColorTarget, DepthTarget, GpuError, StageScope, Targets};
use crate::record::Work;
use crate::stages::frame::Shared;
use crate::stages::kit::{self, Bind, Group, RenderSpec, Resources};
use crate::stages::voxels::Voxels;
use crate::stages::{Column, Output, OutputData, Stage, StageInfo};

pub const INFO: StageInfo = StageInfo {
    name: "voxel/view",
    about: "full voxels as cubes, a ray a pixel; draws the picture and is no part of a frame",
    source: "VAO Fig. 2",
};

const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;
const BACKGROUND: wgpu::Color = wgpu::Color { r: 0.93, g: 0.94, b: 0.96, a: 1.0 };

pub struct CubeView {
    pipeline: wgpu::RenderPipeline,
    shared: wgpu::BindGroup,
    groups: Vec<Group>,
    color: wgpu::Texture,
    depth: wgpu::Texture,
    views: [wgpu::TextureView; 2],
}

impl CubeView {
    pub fn new(
        resources: &Resources<'_>,
        shared: &Shared,
        volumes: &[Voxels],
        size_px: [u32; 2],
    ) -> Result<Self, GpuError> {
        let gpu = resources.gpu;
        let shader = gpu.shader(INFO.name, &[])?;
        let group = |voxels: &Voxels| {
            let binds = [Bind::Uniform(&voxels.uniforms), Bind::Read(&voxels.bits)];
            Group::new(gpu, INFO.name, &binds)
        };
        let groups: Vec<Group> = volumes.iter().map(group).collect();
        let layout: Vec<&Group> = [&shared.group].into_iter().chain(groups.first()).collect();
        let pipeline = kit::render_pipeline(
            gpu,
            &RenderSpec {
                label: INFO.name,
                shader: &shader,
                vertex: "vertex",
                fragment: Some("fragment"),
                groups: &layout,
                buffers: &[],
                targets: &[kit::opaque(FORMAT)],
                depth: Some(kit::depth_state(wgpu::CompareFunction::Less, true)),
            },
        );
        let color = resources.target(INFO.name, size_px, FORMAT);
        let depth = resources.target(INFO.name, size_px, kit::DEPTH_FORMAT);
        Ok(Self {
            pipeline,
            shared: shared.group.group.clone(),
            groups,
            views: [kit::view(&color), kit::view(&depth)],
            color,
            depth,
        })
    }

    pub fn texture(&self) -> &wgpu::Texture {
        &self.color
    }

    pub fn depth(&self) -> &wgpu::Texture {
        &self.depth
    }
}

impl Stage for CubeView {
    fn name(&self) -> &'static str {
        INFO.name
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        let [color, depth] = &self.views;
        let targets = Targets {
            color: &[ColorTarget { view: color, clear: Some(BACKGROUND), slice: None }],
            depth: Some(DepthTarget { view: depth, clear: Some(1.0), read_only: false }),
        };
        scope.render(&targets, |pass| {
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, &self.shared, &[]);
            for group in &self.groups {
                pass.set_bind_group(1, &group.group, &[]);
                pass.draw(0..3, 0..1);
            }
        });
    }

    fn work(&self) -> Work {
        let pixels = u64::from(self.color.width()) * u64::from(self.color.height());
        Work {
            fragments: pixels * self.groups.len() as u64,
            bytes_written: pixels * 8,
            ..Work::default()
        }
    }

    fn outputs(&self) -> Vec<Output> {
        let channels = ["red", "green", "blue", "alpha"].map(|name| Column {
            name,
            unit: "1",
            meaning: "display value",
        });
        vec![Output {
            name: "cubes".into(),
            meaning: "the voxels as cubes".into(),
            columns: channels.into(),
            data: OutputData::Texture(self.color.clone()),
        }]
    }
}
