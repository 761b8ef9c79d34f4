//! What the stages of family `scalar` are: a view ray through the field for each pixel.

use glam::{Vec2, Vec3};

use super::frame::Shared;
use super::kit::{self, Bind, Group, RenderSpec, Resources, ScreenPass};
use super::scalar_field::ScalarField;
use super::{Column, Output, Stage, StageInfo};
use crate::gpu::{GpuError, StageScope};
use crate::record::Work;
use crate::shader_struct;

shader_struct! {
    /// `March` in `shaders/shared/ray_cast.wgsl`.
    pub struct CastUniforms {
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
}

const IMAGE_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;
const RESULT_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba32Float;
const NORMAL_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;

/// Full-viewport pass that casts each pixel's ray through a field.
pub struct RayCast {
    info: &'static StageInfo,
    pass: ScreenPass,
}

impl RayCast {
    /// The stage `info`. `defs` are the shader's; `normals`: the shader writes them.
    pub(super) fn new(
        resources: &Resources<'_>,
        info: &'static StageInfo,
        (shared, field): (&Shared, &ScalarField),
        defs: &[(&str, bool)],
        normals: bool,
        settings: &CastUniforms,
    ) -> Result<Self, GpuError> {
        let defs: Vec<_> = defs.iter().map(|(n, on)| (*n, i32::from(*on))).collect();
        let uniforms = resources.uniform(info.name, settings);
        let binds = [
            Bind::Uniform(&field.uniforms),
            Bind::Volume(&field.texture),
            Bind::Sampler(&field.sampler),
            Bind::Uniform(&uniforms),
        ];
        let group = Group::new(resources.gpu, info.name, &binds);
        let formats = [IMAGE_FORMAT, RESULT_FORMAT, NORMAL_FORMAT].map(kit::opaque);
        let targets = &formats[..if normals { 3 } else { 2 }];
        let groups = [&shared.group, &group];
        let spec = RenderSpec::new(info.name, (info.name, &defs[..]), &groups, targets);
        let size_px = settings.size_px.as_uvec2().to_array();
        let pass = ScreenPass::new(resources, &spec, size_px, wgpu::Color::TRANSPARENT)?;
        Ok(Self { info, pass })
    }

    /// The look, for display.
    pub fn image(&self) -> &wgpu::Texture {
        self.pass.texture()
    }

    /// Visibility 1 − A, opacity, distance in metres, and the number of look-ups in the field, for each pixel.
    pub fn result(&self) -> &wgpu::Texture {
        &self.pass.targets[1]
    }

    /// Of the surface, where the stage finds one.
    pub fn normal(&self) -> Option<&wgpu::Texture> {
        self.pass.targets.get(2)
    }
}

impl Stage for RayCast {
    fn info(&self) -> &'static StageInfo {
        self.info
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        self.pass.encode(scope);
    }

    /// Look-ups depend on the field and are counted by the shader: see the last channel of the result.
    fn work(&self) -> Work {
        let pixels = self.pass.pixels();
        let normal_bytes = if self.normal().is_some() { 8 } else { 0 };
        Work {
            fragments: pixels,
            bytes_written: pixels * (4 + 16 + normal_bytes),
            ..Work::default()
        }
    }

    fn outputs(&self) -> Vec<Output> {
        let result = vec![
            Column::new("visibility", "1", "1 − A, weighted by contribution"),
            Column::new("opacity", "1", "share of the view that the field hides"),
            Column::new("distance", "m", "from the viewer, weighted by contribution"),
            Column::new("look_ups", "1", "look-ups in the field"),
        ];
        let normal = self.normal().map(|texture| {
            let mut columns = ["nx", "ny", "nz"].map(|n| Column::new(n, "1", "normal")).to_vec();
            columns.push(Column::new("covered", "1", "1 where there is a surface"));
            let meaning = "unit normal of the isosurface in the world's axes";
            Output::texture("normal", meaning, columns, texture)
        });
        let met = "what each pixel's view ray met";
        let result = Output::texture("result", met, result, self.result());
        [Output::image(self.image()), result].into_iter().chain(normal).collect()
    }
}
