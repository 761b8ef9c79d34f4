//! `compose`: the final image from all buffers, the water surface drawn over it. UW §3.5.

use glam::Vec2;

use super::gbuffer::GbufferTextures;
use super::kit::{self, Bind, Group, Raster, RenderSpec, Resources};
use crate::frame::Shared;
use crate::shader_struct;
use crate::{Output, Stage, StageInfo};
use fathom_gpu::{ColorTarget, DepthTarget, GpuError, StageScope, Targets};
use fathom_record::Work;

pub const INFO: StageInfo = StageInfo {
    name: "compose",
    about: "additive composition, water surface, optional screen-space ambient occlusion",
    source: "UW §3.5",
};

shader_struct! {
    /// `Compose` in `shaders/compose.wgsl`.
    pub struct ComposeUniforms {
        pub size_px: Vec2,
        pub caustics_scale: f32,
        pub godrays_scale: f32,
        pub exposure: f32,
        pub occlusion_taps: u32,
        pub occlusion_radius_m: f32,
        pub water_cells: u32,
        pub depth_share: f32,
    }
}

/// The buffers that are composed.
pub struct Composed<'a> {
    pub gbuffer: &'a GbufferTextures,
    pub caustics: &'a wgpu::Texture,
    pub godrays: &'a wgpu::Texture,
    pub reflection: &'a wgpu::Texture,
    pub refraction: &'a wgpu::Texture,
}

pub struct Compose {
    screen: Raster,
    water: Raster,
    groups: Vec<wgpu::BindGroup>,
    settings: ComposeUniforms,
    image: wgpu::Texture,
    image_view: wgpu::TextureView,
    depth_view: wgpu::TextureView,
}

impl Compose {
    pub fn new(
        resources: &Resources<'_>,
        shared: &Shared,
        composed: &Composed<'_>,
        settings: ComposeUniforms,
        conserving: bool,
    ) -> Result<Self, GpuError> {
        let occlusion = i32::from(settings.occlusion_taps > 0);
        let defs =
            [("CONSERVING", i32::from(conserving)), ("OCCLUSION", occlusion), shared.water_def()];
        let uniforms = resources.loop_settings(INFO.name, &settings);
        let sampler = resources.linear_sampler(INFO.name);
        let gbuffer = composed.gbuffer;
        let binds = [
            Bind::Read(&uniforms),
            Bind::Texels(&gbuffer.albedo),
            Bind::Texels(&gbuffer.normal),
            Bind::Depth(&gbuffer.depth),
            Bind::Texels(composed.caustics),
            Bind::Texels(composed.godrays),
            Bind::Filtered(composed.reflection),
            Bind::Filtered(composed.refraction),
            Bind::Sampler(&sampler),
        ];
        let group = Group::new(resources.gpu, INFO.name, &binds);
        let format = wgpu::TextureFormat::Rgba8Unorm;
        let (groups, targets) = ([&shared.group, &group], [kit::opaque(format)]);
        let raster = |vertex, fragment, compare| {
            let spec = RenderSpec {
                vertex,
                fragment: Some(fragment),
                depth: Some(kit::depth_state(compare, false)),
                ..RenderSpec::new(INFO.name, (INFO.name, &defs[..]), &groups, &targets)
            };
            Raster::new(resources, &spec)
        };
        let image = resources.target(INFO.name, settings.size_px.as_uvec2().to_array(), format);
        Ok(Self {
            screen: raster("screen_vertex", "screen_fragment", wgpu::CompareFunction::Always)?,
            water: raster("water_vertex", "water_fragment", wgpu::CompareFunction::Less)?,
            groups: kit::bare(&groups),
            image_view: kit::view(&image),
            depth_view: kit::view(&gbuffer.depth),
            settings,
            image,
        })
    }

    pub fn texture(&self) -> &wgpu::Texture {
        &self.image
    }

    fn water_quads(&self) -> u32 {
        self.settings.water_cells * self.settings.water_cells
    }
}

impl Stage for Compose {
    fn info(&self) -> &'static StageInfo {
        &INFO
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        let clear = Some(wgpu::Color::BLACK);
        let targets = Targets {
            color: &[ColorTarget { view: &self.image_view, clear, slice: None }],
            depth: Some(DepthTarget { view: &self.depth_view, clear: None, read_only: true }),
        };
        scope.render(&targets, |pass| {
            kit::bind_groups(pass, &self.groups);
            self.screen.bind(pass);
            pass.draw(0..3, 0..1);
            self.water.bind(pass);
            pass.draw(0..self.water_quads() * 6, 0..1);
        });
    }

    fn work(&self) -> Work {
        let pixels = kit::pixels(&self.image);
        // Three G-buffer texels, four texels of godrays, and four of caustics with the depth behind each.
        let fetches = 3 + 4 + 2 * 4 + u64::from(self.settings.occlusion_taps);
        Work {
            triangles: u64::from(self.water_quads()) * 2,
            fragments: pixels,
            texel_fetches: pixels * fetches,
            bytes_written: pixels * 4,
            ..Work::default()
        }
    }

    /// Only the depth is read everywhere.
    fn least_work(&self) -> Work {
        Work { texel_fetches: kit::pixels(&self.image), ..self.work() }
    }

    fn outputs(&self) -> Vec<Output> {
        vec![Output::image(&self.image)]
    }
}
