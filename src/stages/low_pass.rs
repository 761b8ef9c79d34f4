//! What `caustics/filter` and `godrays/filter` are: a multi-tap low-pass with a kernel rotated per pixel. UW §3.5.

use super::kit::{self, Bind, Group, RenderSpec, Resources, ScreenPass};
use super::{Column, Output, Stage, StageInfo};
use crate::gpu::{GpuError, StageScope};
use crate::record::Work;
use crate::shader_struct;

shader_struct! {
    /// `Filter` in the filter shaders.
    pub struct FilterUniforms {
        pub taps: u32,
        pub radius_px: f32,
    }
}

pub struct LowPass {
    info: &'static StageInfo,
    pass: ScreenPass,
    taps: u32,
    column: Column,
}

impl LowPass {
    /// The stage `info`. The result has the size and format of the source, and holds what its column says.
    pub fn new(
        resources: &Resources<'_>,
        info: &'static StageInfo,
        (source, column): (&wgpu::Texture, Column),
        settings: &FilterUniforms,
    ) -> Result<Self, GpuError> {
        let settings_buffer = resources.loop_settings(info.name, settings);
        let binds = [Bind::Read(&settings_buffer), Bind::Texels(source)];
        let group = Group::new(resources.gpu, info.name, &binds);
        let (groups, targets) = ([&group], [kit::opaque(source.format())]);
        let spec = RenderSpec::new(info.name, info.name, &groups, &targets);
        let size_px = [source.width(), source.height()];
        let pass = ScreenPass::new(resources, &spec, size_px, wgpu::Color::BLACK)?;
        Ok(Self { info, pass, taps: settings.taps, column })
    }

    pub fn texture(&self) -> &wgpu::Texture {
        self.pass.texture()
    }
}

impl Stage for LowPass {
    fn info(&self) -> &'static StageInfo {
        self.info
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        self.pass.encode(scope);
    }

    fn work(&self) -> Work {
        let pixels = self.pass.pixels();
        Work {
            fragments: pixels,
            texel_fetches: pixels * u64::from(self.taps),
            bytes_written: pixels * 4,
            ..Work::default()
        }
    }

    fn outputs(&self) -> Vec<Output> {
        let meaning = "what the photons add up to, averaged over the low-pass's disc";
        vec![Output::texture("filtered", meaning, vec![self.column.clone()], self.texture())]
    }
}
