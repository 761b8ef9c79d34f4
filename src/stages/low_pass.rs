//! The pass that `caustics/filter` and `godrays/filter` share.

use encase::ShaderType;

use super::kit::{self, Bind, Group, RenderSpec, Resources};
use super::{Column, Output, OutputData};
use crate::gpu::{ColorTarget, GpuError, StageScope, Targets};
use crate::record::Work;

/// Host twin of `Filter` in the filter shaders.
#[derive(Clone, Debug, PartialEq, ShaderType)]
pub struct FilterUniforms {
    pub taps: u32,
    pub radius_px: f32,
}

pub struct LowPass {
    pipeline: wgpu::RenderPipeline,
    group: Group,
    taps: u32,
    column: Column,
    pub target: wgpu::Texture,
    view: wgpu::TextureView,
}

impl LowPass {
    /// `name` is the stage's, and names its shader; the result has the size and format of the source, and holds what its
    /// column says.
    pub fn new(
        resources: &Resources<'_>,
        name: &'static str,
        source: (&wgpu::Texture, Column),
        settings: &FilterUniforms,
    ) -> Result<Self, GpuError> {
        let gpu = resources.gpu;
        let (source, column) = source;
        let shader = gpu.shader(name, &[])?;
        let settings_buffer = resources.loop_settings(name, settings);
        let binds = [Bind::Read(&settings_buffer), Bind::Texels(source)];
        let group = Group::new(gpu, name, &binds);
        let pipeline = kit::render_pipeline(
            gpu,
            &RenderSpec {
                label: name,
                shader: &shader,
                vertex: "vertex",
                fragment: Some("fragment"),
                groups: &[&group],
                buffers: &[],
                targets: &[kit::opaque(source.format())],
                depth: None,
            },
        );
        let target = resources.target(name, [source.width(), source.height()], source.format());
        Ok(Self { pipeline, group, taps: settings.taps, column, view: kit::view(&target), target })
    }

    pub fn encode(&self, scope: &mut StageScope<'_>) {
        let targets = Targets {
            color: &[ColorTarget {
                view: &self.view,
                clear: Some(wgpu::Color::BLACK),
                slice: None,
            }],
            depth: None,
        };
        scope.render(&targets, |pass| {
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, &self.group.group, &[]);
            pass.draw(0..3, 0..1);
        });
    }

    pub fn work(&self) -> Work {
        let pixels = u64::from(self.target.width()) * u64::from(self.target.height());
        Work {
            fragments: pixels,
            texel_fetches: pixels * u64::from(self.taps),
            bytes_written: pixels * 4,
            ..Work::default()
        }
    }

    pub fn outputs(&self) -> Vec<Output> {
        vec![Output {
            name: "filtered".into(),
            meaning: "what the photons add up to, averaged over the low-pass's disc".into(),
            columns: vec![self.column.clone()],
            data: OutputData::Texture(self.target.clone()),
        }]
    }
}
