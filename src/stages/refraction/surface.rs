//! `refraction/surface`: the picture with the water's surface, which refracts and reflects lines of sight. SPT §4.

use glam::Vec2;

use crate::frame::Shared;
use crate::kit::{self, Bind, Group, RenderSpec, Resources, ScreenPass};
use crate::screen_picture::Shafts;
use crate::screen_ray::{Layers, WalkUniforms, walk_turns};
use crate::shader_struct;
use crate::{Output, Stage, StageInfo};
use fathom_gpu::{GpuError, StageScope};
use fathom_record::Work;

pub const INFO: StageInfo = StageInfo {
    name: "refraction/surface",
    about: "the picture with the water's surface, at which lines of sight are refracted and reflected",
    source: "SPT §4",
};

shader_struct! {
    /// `Surface` in `shaders/refraction/surface.wgsl`.
    pub struct SurfaceUniforms {
        pub size_px: Vec2,
        pub exposure: f32,
        pub shaft_scale: f32,
        pub bound_m: f32,
    }
}

/// Steps towards the water's surface, and halvings of the one that crosses it: as in the shader.
const SEARCHES: u64 = 32;
const HALVINGS: u64 = 10;

/// What the camera sees without the water.
pub struct Dry<'a> {
    /// The first layer is what is seen.
    pub layers: &'a Layers,
    pub depth: &'a wgpu::Texture,
    pub radiance: &'a wgpu::Texture,
}

pub struct Surface {
    pass: ScreenPass,
    steps: u64,
}

impl Surface {
    /// `bound_m` is how far the surface is from y = 0 at most. Of `walk`'s layers the first is used.
    pub fn new(
        resources: &Resources<'_>,
        shared: &Shared,
        dry: &Dry<'_>,
        (walk, bound_m): (&WalkUniforms, f64),
        (shafts, exposure): (Option<Shafts<'_>>, f64),
    ) -> Result<Self, GpuError> {
        let size_px = dry.layers.size_px();
        let settings = SurfaceUniforms {
            size_px: Vec2::from(size_px.map(|side| side as f32)),
            exposure: exposure as f32,
            shaft_scale: shafts.as_ref().map_or(0.0, |shafts| shafts.scale as f32),
            bound_m: bound_m as f32,
        };
        // The search for the surface, its height at the place found, and a ray to either side.
        let water = (SEARCHES + HALVINGS + 3) * (2 + shared.water_turns());
        resources.turns("water.waves and view", water + 2 * walk_turns(walk.most, 1));
        let settings = resources.uniform(INFO.name, &settings);
        let walk_uniforms =
            resources.uniform(INFO.name, &WalkUniforms { layers: 1, ..walk.clone() });
        let mut binds = vec![
            Bind::Uniform(&settings),
            Bind::Uniform(&walk_uniforms),
            Bind::Layers(&dry.layers.depths),
            Bind::Layers(&dry.layers.surfaces),
            Bind::Depth(dry.depth),
            Bind::Texels(dry.radiance),
        ];
        binds.extend(shafts.as_ref().map(|shafts| Bind::Texels(shafts.flux)));
        let group = Group::new(resources.gpu, INFO.name, &binds);
        let groups = [&shared.group, &group];
        let targets = [kit::opaque(wgpu::TextureFormat::Rgba8Unorm)];
        let defs = [("SHAFTS", i32::from(shafts.is_some())), shared.water_def()];
        let spec = RenderSpec::new(INFO.name, (INFO.name, &defs[..]), &groups, &targets);
        let pass = ScreenPass::new(resources, &spec, size_px, wgpu::Color::BLACK)?;
        Ok(Self { pass, steps: walk.most.into() })
    }

    pub fn texture(&self) -> &wgpu::Texture {
        self.pass.texture()
    }
}

impl Stage for Surface {
    fn info(&self) -> &'static StageInfo {
        &INFO
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        self.pass.encode(scope);
    }

    /// At most: two rays a pixel, each as long as the picture.
    fn work(&self) -> Work {
        let pixels = self.pass.pixels();
        Work {
            fragments: pixels,
            texel_fetches: pixels * (4 + 4 * self.steps),
            bytes_written: pixels * 4,
            ..Work::default()
        }
    }

    /// A ray may end at its first texel.
    fn least_work(&self) -> Work {
        Work { texel_fetches: self.pass.pixels(), ..self.work() }
    }

    fn outputs(&self) -> Vec<Output> {
        vec![Output::image(self.texture())]
    }
}
