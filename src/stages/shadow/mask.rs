//! `shadow/mask`: the water surface as the light sees it first. UW §3 step 2b.

use encase::ShaderType;

use crate::gpu::{ColorTarget, DepthTarget, GpuError, StageScope, Targets};
use crate::record::Work;
use crate::stages::frame::Shared;
use crate::stages::kit::{self, Bind, Group, RenderSpec, Resources};
use crate::stages::{Column, Output, OutputData, Stage, StageInfo};

pub const INFO: StageInfo = StageInfo {
    name: "shadow/mask",
    about: "water surface visible from the light; photons that land elsewhere are dropped",
    source: "UW §3 step 2b",
};

/// Host twin of `Mask` in `shaders/shadow/mask.wgsl`.
#[derive(Clone, Debug, ShaderType)]
pub struct MaskUniforms {
    pub cells: u32,
}

pub struct Mask {
    pipeline: wgpu::RenderPipeline,
    shared: wgpu::BindGroup,
    group: Group,
    cells: u32,
    mask: wgpu::Texture,
    view: wgpu::TextureView,
    depth_view: wgpu::TextureView,
}

impl Mask {
    /// `depth` is the light's depth; the water is a grid of `cells`² quads.
    pub fn new(
        resources: &Resources<'_>,
        shared: &Shared,
        depth: &wgpu::Texture,
        cells: u32,
    ) -> Result<Self, GpuError> {
        let gpu = resources.gpu;
        let shader = gpu.shader(INFO.name, &[shared.water_def()])?;
        let settings = resources.uniform(INFO.name, &MaskUniforms { cells });
        let group = Group::new(gpu, INFO.name, &[Bind::Uniform(&settings)]);
        let format = wgpu::TextureFormat::R8Unorm;
        let pipeline = kit::render_pipeline(
            gpu,
            &RenderSpec {
                label: INFO.name,
                shader: &shader,
                vertex: "vertex",
                fragment: Some("fragment"),
                groups: &[&shared.group, &group],
                buffers: &[],
                targets: &[kit::opaque(format)],
                depth: Some(kit::depth_state(wgpu::CompareFunction::Less, false)),
            },
        );
        let mask = resources.target(INFO.name, [depth.width(), depth.height()], format);
        Ok(Self {
            pipeline,
            shared: shared.group.group.clone(),
            group,
            cells,
            view: kit::view(&mask),
            depth_view: kit::view(depth),
            mask,
        })
    }

    pub fn texture(&self) -> &wgpu::Texture {
        &self.mask
    }
}

impl Stage for Mask {
    fn name(&self) -> &'static str {
        INFO.name
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        let targets = Targets {
            color: &[ColorTarget {
                view: &self.view,
                clear: Some(wgpu::Color::BLACK),
                slice: None,
            }],
            depth: Some(DepthTarget { view: &self.depth_view, clear: None, read_only: true }),
        };
        scope.render(&targets, |pass| {
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, &self.shared, &[]);
            pass.set_bind_group(1, &self.group.group, &[]);
            pass.draw(0..self.cells * self.cells * 6, 0..1);
        });
    }

    fn work(&self) -> Work {
        let texels = u64::from(self.mask.width()) * u64::from(self.mask.height());
        Work {
            triangles: u64::from(self.cells) * u64::from(self.cells) * 2,
            bytes_read: texels * 4,
            bytes_written: texels,
            ..Work::default()
        }
    }

    fn outputs(&self) -> Vec<Output> {
        vec![Output {
            name: "mask".into(),
            meaning: "1 where the light meets the water first; row 0 is ndc y = +1 of the light"
                .into(),
            columns: vec![Column { name: "water", unit: "1", meaning: "1 water, 0 other" }],
            data: OutputData::Texture(self.mask.clone()),
        }]
    }
}
