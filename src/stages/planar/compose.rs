//! `planar/compose`: the picture, its pool lit by the illumination map, or the map of the floor. SPT §1.1, Fig. 2.

use glam::Vec2;
use serde::{Deserialize, Serialize};

use crate::frame::Shared;
use crate::gbuffer::GbufferTextures;
use crate::kit::{self, Bind, Group, RenderSpec, Resources, ScreenPass};
use crate::pool::Pool;
use crate::shader_struct;
use crate::{Output, Stage, StageInfo};
use fathom_gpu::{GpuError, StageScope};
use fathom_record::Work;

pub const INFO: StageInfo = StageInfo {
    name: "planar/compose",
    about: "the picture: what the camera sees, lit by the illumination map and sky",
    source: "SPT §1.1, Fig. 2",
};

shader_struct! {
    /// `Compose` in `shaders/planar/compose.wgsl`.
    pub struct ComposeUniforms {
        pub size_px: Vec2,
        pub exposure: f32,
    }
}

/// What the picture shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Shown {
    /// The lit scene.
    Image,
    /// The illumination map of the floor, texel by texel, on white. SPT Fig. 2, right.
    FloorMap,
}

fathom_base::choices!(Shown);

/// Albedo, normal and depth of a pixel, and four texels of the map.
const FETCHES: u64 = 7;

pub struct Compose(ScreenPass);

impl Compose {
    /// `map` is the illumination map of the pool.
    pub fn new(
        resources: &Resources<'_>,
        shared: &Shared,
        gbuffer: &GbufferTextures,
        (map, pool): (&wgpu::Texture, &Pool),
        exposure: f64,
        shown: Shown,
    ) -> Result<Self, GpuError> {
        let size_px = [gbuffer.depth.width(), gbuffer.depth.height()];
        let settings = ComposeUniforms {
            size_px: Vec2::from(size_px.map(|side| side as f32)),
            exposure: exposure as f32,
        };
        let settings = resources.uniform(INFO.name, &settings);
        let pool = pool.uniform(resources);
        let binds = [
            Bind::Uniform(&settings),
            Bind::Uniform(&pool),
            Bind::Texels(&gbuffer.albedo),
            Bind::Texels(&gbuffer.normal),
            Bind::Depth(&gbuffer.depth),
            Bind::Texels(map),
        ];
        let group = Group::new(resources.gpu, INFO.name, &binds);
        let groups = [&shared.group, &group];
        let targets = [kit::opaque(wgpu::TextureFormat::Rgba8Unorm)];
        let defs = [("MAP", i32::from(shown == Shown::FloorMap))];
        let spec = RenderSpec::new(INFO.name, (INFO.name, &defs[..]), &groups, &targets);
        ScreenPass::new(resources, &spec, size_px, wgpu::Color::BLACK).map(Self)
    }

    pub fn texture(&self) -> &wgpu::Texture {
        self.0.texture()
    }
}

impl Stage for Compose {
    fn info(&self) -> &'static StageInfo {
        &INFO
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        self.0.encode(scope);
    }

    fn work(&self) -> Work {
        let pixels = self.0.pixels();
        Work {
            fragments: pixels,
            texel_fetches: pixels * FETCHES,
            bytes_written: pixels * 4,
            ..Work::default()
        }
    }

    /// The background has no texels but its depth.
    fn least_work(&self) -> Work {
        Work { texel_fetches: self.0.pixels(), ..self.work() }
    }

    fn outputs(&self) -> Vec<Output> {
        vec![Output::image(self.texture())]
    }
}
