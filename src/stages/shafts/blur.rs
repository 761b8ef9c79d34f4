//! `shafts/blur`: a Gaussian of constant width on the screen. SPT §3.2.

use glam::IVec2;

use crate::kit::{self, Bind, Group, RenderSpec, Resources, ScreenPass};
use crate::shader_struct;
use crate::{Column, Output, Stage, StageInfo};
use fathom_gpu::{GpuError, StageScope};
use fathom_record::Work;

pub const INFO: StageInfo = StageInfo {
    name: "shafts/blur",
    about: "Gaussian blur of the shafts, rows and then columns",
    source: "SPT §3.2",
};

shader_struct! {
    /// `Blur` in `shaders/shafts/blur.wgsl`.
    pub struct BlurUniforms {
        pub along: IVec2,
        pub reach: i32,
        pub falloff: f32,
    }
}

/// The kernel ends here, in standard deviations: what is left is 0.3 % of its sum.
const REACH_SIGMAS: f64 = 3.0;

pub struct Blur {
    rows: ScreenPass,
    columns: ScreenPass,
    taps: u64,
    column: Column,
}

impl Blur {
    /// Of a texture of one channel; the result holds what its column says.
    pub fn new(
        resources: &Resources<'_>,
        (source, column): (&wgpu::Texture, Column),
        sigma_px: f64,
    ) -> Result<Self, GpuError> {
        let reach = (REACH_SIGMAS * sigma_px).ceil();
        let pass = |source: &wgpu::Texture, along: IVec2| {
            let falloff = (-0.5 / (sigma_px * sigma_px)) as f32;
            let settings = BlurUniforms { along, reach: reach as i32, falloff };
            let settings = resources.loop_settings(INFO.name, &settings);
            let binds = [Bind::Read(&settings), Bind::Texels(source)];
            let group = Group::new(resources.gpu, INFO.name, &binds);
            let (groups, targets) = ([&group], [kit::opaque(source.format())]);
            let spec = RenderSpec::new(INFO.name, INFO.name, &groups, &targets);
            let size_px = [source.width(), source.height()];
            ScreenPass::new(resources, &spec, size_px, wgpu::Color::BLACK)
        };
        let rows = pass(source, IVec2::X)?;
        let columns = pass(rows.texture(), IVec2::Y)?;
        Ok(Self { rows, columns, taps: 2 * reach as u64 + 1, column })
    }

    pub fn texture(&self) -> &wgpu::Texture {
        self.columns.texture()
    }
}

impl Stage for Blur {
    fn info(&self) -> &'static StageInfo {
        &INFO
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        self.rows.encode(scope);
        self.columns.encode(scope);
    }

    fn work(&self) -> Work {
        let fragments = 2 * self.rows.pixels();
        Work {
            fragments,
            texel_fetches: fragments * self.taps,
            bytes_written: fragments * 4,
            ..Work::default()
        }
    }

    fn outputs(&self) -> Vec<Output> {
        vec![Output::texture(
            "blurred",
            "lines after the blur",
            vec![self.column.clone()],
            self.texture(),
        )]
    }
}
