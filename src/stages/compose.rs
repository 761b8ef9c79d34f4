//! `compose`: the final image from all buffers, the water surface drawn over it. UW §3.5.

use encase::ShaderType;
use glam::Vec2;

use crate::gpu::{ColorTarget, DepthTarget, GpuError, StageScope, Targets};
use crate::record::Work;
use crate::stages::frame::Shared;
use crate::stages::kit::{self, Bind, Group, RenderSpec, Resources};
use crate::stages::{Column, Output, OutputData, Stage, StageInfo};

pub const INFO: StageInfo = StageInfo {
    name: "compose",
    about: "additive composition, water surface, optional screen-space ambient occlusion",
    source: "UW §3.5",
};

/// Host twin of `Compose` in `shaders/compose.wgsl`.
#[derive(Clone, Debug, PartialEq, ShaderType)]
pub struct ComposeUniforms {
    pub size_px: Vec2,
    pub caustics_scale: f32,
    pub godrays_scale: f32,
    pub exposure: f32,
    pub occlusion_taps: u32,
    pub occlusion_radius_m: f32,
    pub water_cells: u32,
}

/// The buffers that are composed.
pub struct Inputs<'a> {
    pub albedo: &'a wgpu::Texture,
    pub normal: &'a wgpu::Texture,
    pub depth: &'a wgpu::Texture,
    pub caustics: &'a wgpu::Texture,
    pub godrays: &'a wgpu::Texture,
    pub reflection: &'a wgpu::Texture,
    pub refraction: &'a wgpu::Texture,
}

pub struct Compose {
    screen: wgpu::RenderPipeline,
    water: wgpu::RenderPipeline,
    shared: wgpu::BindGroup,
    group: Group,
    settings: ComposeUniforms,
    image: wgpu::Texture,
    image_view: wgpu::TextureView,
    depth_view: wgpu::TextureView,
}

impl Compose {
    pub fn new(
        resources: &Resources<'_>,
        shared: &Shared,
        inputs: &Inputs<'_>,
        settings: ComposeUniforms,
        conserving: bool,
    ) -> Result<Self, GpuError> {
        let gpu = resources.gpu;
        let defs = [("CONSERVING", i32::from(conserving)), shared.water_def()];
        let shader = gpu.shader(INFO.name, &defs)?;
        let uniforms = resources.uniform(INFO.name, &settings);
        let sampler = gpu.device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some(INFO.name),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            ..Default::default()
        });
        let group = Group::new(
            gpu,
            INFO.name,
            &[
                Bind::Uniform(&uniforms),
                Bind::Texels(inputs.albedo),
                Bind::Texels(inputs.normal),
                Bind::Depth(inputs.depth),
                Bind::Texels(inputs.caustics),
                Bind::Texels(inputs.godrays),
                Bind::Filtered(inputs.reflection),
                Bind::Filtered(inputs.refraction),
                Bind::Sampler(&sampler),
            ],
        );
        let format = wgpu::TextureFormat::Rgba8Unorm;
        let pipeline = |vertex, fragment, compare| {
            let spec = RenderSpec {
                label: INFO.name,
                shader: &shader,
                vertex,
                fragment: Some(fragment),
                groups: &[&shared.group, &group],
                buffers: &[],
                targets: &[kit::opaque(format)],
                depth: Some(kit::depth_state(compare, false)),
            };
            kit::render_pipeline(gpu, &spec)
        };
        let image = resources.target(INFO.name, settings.size_px.as_uvec2().to_array(), format);
        Ok(Self {
            screen: pipeline("screen_vertex", "screen_fragment", wgpu::CompareFunction::Always),
            water: pipeline("water_vertex", "water_fragment", wgpu::CompareFunction::Less),
            shared: shared.group.group.clone(),
            image_view: kit::view(&image),
            depth_view: kit::view(inputs.depth),
            group,
            settings,
            image,
        })
    }

    pub fn texture(&self) -> &wgpu::Texture {
        &self.image
    }

    fn pixels(&self) -> u64 {
        u64::from(self.image.width()) * u64::from(self.image.height())
    }

    fn water_quads(&self) -> u32 {
        self.settings.water_cells * self.settings.water_cells
    }
}

impl Stage for Compose {
    fn name(&self) -> &'static str {
        INFO.name
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        let targets = Targets {
            color: &[ColorTarget {
                view: &self.image_view,
                clear: Some(wgpu::Color::BLACK),
                slice: None,
            }],
            depth: Some(DepthTarget { view: &self.depth_view, clear: None, read_only: true }),
        };
        scope.render(&targets, |pass| {
            pass.set_bind_group(0, &self.shared, &[]);
            pass.set_bind_group(1, &self.group.group, &[]);
            pass.set_pipeline(&self.screen);
            pass.draw(0..3, 0..1);
            pass.set_pipeline(&self.water);
            pass.draw(0..self.water_quads() * 6, 0..1);
        });
    }

    fn work(&self) -> Work {
        // Three G-buffer texels and two bilinear look-ups of four.
        let fetches = 3 + 2 * 4 + u64::from(self.settings.occlusion_taps);
        Work {
            triangles: u64::from(self.water_quads()) * 2,
            fragments: self.pixels(),
            texel_fetches: self.pixels() * fetches,
            bytes_written: self.pixels() * 4,
            ..Work::default()
        }
    }

    fn outputs(&self) -> Vec<Output> {
        let column = |name| Column { name, unit: "1", meaning: "display value, gamma 2.2" };
        vec![Output {
            name: "image".into(),
            meaning: "the final image".into(),
            columns: vec![column("red"), column("green"), column("blue"), column("alpha")],
            data: OutputData::Texture(self.image.clone()),
        }]
    }
}
