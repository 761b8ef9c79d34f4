//! `ripple/blur`: the mean of a square around each pixel.

use fathom::gpu::{GpuError, Output, Stage, StageInfo, StageScope};
use fathom::record::Work;
use fathom::shader_struct;
use fathom::stages::kit::{self, Bind, Group, RenderSpec, Resources, ScreenPass};

pub const INFO: StageInfo = StageInfo {
    name: "ripple/blur",
    about: "mean of a square around each pixel",
    source: "an example of a stage of one's own",
};

shader_struct! {
    /// `Blur` in `shaders/ripple/blur.wgsl`.
    pub struct BlurUniforms {
        pub radius_px: u32,
    }
}

pub struct Blur {
    pass: ScreenPass,
    taps: u64,
}

impl Blur {
    /// The result has the size of the source.
    pub fn new(
        resources: &Resources<'_>,
        source: &wgpu::Texture,
        radius_px: u32,
    ) -> Result<Self, GpuError> {
        let settings = resources.loop_settings(INFO.name, &BlurUniforms { radius_px });
        let binds = [Bind::Read(&settings), Bind::Texels(source)];
        let group = Group::new(resources.gpu, INFO.name, &binds);
        let (groups, targets) = ([&group], [kit::opaque(wgpu::TextureFormat::Rgba8Unorm)]);
        let spec = RenderSpec::new(INFO.name, INFO.name, &groups, &targets);
        let size_px = [source.width(), source.height()];
        let pass = ScreenPass::new(resources, &spec, size_px, wgpu::Color::BLACK)?;
        Ok(Self { pass, taps: u64::from(2 * radius_px + 1).pow(2) })
    }

    pub fn texture(&self) -> &wgpu::Texture {
        self.pass.texture()
    }
}

impl Stage for Blur {
    fn info(&self) -> &'static StageInfo {
        &INFO
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        self.pass.encode(scope);
    }

    fn work(&self) -> Work {
        let pixels = self.pass.pixels();
        Work {
            fragments: pixels,
            texel_fetches: pixels * self.taps,
            bytes_written: pixels * 4,
            ..Work::default()
        }
    }

    fn outputs(&self) -> Vec<Output> {
        vec![Output::image(self.texture())]
    }
}
