//! `ao/compose`: deferred direct light with shadows, and ambient light times visibility. VAO §6.

use encase::ShaderType;
use glam::Vec2;

use crate::gpu::{ColorTarget, GpuError, StageScope, Targets};
use crate::record::Work;
use crate::stages::frame::Shared;
use crate::stages::kit::{self, Bind, Group, RenderSpec, Resources};
use crate::stages::{Column, Output, OutputData, Stage, StageInfo};

pub const INFO: StageInfo = StageInfo {
    name: "ao/compose",
    about: "deferred direct light with shadows, and ambient light times visibility",
    source: "VAO §6",
};

/// Host twin of `Compose` in `shaders/ao/compose.wgsl`.
#[derive(Clone, Debug, PartialEq, ShaderType)]
pub struct ComposeUniforms {
    pub size_px: Vec2,
    pub exposure: f32,
    pub ambient: f32,
}

/// The buffers that are composed.
pub struct Inputs<'a> {
    pub albedo: &'a wgpu::Texture,
    /// With the specular coefficient in its fourth channel.
    pub normal: &'a wgpu::Texture,
    pub depth: &'a wgpu::Texture,
    /// 1 − A, at any size.
    pub visibility: &'a wgpu::Texture,
    /// The light's depth.
    pub shadow: &'a wgpu::Texture,
}

pub struct Compose {
    pipeline: wgpu::RenderPipeline,
    shared: wgpu::BindGroup,
    group: Group,
    image: wgpu::Texture,
    view: wgpu::TextureView,
    shows_occlusion: bool,
}

impl Compose {
    /// With `shows_occlusion` the picture is the visibility itself, as it is.
    pub fn new(
        resources: &Resources<'_>,
        shared: &Shared,
        inputs: &Inputs<'_>,
        settings: &ComposeUniforms,
        shows_occlusion: bool,
    ) -> Result<Self, GpuError> {
        let gpu = resources.gpu;
        let shader = gpu.shader(INFO.name, &[("SHOW_OCCLUSION", i32::from(shows_occlusion))])?;
        let uniforms = resources.uniform(INFO.name, settings);
        let group = Group::new(
            gpu,
            INFO.name,
            &[
                Bind::Uniform(&uniforms),
                Bind::Texels(inputs.albedo),
                Bind::Texels(inputs.normal),
                Bind::Depth(inputs.depth),
                Bind::Texels(inputs.visibility),
                Bind::Depth(inputs.shadow),
            ],
        );
        let format = wgpu::TextureFormat::Rgba8Unorm;
        let pipeline = kit::render_pipeline(
            gpu,
            &RenderSpec {
                label: INFO.name,
                shader: &shader,
                vertex: "vertex",
                fragment: Some("fragment"),
                groups: &[&shared.group, &group],
                buffers: &[],
                targets: &[kit::opaque(format)],
                depth: None,
            },
        );
        let image = resources.target(INFO.name, settings.size_px.as_uvec2().to_array(), format);
        Ok(Self {
            pipeline,
            shared: shared.group.group.clone(),
            group,
            view: kit::view(&image),
            image,
            shows_occlusion,
        })
    }

    pub fn texture(&self) -> &wgpu::Texture {
        &self.image
    }
}

impl Stage for Compose {
    fn name(&self) -> &'static str {
        INFO.name
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        let targets = Targets {
            color: &[ColorTarget {
                view: &self.view,
                clear: Some(wgpu::Color::BLACK),
                slice: None,
            }],
            depth: None,
        };
        scope.render(&targets, |pass| {
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, &self.shared, &[]);
            pass.set_bind_group(1, &self.group.group, &[]);
            pass.draw(0..3, 0..1);
        });
    }

    fn work(&self) -> Work {
        let pixels = u64::from(self.image.width()) * u64::from(self.image.height());
        // Visibility; and for the picture albedo, normal, depth and four texels of the shadow map.
        let fetches = if self.shows_occlusion { 1 } else { 8 };
        Work {
            fragments: pixels,
            texel_fetches: pixels * fetches,
            bytes_written: pixels * 4,
            ..Work::default()
        }
    }

    fn outputs(&self) -> Vec<Output> {
        let meaning = if self.shows_occlusion { "visibility" } else { "display value, gamma 2.2" };
        let column = |name| Column { name, unit: "1", meaning };
        vec![Output {
            name: "image".into(),
            meaning: "the final image".into(),
            columns: ["red", "green", "blue", "alpha"].map(column).to_vec(),
            data: OutputData::Texture(self.image.clone()),
        }]
    }
}
