//! `voxel/slice`: the scene drawn into frusta one slice thin, a pass per slice and axis, and the OR of the axes. VAO §4.1.
//!
//! Every pass draws the whole geometry, and its near and far planes cut the slice out. The paper makes volumes so ahead of
//! rendering.

use std::ops::Range;

use super::slicemap::SliceAxis;
use super::{VoxelPart, bit_volumes};
use crate::geometry::Geometry;
use crate::prelude::*;
use fathom_gpu::kit::Raster;
use fathom_gpu::{ColorTarget, Drawing, Targets};

pub const INFO: StageInfo = StageInfo {
    name: "voxel/slice",
    about: "the whole geometry drawn into each slice of three volumes, and their OR",
    source: "VAO §4.1",
};

const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::R8Unorm;

/// A volume's axes: how each is drawn, into what, and how many slices it has.
struct VolumeSlices {
    axes: [(Raster, wgpu::TextureView, u32); 3],
    indices: Range<u32>,
    gather: Dispatch,
}

pub fn new(
    resources: &Resources<'_>,
    geometry: &Geometry,
    parts: &[VoxelPart],
) -> Result<Stage, GpuError> {
    let volumes = parts.iter().map(|part| VolumeSlices::new(resources, part));
    let volumes = volumes.collect::<Result<Vec<_>, _>>()?;
    let drawn = |(volume, part): (&VolumeSlices, &VoxelPart)| {
        volume.axes.iter().map(|axis| u64::from(axis.2)).sum::<u64>() * part.triangles()
    };
    let texels: u64 = parts.iter().map(|part| part.voxels.grid.count()).sum();
    let work = Work {
        triangles: volumes.iter().zip(parts).map(drawn).sum(),
        texel_fetches: 3 * texels,
        bytes_written: 3 * texels + texels / 8,
        ..Work::default()
    };
    let geometry = geometry.clone();
    let stage = Stage::new(&INFO, work, move |scope| {
        let mut slices = Vec::new();
        for VolumeSlices { axes, indices, .. } in &volumes {
            for (raster, view, count) in axes {
                slices.extend((0..*count).map(|slice| (raster, view, indices, slice)));
            }
        }
        let clear = Some(wgpu::Color::BLACK);
        let color = slices.iter().map(|(_, view, _, slice)| {
            [ColorTarget { view, clear, slice: Some(*slice), drawing: Drawing::Opaque }]
        });
        let color: Vec<_> = color.collect();
        let targets: Vec<_> = color.iter().map(|color| Targets { color, depth: None }).collect();
        scope.render_series(&targets, |number, pass| {
            let (raster, _, indices, slice) = slices[number];
            raster.bind(pass);
            geometry.draw_instances(pass, indices.clone(), slice..slice + 1);
        });
        scope.compute(|pass| volumes.iter().for_each(|volume| volume.gather.run(pass)));
    });
    Ok(stage.dumps(bit_volumes(parts.iter().map(|part| &part.voxels))))
}

impl VolumeSlices {
    fn new(resources: &Resources<'_>, part: &VoxelPart) -> Result<Self, GpuError> {
        let VoxelPart { voxels, indices } = part;
        let textures = SliceAxis::ALL
            .map(|axis| resources.volume(INFO.name, axis.turn(voxels.grid.cells), FORMAT, 1));
        let grid = Bindings::new(&[&voxels.uniforms]);
        let draw = |axis: SliceAxis| -> Result<_, GpuError> {
            let (defs, targets) = ([("AXIS", axis as i32)], [kit::opaque(FORMAT)]);
            let groups = [&grid];
            let spec = RenderSpec {
                buffers: &[Geometry::layout(true)],
                ..RenderSpec::new((INFO.name, &defs), &groups, &targets)
            };
            let view = kit::view(&textures[axis as usize]);
            Ok((Raster::new(resources, &spec)?, view, axis.turn(voxels.grid.cells)[2]))
        };
        let axes = [draw(SliceAxis::X)?, draw(SliceAxis::Y)?, draw(SliceAxis::Z)?];
        let [x, y, z] = &textures;
        let filled = Bindings::new(&[x, y, z, &voxels.bits]);
        // An invocation for a word of the bit volume.
        let workgroups = kit::linear_workgroups(voxels.grid.words());
        let gather = Dispatch::new(resources, INFO.name, &[&grid, &filled], workgroups)?;
        Ok(Self { axes, indices: indices.clone(), gather })
    }
}
