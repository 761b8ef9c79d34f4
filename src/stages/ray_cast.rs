//! The pass that the stages of family `scalar` share: a view ray through the field for each pixel.

use encase::ShaderType;
use glam::{Vec2, Vec3};

use super::frame::Shared;
use super::kit::{self, Bind, Group, RenderSpec, Resources};
use super::scalar_field::ScalarField;
use super::{Column, Output, OutputData};
use crate::gpu::{ColorTarget, GpuError, StageScope, Targets};
use crate::record::Work;

/// Host twin of `March` in `shaders/shared/ray_cast.wgsl`.
#[derive(Clone, Debug, PartialEq, ShaderType)]
pub struct MarchUniforms {
    pub size_px: Vec2,
    pub window: Vec2,
    pub low_color: Vec3,
    pub ambient: f32,
    pub high_color: Vec3,
    pub view_step_m: f32,
    pub iso: f32,
    pub tolerance: f32,
    pub threshold: f32,
    pub rays: u32,
    pub samples: u32,
    pub r_max_m: f32,
    pub stratum_m: f32,
    pub level: f32,
    pub opacity: f32,
    pub density_per_m: f32,
}

const IMAGE_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;
const RESULT_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba32Float;
const NORMAL_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;

/// Colour targets of the pass with normals, and their bytes per sample as WebGPU counts them.
pub const COLOR_TARGETS: [u64; 2] = [3, 8 + 16 + 8];

/// Full-viewport pass that casts each pixel's ray through a field.
pub struct RayCast {
    pipeline: wgpu::RenderPipeline,
    shared: wgpu::BindGroup,
    group: Group,
    /// The look, for display.
    pub image: wgpu::Texture,
    /// Visibility 1 − A, opacity, distance in metres, and the number of look-ups in the field, for each pixel.
    pub result: wgpu::Texture,
    /// Of the surface, where the stage finds one.
    pub normal: Option<wgpu::Texture>,
    views: Vec<wgpu::TextureView>,
}

impl RayCast {
    /// `name` is the stage's, and names its shader; `defs` are the shader's; `normals`: the shader writes them.
    pub fn new(
        resources: &Resources<'_>,
        shared: &Shared,
        field: &ScalarField,
        name: &'static str,
        defs: &[(&str, bool)],
        normals: bool,
        settings: &MarchUniforms,
    ) -> Result<Self, GpuError> {
        let gpu = resources.gpu;
        let defs: Vec<_> = defs.iter().map(|(n, on)| (*n, i32::from(*on))).collect();
        let shader = gpu.shader(name, &defs)?;
        let uniforms = resources.uniform(name, settings);
        let binds = [
            Bind::Uniform(&field.uniforms),
            Bind::Volume(&field.texture),
            Bind::Sampler(&field.sampler),
            Bind::Uniform(&uniforms),
        ];
        let group = Group::new(gpu, name, &binds);
        let size_px = settings.size_px.as_uvec2().to_array();
        let image = resources.target(name, size_px, IMAGE_FORMAT);
        let result = resources.target(name, size_px, RESULT_FORMAT);
        let normal = normals.then(|| resources.target(name, size_px, NORMAL_FORMAT));
        let textures: Vec<_> = [&image, &result].into_iter().chain(&normal).collect();
        let targets: Vec<_> = textures.iter().map(|t| kit::opaque(t.format())).collect();
        let pipeline = kit::render_pipeline(
            gpu,
            &RenderSpec {
                label: name,
                shader: &shader,
                vertex: "vertex",
                fragment: Some("fragment"),
                groups: &[&shared.group, &group],
                buffers: &[],
                targets: &targets,
                depth: None,
            },
        );
        Ok(Self {
            pipeline,
            shared: shared.group.group.clone(),
            group,
            views: textures.into_iter().map(kit::view).collect(),
            image,
            result,
            normal,
        })
    }

    pub fn encode(&self, scope: &mut StageScope<'_>) {
        let target =
            |view| ColorTarget { view, clear: Some(wgpu::Color::TRANSPARENT), slice: None };
        let color: Vec<_> = self.views.iter().map(target).collect();
        let targets = Targets { color: &color, depth: None };
        scope.render(&targets, |pass| {
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, &self.shared, &[]);
            pass.set_bind_group(1, &self.group.group, &[]);
            pass.draw(0..3, 0..1);
        });
    }

    /// Look-ups depend on the field and are counted by the shader: see the last channel of `result`.
    pub fn work(&self) -> Work {
        let pixels = u64::from(self.image.width()) * u64::from(self.image.height());
        let normal_bytes = if self.normal.is_some() { 8 } else { 0 };
        Work {
            fragments: pixels,
            bytes_written: pixels * (4 + 16 + normal_bytes),
            ..Work::default()
        }
    }

    pub fn outputs(&self) -> Vec<Output> {
        let column = |name, unit, meaning| Column { name, unit, meaning };
        let shown = |name| column(name, "1", "display value, gamma 2.2");
        let axis = |name| column(name, "1", "normal");
        let image = Output {
            name: "image".into(),
            meaning: "the final image".into(),
            columns: ["red", "green", "blue", "alpha"].map(shown).to_vec(),
            data: OutputData::Texture(self.image.clone()),
        };
        let result = Output {
            name: "result".into(),
            meaning: "what each pixel's view ray met".into(),
            columns: vec![
                column("visibility", "1", "1 − A, weighted by contribution"),
                column("opacity", "1", "share of the view that the field hides"),
                column("distance", "m", "from the viewer, weighted by contribution"),
                column("look_ups", "1", "look-ups in the field"),
            ],
            data: OutputData::Texture(self.result.clone()),
        };
        let normal = self.normal.iter().map(|texture| Output {
            name: "normal".into(),
            meaning: "unit normal of the isosurface in the world's axes".into(),
            columns: vec![
                axis("nx"),
                axis("ny"),
                axis("nz"),
                column("covered", "1", "1 where there is a surface"),
            ],
            data: OutputData::Texture(texture.clone()),
        });
        [image, result].into_iter().chain(normal).collect()
    }
}
