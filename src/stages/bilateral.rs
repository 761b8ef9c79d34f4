//! The pass that `ao/bilateral` and `hsao/filter` share: joint bilateral filter and up-scaling. VAO §6.

use encase::ShaderType;
use glam::Vec2;

use super::frame::Shared;
use super::kit::{self, Bind, Group, RenderSpec, Resources};
use super::{Column, Output, OutputData};
use crate::gpu::{ColorTarget, GpuError, StageScope, Targets};
use crate::record::Work;

/// Format of ambient-occlusion buffers: visibility 1 − A, 1 where nothing was drawn.
pub const VISIBILITY_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::R16Float;

/// Host twin of `Filter` in `shaders/shared/bilateral.wgsl`.
#[derive(Clone, Debug, PartialEq, ShaderType)]
pub struct BilateralUniforms {
    pub size_px: Vec2,
    pub source_px: Vec2,
    pub pixel_tangent: f32,
    pub taps: u32,
    pub radius_px: f32,
    pub sigma_px: f32,
    pub depth_sigma: f32,
}

/// What is filtered, and what guides it.
pub struct Inputs<'a> {
    /// Visibility, at any size up to the viewport's. Each texel belongs to the depth texel behind its middle
    /// (`texel_behind` in `shaders/shared/screen.wgsl`).
    pub visibility: &'a wgpu::Texture,
    /// The camera's depth, at the viewport's size.
    pub depth: &'a wgpu::Texture,
}

pub struct Bilateral {
    pipeline: wgpu::RenderPipeline,
    shared: wgpu::BindGroup,
    group: Group,
    taps: u32,
    pub target: wgpu::Texture,
    view: wgpu::TextureView,
}

impl Bilateral {
    /// `name` is the stage's, and names its shader; the result has the size of the viewport.
    pub fn new(
        resources: &Resources<'_>,
        name: &'static str,
        shared: &Shared,
        inputs: &Inputs<'_>,
        settings: &BilateralUniforms,
    ) -> Result<Self, GpuError> {
        let gpu = resources.gpu;
        let shader = gpu.shader(name, &[])?;
        let settings_buffer = resources.loop_settings(name, settings);
        let binds = [
            Bind::Read(&settings_buffer),
            Bind::Texels(inputs.visibility),
            Bind::Depth(inputs.depth),
        ];
        let group = Group::new(gpu, name, &binds);
        let pipeline = kit::render_pipeline(
            gpu,
            &RenderSpec {
                label: name,
                shader: &shader,
                vertex: "vertex",
                fragment: Some("fragment"),
                groups: &[&shared.group, &group],
                buffers: &[],
                targets: &[kit::opaque(VISIBILITY_FORMAT)],
                depth: None,
            },
        );
        let size_px = [inputs.depth.width(), inputs.depth.height()];
        let target = resources.target(name, size_px, VISIBILITY_FORMAT);
        Ok(Self {
            pipeline,
            shared: shared.group.group.clone(),
            group,
            taps: settings.taps,
            view: kit::view(&target),
            target,
        })
    }

    pub fn encode(&self, scope: &mut StageScope<'_>) {
        let targets = Targets {
            color: &[ColorTarget {
                view: &self.view,
                clear: Some(wgpu::Color::WHITE),
                slice: None,
            }],
            depth: None,
        };
        scope.render(&targets, |pass| {
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, &self.shared, &[]);
            pass.set_bind_group(1, &self.group.group, &[]);
            pass.draw(0..3, 0..1);
        });
    }

    pub fn work(&self) -> Work {
        let pixels = u64::from(self.target.width()) * u64::from(self.target.height());
        Work {
            fragments: pixels,
            // The pixel's depth and its four neighbours'; depth and visibility at each tap.
            texel_fetches: pixels * (5 + 2 * u64::from(self.taps)),
            bytes_written: pixels * 2,
            ..Work::default()
        }
    }

    pub fn outputs(&self) -> Vec<Output> {
        vec![visibility_output("filtered", &self.target)]
    }
}

/// Describes a buffer of [`VISIBILITY_FORMAT`].
pub fn visibility_output(name: &str, texture: &wgpu::Texture) -> Output {
    Output {
        name: name.into(),
        meaning: "visibility 1 − A of VAO Eq. 1; 1 where nothing was drawn".into(),
        columns: vec![Column {
            name: "visibility",
            unit: "1",
            meaning: "share of the ambient light that arrives",
        }],
        data: OutputData::Texture(texture.clone()),
    }
}
