//! `ripple/draw`: the sum of rings at each pixel.

use fathom::gpu::{GpuError, Output, Stage, StageInfo, StageScope};
use fathom::record::Work;
use fathom::shader_struct;
use fathom::stages::kit::{self, Bind, Group, RenderSpec, Resources, ScreenPass};
use glam::Vec2;

use crate::pipeline::Params;

pub const INFO: StageInfo = StageInfo {
    name: "ripple/draw",
    about: "rings of ripples added up at each pixel",
    source: "an example of a stage of one's own",
};

shader_struct! {
    /// `Ripples` in `shaders/ripple/draw.wgsl`.
    pub struct RippleUniforms {
        pub size_px: Vec2,
        pub wavelength: f32,
        pub rings: u32,
    }
}

pub struct Draw {
    pass: ScreenPass,
}

impl Draw {
    pub fn new(
        resources: &Resources<'_>,
        size_px: [u32; 2],
        params: &Params,
    ) -> Result<Self, GpuError> {
        let uniforms = RippleUniforms {
            size_px: Vec2::from(size_px.map(|side| side as f32)),
            // The water's wavelength over its half size.
            wavelength: (params.water.wavelength_m / params.water.half_size_m[0]) as f32,
            rings: params.ripples.rings,
        };
        let settings = resources.loop_settings(INFO.name, &uniforms);
        let group = Group::new(resources.gpu, INFO.name, &[Bind::Read(&settings)]);
        let (groups, targets) = ([&group], [kit::opaque(wgpu::TextureFormat::Rgba8Unorm)]);
        let spec = RenderSpec::new(INFO.name, INFO.name, &groups, &targets);
        let pass = ScreenPass::new(resources, &spec, size_px, wgpu::Color::BLACK)?;
        Ok(Self { pass })
    }

    pub fn texture(&self) -> &wgpu::Texture {
        self.pass.texture()
    }
}

impl Stage for Draw {
    fn info(&self) -> &'static StageInfo {
        &INFO
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        self.pass.encode(scope);
    }

    fn work(&self) -> Work {
        let pixels = self.pass.pixels();
        Work { fragments: pixels, bytes_written: pixels * 4, ..Work::default() }
    }

    fn outputs(&self) -> Vec<Output> {
        vec![Output::image(self.texture())]
    }
}
