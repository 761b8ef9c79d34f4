//! What `ao/bilateral` and `hsao/filter` are: a joint bilateral filter and up-scaling. VAO §6.

use glam::Vec2;

use super::frame::Shared;
use super::kit::{self, Bind, Group, RenderSpec, Resources, ScreenPass};
use super::{Column, Output, OutputData, Stage, StageInfo};
use crate::shader_struct;
use fathom_gpu::{GpuError, StageScope};
use fathom_record::Work;

/// Format of ambient-occlusion buffers: visibility 1 − A, 1 where nothing was drawn.
pub const VISIBILITY_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::R16Float;

shader_struct! {
    /// `Filter` in `shaders/shared/bilateral.wgsl`.
    pub struct BilateralUniforms {
        pub size_px: Vec2,
        pub source_px: Vec2,
        pub pixel_tangent: f32,
        pub taps: u32,
        pub radius_px: f32,
        pub sigma_px: f32,
        pub depth_sigma: f32,
        pub normal_sigma: f32,
    }
}

pub struct Bilateral {
    info: &'static StageInfo,
    pass: ScreenPass,
    taps: u32,
}

impl Bilateral {
    /// The stage `info`. `visibility` has any size up to the viewport's; each of its texels belongs to the depth texel behind
    /// its middle (`texel_behind` in `shaders/shared/screen.wgsl`). The result has the size of the camera's depth and normals.
    pub fn new(
        resources: &Resources<'_>,
        info: &'static StageInfo,
        shared: &Shared,
        (visibility, depth, normal): (&wgpu::Texture, &wgpu::Texture, &wgpu::Texture),
        settings: &BilateralUniforms,
    ) -> Result<Self, GpuError> {
        let settings_buffer = resources.loop_settings(info.name, settings);
        let binds = [
            Bind::Read(&settings_buffer),
            Bind::Texels(visibility),
            Bind::Depth(depth),
            Bind::Texels(normal),
        ];
        let group = Group::new(resources.gpu, info.name, &binds);
        let (groups, targets) = ([&shared.group, &group], [kit::opaque(VISIBILITY_FORMAT)]);
        let spec = RenderSpec::new(info.name, info.name, &groups, &targets);
        let size_px = [depth.width(), depth.height()];
        let pass = ScreenPass::new(resources, &spec, size_px, wgpu::Color::WHITE)?;
        Ok(Self { info, pass, taps: settings.taps })
    }

    pub fn texture(&self) -> &wgpu::Texture {
        self.pass.texture()
    }
}

impl Stage for Bilateral {
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
            // The pixel's normal, its depth and its four neighbours'; depth, normal and visibility at each tap.
            texel_fetches: pixels * (6 + 3 * u64::from(self.taps)),
            bytes_written: pixels * 2,
            ..Work::default()
        }
    }

    /// The background is not filtered.
    fn least_work(&self) -> Work {
        Work { texel_fetches: self.pass.pixels(), ..self.work() }
    }

    fn outputs(&self) -> Vec<Output> {
        vec![visibility_output("filtered", self.texture())]
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
