//! `scene/gbuffer`: albedo, normal and depth from the camera. UW §3.2.

use crate::gpu::{ColorTarget, DepthTarget, GpuError, StageScope, Targets};
use crate::record::Work;
use crate::stages::frame::Shared;
use crate::stages::geometry::Geometry;
use crate::stages::kit::{self, Bind, Group, RenderSpec, Resources};
use crate::stages::{Column, Output, OutputData, Stage, StageInfo};

pub const INFO: StageInfo = StageInfo {
    name: "scene/gbuffer",
    about: "albedo, normal, specular coefficient and depth from the camera in one multi-target pass",
    source: "UW §3.2, VAO §6",
};

pub struct Gbuffer {
    pipeline: wgpu::RenderPipeline,
    shared: wgpu::BindGroup,
    group: Group,
    geometry: Geometry,
    pub albedo: wgpu::Texture,
    /// The specular coefficient in its fourth channel.
    pub normal: wgpu::Texture,
    pub depth: wgpu::Texture,
    views: [wgpu::TextureView; 3],
}

impl Gbuffer {
    pub fn new(
        resources: &Resources<'_>,
        shared: &Shared,
        geometry: &Geometry,
        size_px: [u32; 2],
    ) -> Result<Self, GpuError> {
        let gpu = resources.gpu;
        let shader = gpu.shader(INFO.name, &[])?;
        let group = Group::new(gpu, INFO.name, &[Bind::Read(&geometry.materials)]);
        let formats = [wgpu::TextureFormat::Rgba8Unorm, wgpu::TextureFormat::Rgba16Float];
        let pipeline = kit::render_pipeline(
            gpu,
            &RenderSpec {
                label: INFO.name,
                shader: &shader,
                vertex: "vertex",
                fragment: Some("fragment"),
                groups: &[&shared.group, &group],
                buffers: &[Geometry::layout(false)],
                targets: &formats.map(kit::opaque),
                depth: Some(kit::depth_state(wgpu::CompareFunction::Less, true)),
            },
        );
        let albedo = resources.target("scene/gbuffer albedo", size_px, formats[0]);
        let normal = resources.target("scene/gbuffer normal", size_px, formats[1]);
        let depth = resources.target("scene/gbuffer depth", size_px, kit::DEPTH_FORMAT);
        Ok(Self {
            pipeline,
            shared: shared.group.group.clone(),
            group,
            geometry: geometry.clone(),
            views: [kit::view(&albedo), kit::view(&normal), kit::view(&depth)],
            albedo,
            normal,
            depth,
        })
    }
}

impl Stage for Gbuffer {
    fn name(&self) -> &'static str {
        INFO.name
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        let [albedo, normal, depth] = &self.views;
        let clear = Some(wgpu::Color::TRANSPARENT);
        let targets = Targets {
            color: &[
                ColorTarget { view: albedo, clear, slice: None },
                ColorTarget { view: normal, clear, slice: None },
            ],
            depth: Some(DepthTarget { view: depth, clear: Some(1.0), read_only: false }),
        };
        scope.render(&targets, |pass| {
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, &self.shared, &[]);
            pass.set_bind_group(1, &self.group.group, &[]);
            self.geometry.draw(pass);
        });
    }

    fn work(&self) -> Work {
        let pixels = u64::from(self.depth.width()) * u64::from(self.depth.height());
        Work {
            triangles: self.geometry.triangles(),
            bytes_read: self.geometry.bytes(),
            bytes_written: pixels * (4 + 8 + 4),
            ..Work::default()
        }
    }

    fn outputs(&self) -> Vec<Output> {
        let column = |name, meaning| Column { name, unit: "1", meaning };
        vec![
            Output {
                name: "albedo".into(),
                meaning: "diffuse reflectance at each pixel".into(),
                columns: vec![
                    column("red", "reflectance"),
                    column("green", "reflectance"),
                    column("blue", "reflectance"),
                    column("covered", "1 where geometry was drawn"),
                ],
                data: OutputData::Texture(self.albedo.clone()),
            },
            Output {
                name: "normal".into(),
                meaning: "unit surface normal in the world's axes, and the specular coefficient"
                    .into(),
                columns: vec![
                    column("nx", "normal"),
                    column("ny", "normal"),
                    column("nz", "normal"),
                    column("specular", "reflectance of the glossy lobe"),
                ],
                data: OutputData::Texture(self.normal.clone()),
            },
            Output {
                name: "depth".into(),
                meaning: "depth from the camera, 0 near plane to 1 far plane".into(),
                columns: vec![column("depth", "normalised device depth of the camera")],
                data: OutputData::Texture(self.depth.clone()),
            },
        ]
    }
}
