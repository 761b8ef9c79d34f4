//! `ao/compose`: deferred direct light with shadows, and ambient light times visibility. VAO §6.

use glam::Vec2;

use crate::frame::Shared;
use crate::gbuffer::GbufferTextures;
use crate::kit::{self, Bind, Group, RenderSpec, Resources, ScreenPass};
use crate::shader_struct;
use crate::{Column, Output, Stage, StageInfo};
use fathom_gpu::{GpuError, StageScope};
use fathom_record::Work;

pub const INFO: StageInfo = StageInfo {
    name: "ao/compose",
    about: "deferred direct light with shadows, and ambient light times visibility",
    source: "VAO §6",
};

shader_struct! {
    /// `Compose` in `shaders/ao/compose.wgsl`.
    pub struct LightingUniforms {
        pub size_px: Vec2,
        pub exposure: f32,
        pub ambient: f32,
    }
}

/// The buffers that are composed.
pub struct Lit<'a> {
    pub gbuffer: &'a GbufferTextures,
    /// 1 − A, at any size.
    pub visibility: &'a wgpu::Texture,
    /// The light's depth.
    pub shadow: &'a wgpu::Texture,
}

pub struct Compose {
    pass: ScreenPass,
    shows_occlusion: bool,
}

impl Compose {
    /// With `shows_occlusion` the picture is the visibility itself, as it is.
    pub fn new(
        resources: &Resources<'_>,
        shared: &Shared,
        lit: &Lit<'_>,
        settings: &LightingUniforms,
        shows_occlusion: bool,
    ) -> Result<Self, GpuError> {
        let uniforms = resources.uniform(INFO.name, settings);
        let binds = [
            Bind::Uniform(&uniforms),
            Bind::Texels(&lit.gbuffer.albedo),
            Bind::Texels(&lit.gbuffer.normal),
            Bind::Depth(&lit.gbuffer.depth),
            Bind::Texels(lit.visibility),
            Bind::Depth(lit.shadow),
        ];
        let group = Group::new(resources.gpu, INFO.name, &binds);
        let defs = [("SHOW_OCCLUSION", i32::from(shows_occlusion))];
        let groups = [&shared.group, &group];
        let targets = [kit::opaque(wgpu::TextureFormat::Rgba8Unorm)];
        let spec = RenderSpec::new(INFO.name, (INFO.name, &defs[..]), &groups, &targets);
        let size_px = settings.size_px.as_uvec2().to_array();
        let pass = ScreenPass::new(resources, &spec, size_px, wgpu::Color::BLACK)?;
        Ok(Self { pass, shows_occlusion })
    }

    pub fn texture(&self) -> &wgpu::Texture {
        self.pass.texture()
    }

    pub fn shows_occlusion(&self) -> bool {
        self.shows_occlusion
    }
}

impl Stage for Compose {
    fn info(&self) -> &'static StageInfo {
        &INFO
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        self.pass.encode(scope);
    }

    fn work(&self) -> Work {
        let pixels = self.pass.pixels();
        // Visibility and depth; and for the picture albedo, normal and four texels of the shadow map.
        let fetches = if self.shows_occlusion { 2 } else { 8 };
        Work {
            fragments: pixels,
            texel_fetches: pixels * fetches,
            bytes_written: pixels * 4,
            ..Work::default()
        }
    }

    /// The background has no colour, and surfaces that face away from the light ask no shadow map.
    fn least_work(&self) -> Work {
        Work { texel_fetches: 2 * self.pass.pixels(), ..self.work() }
    }

    fn outputs(&self) -> Vec<Output> {
        let meaning = if self.shows_occlusion { "visibility" } else { "display value, gamma 2.2" };
        let columns = Column::display(meaning);
        vec![Output::texture("image", "the final image", columns, self.texture())]
    }
}
