//! `scene/gbuffer`: albedo, normal and depth from the camera. UW §3.2.

use crate::gbuffer::GBuffer;
use crate::geometry::{self, Geometry};
use crate::prelude::*;

pub const INFO: StageInfo = StageInfo {
    name: "scene/gbuffer",
    about: "albedo, normal, specular coefficient and depth from the camera in one multi-target pass",
    source: "UW §3.2, VAO §6",
};

pub fn new(
    resources: &Resources<'_>,
    shared: &Shared,
    geometry: &Geometry,
    size_px: [u32; 2],
) -> Result<Stage<GBuffer>, GpuError> {
    let groups = [&shared.group, &Bindings::new(&[&geometry.materials])];
    let formats = [wgpu::TextureFormat::Rgba8Unorm, wgpu::TextureFormat::Rgba16Float];
    let targets = (&formats[..], 4 + 8 + 4);
    let drawn = geometry::scene_stage(resources, &INFO, &groups, geometry, targets, size_px)?;
    let (colors, depth) = &drawn.output;
    let textures =
        GBuffer { albedo: colors[0].clone(), normal: colors[1].clone(), depth: depth.clone() };
    let mut albedo = Column::many(["red", "green", "blue"], "1", "reflectance");
    albedo.push(Column::new("covered", "1", "1 where geometry was drawn"));
    let mut normal = Column::many(["nx", "ny", "nz"], "1", "normal");
    normal.push(Column::new("specular", "1", "reflectance of the glossy lobe"));
    let depth = vec![Column::new("depth", "1", "normalised device depth of the camera")];
    let albedos = "diffuse reflectance at each pixel";
    let normals = "unit surface normal in the world's axes, and the specular coefficient";
    let depths = "depth from the camera, 0 near plane to 1 far plane";
    let outputs = [
        StageDump::texture("albedo", albedos, albedo, &textures.albedo),
        StageDump::texture("normal", normals, normal, &textures.normal),
        StageDump::texture("depth", depths, depth, &textures.depth),
    ];
    Ok(drawn.dumps(outputs).with_output(textures))
}
