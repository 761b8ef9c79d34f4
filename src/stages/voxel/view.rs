//! `voxel/view`: full voxels as cubes, seen from the camera. VAO Fig. 2.

use crate::prelude::*;
use crate::voxels::Voxels;
use fathom_gpu::kit::{Canvas, Raster};

pub const INFO: StageInfo = StageInfo {
    name: "voxel/view",
    about: "full voxels as cubes, a ray a pixel; draws the picture and is no part of a frame",
    source: "VAO Fig. 2",
};

const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;
const BACKGROUND: wgpu::Color = wgpu::Color { r: 0.93, g: 0.94, b: 0.96, a: 1.0 };

/// The voxels as cubes.
pub struct Cubes {
    pub picture: wgpu::Texture,
    pub depth: wgpu::Texture,
}

pub fn new(
    resources: &Resources<'_>,
    shared: &Shared,
    volumes: &[Voxels],
    size_px: [u32; 2],
) -> Result<Stage<Cubes>, GpuError> {
    let targets = [kit::opaque(FORMAT)];
    let depth = resources.target(INFO.name, size_px, kit::DEPTH_FORMAT);
    let spec = RenderSpec {
        depth: Some(Depth::nearest(&depth)),
        ..RenderSpec::new(INFO.name, &[], &targets)
    };
    let raster = |voxels: &Voxels| {
        let groups = [&shared.group, &Bindings::new(&[&voxels.uniforms, &voxels.bits])];
        Raster::new(resources, &RenderSpec { groups: &groups, ..spec.clone() })
    };
    let rasters = volumes.iter().map(raster).collect::<Result<Vec<_>, _>>()?;
    let canvas = Canvas::new(resources, &spec, size_px, BACKGROUND);
    let picture = canvas.textures[0].clone();
    let pixels = kit::pixels(&picture);
    let work = Work {
        fragments: pixels * volumes.len() as u64,
        bytes_written: pixels * 8,
        ..Work::default()
    };
    // Where there is no voxel, nothing is drawn.
    let min_work = Work { fragments: 0, ..work };
    let stage = Stage::new(&INFO, work, move |scope| {
        canvas.render(scope, |pass| {
            for raster in &rasters {
                raster.bind(pass);
                kit::draw_fullscreen(pass);
            }
        });
    });
    let stage = stage.with_min_work(min_work).with_output(picture.clone());
    let columns = Column::display("display value");
    Ok(stage.dump_as("cubes", "the voxels as cubes", columns).with_output(Cubes { picture, depth }))
}
