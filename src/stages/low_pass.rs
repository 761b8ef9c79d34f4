//! What `caustics/filter` and `godrays/filter` are: a multi-tap low-pass with a kernel rotated per pixel. UW §3.5.

use super::frame::Shared;
use super::kit::{self, Bind, Group, RenderSpec, Resources, ScreenPass};
use super::{Column, Output, Stage, StageInfo};
use crate::shader_struct;
use fathom_gpu::{GpuError, StageScope};
use fathom_record::Work;

shader_struct! {
    /// `Filter` in `shaders/godrays/filter.wgsl`.
    pub struct FilterUniforms {
        pub taps: u32,
        pub radius_px: f32,
    }
}

shader_struct! {
    /// `Filter` in `shaders/caustics/filter.wgsl`.
    pub struct GuidedUniforms {
        pub taps: u32,
        pub radius_px: f32,
        pub depth_share: f32,
    }
}

pub struct LowPass {
    info: &'static StageInfo,
    pass: ScreenPass,
    /// Texels that a pixel reads.
    fetches: u64,
    /// Of a pixel, at least.
    least_fetches: u64,
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
        let pass = screen_pass(resources, info, &[&group], source)?;
        let fetches = u64::from(settings.taps);
        Ok(Self { info, pass, fetches, least_fetches: fetches, column })
    }

    /// The same, guided by the camera's depth: taps on another surface than the pixel's do not count.
    pub fn guided(
        resources: &Resources<'_>,
        info: &'static StageInfo,
        (source, column): (&wgpu::Texture, Column),
        (shared, depth): (&Shared, &wgpu::Texture),
        settings: &GuidedUniforms,
    ) -> Result<Self, GpuError> {
        let settings_buffer = resources.loop_settings(info.name, settings);
        let binds = [Bind::Read(&settings_buffer), Bind::Texels(source), Bind::Depth(depth)];
        let group = Group::new(resources.gpu, info.name, &binds);
        let pass = screen_pass(resources, info, &[&shared.group, &group], source)?;
        // The pixel's depth and its four neighbours'; depth and light at each tap, but no light on another surface.
        let taps = u64::from(settings.taps);
        Ok(Self { info, pass, fetches: 5 + 2 * taps, least_fetches: 5 + taps, column })
    }

    pub fn texture(&self) -> &wgpu::Texture {
        self.pass.texture()
    }
}

/// A pass over a target of the source's size and format.
fn screen_pass(
    resources: &Resources<'_>,
    info: &'static StageInfo,
    groups: &[&Group],
    source: &wgpu::Texture,
) -> Result<ScreenPass, GpuError> {
    let targets = [kit::opaque(source.format())];
    let spec = RenderSpec::new(info.name, info.name, groups, &targets);
    let size_px = [source.width(), source.height()];
    ScreenPass::new(resources, &spec, size_px, wgpu::Color::BLACK)
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
            texel_fetches: pixels * self.fetches,
            bytes_written: pixels * 4,
            ..Work::default()
        }
    }

    fn least_work(&self) -> Work {
        Work { texel_fetches: self.pass.pixels() * self.least_fetches, ..self.work() }
    }

    fn outputs(&self) -> Vec<Output> {
        let meaning = "what the photons add up to, averaged over the low-pass's disc";
        vec![Output::texture("filtered", meaning, vec![self.column.clone()], self.texture())]
    }
}
