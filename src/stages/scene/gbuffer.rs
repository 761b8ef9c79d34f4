//! `scene/gbuffer`: albedo, normal and depth from the camera. UW §3.2.

use crate::frame::Shared;
use crate::gbuffer::GbufferTextures;
use crate::geometry::Geometry;
use crate::kit::{Bind, Group, Resources, ScenePass};
use crate::{Column, Output, Stage, StageInfo};
use fathom_gpu::{GpuError, StageScope};
use fathom_record::Work;

pub const INFO: StageInfo = StageInfo {
    name: "scene/gbuffer",
    about: "albedo, normal, specular coefficient and depth from the camera in one multi-target pass",
    source: "UW §3.2, VAO §6",
};

pub struct Gbuffer {
    pass: ScenePass,
    pub textures: GbufferTextures,
}

impl Gbuffer {
    pub fn new(
        resources: &Resources<'_>,
        shared: &Shared,
        geometry: &Geometry,
        size_px: [u32; 2],
    ) -> Result<Self, GpuError> {
        let group = Group::new(resources.gpu, INFO.name, &[Bind::Read(&geometry.materials)]);
        let formats = [wgpu::TextureFormat::Rgba8Unorm, wgpu::TextureFormat::Rgba16Float];
        let groups = [&shared.group, &group];
        let pass = ScenePass::new(resources, INFO.name, &groups, geometry, &formats, size_px)?;
        let textures = GbufferTextures {
            albedo: pass.colors[0].clone(),
            normal: pass.colors[1].clone(),
            depth: pass.depth.clone(),
        };
        Ok(Self { pass, textures })
    }
}

impl Stage for Gbuffer {
    fn info(&self) -> &'static StageInfo {
        &INFO
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        self.pass.encode(scope);
    }

    fn work(&self) -> Work {
        self.pass.work(4 + 8 + 4)
    }

    fn least_work(&self) -> Work {
        self.pass.least_work(4 + 8 + 4)
    }

    fn outputs(&self) -> Vec<Output> {
        let textures = &self.textures;
        let column = |name, meaning| Column::new(name, "1", meaning);
        let mut albedo = ["red", "green", "blue"].map(|n| column(n, "reflectance")).to_vec();
        albedo.push(column("covered", "1 where geometry was drawn"));
        let mut normal = ["nx", "ny", "nz"].map(|n| column(n, "normal")).to_vec();
        normal.push(column("specular", "reflectance of the glossy lobe"));
        let depth = vec![column("depth", "normalised device depth of the camera")];
        let normals = "unit surface normal in the world's axes, and the specular coefficient";
        let depths = "depth from the camera, 0 near plane to 1 far plane";
        vec![
            Output::texture(
                "albedo",
                "diffuse reflectance at each pixel",
                albedo,
                &textures.albedo,
            ),
            Output::texture("normal", normals, normal, &textures.normal),
            Output::texture("depth", depths, depth, &textures.depth),
        ]
    }
}
