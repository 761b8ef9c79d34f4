//! `voxel/slicemap-x`, `-y`, `-z`: the scene drawn along an axis, each fragment setting the bit of its depth slice. VAO §4.2.
//!
//! A fragment sets one voxel, that of the surface at the middle of its pixel: where a surface is steep to the axis, voxels stay
//! empty, and the passes along the other axes fill them.

use super::{Part, triangles, words};
use crate::geometry::Geometry;
use crate::kit::{Canvas, Raster};
use crate::prelude::*;
use fathom_scene::Grid;

pub const INFO_X: StageInfo = StageInfo {
    name: "voxel/slicemap-x",
    about: "bits of depth slices along x by atomic OR, all in one pass",
    source: "VAO §4.2",
};

pub const INFO_Y: StageInfo = StageInfo {
    name: "voxel/slicemap-y",
    about: "bits of depth slices along y by atomic OR, all in one pass",
    source: "VAO §4.2",
};

pub const INFO_Z: StageInfo = StageInfo {
    name: "voxel/slicemap-z",
    about: "bits of depth slices along z by atomic OR, all in one pass",
    source: "VAO §4.2",
};

/// Format of the target that a render pass must have: nothing is written to it.
const DUMMY: wgpu::TextureFormat = wgpu::TextureFormat::R8Unorm;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axis {
    X,
    Y,
    Z,
}

impl Axis {
    pub const ALL: [Axis; 3] = [Axis::X, Axis::Y, Axis::Z];

    /// The stage's.
    pub fn info(self) -> &'static StageInfo {
        match self {
            Axis::X => &INFO_X,
            Axis::Y => &INFO_Y,
            Axis::Z => &INFO_Z,
        }
    }

    /// Columns and rows of the pass, and slices.
    pub fn turned(self, grid: &Grid) -> [u32; 3] {
        self.turn(grid.cells)
    }

    /// A voxel's column, row and slice.
    pub fn turn(self, [x, y, z]: [u32; 3]) -> [u32; 3] {
        match self {
            Axis::X => [y, z, x],
            Axis::Y => [x, z, y],
            Axis::Z => [x, y, z],
        }
    }

    /// Size of a slicemap of 32 slices a word.
    pub fn slicemap_bytes(self, grid: &Grid) -> u64 {
        let [columns, rows, slices] = self.turned(grid).map(u64::from);
        columns * rows * slices.div_ceil(32) * 4
    }
}

/// The stage leaves each volume's slices: words of 32 slices, layers of the pass's columns × rows.
pub fn new(
    resources: &Resources<'_>,
    geometry: &Geometry,
    parts: &[Part],
    axis: Axis,
) -> Result<Stage<Vec<Buffer>>, GpuError> {
    let info = axis.info();
    let (defs, targets) = ([("AXIS", axis as i32)], [kit::unwritten(DUMMY)]);
    let spec = RenderSpec {
        label: info.name,
        buffers: &[Geometry::layout(true)],
        ..RenderSpec::new(("voxel/slicemap", &defs), &[], &targets)
    };
    let (mut slicemaps, mut draws, mut largest) = (Vec::new(), Vec::new(), [1, 1]);
    for Part { voxels, indices } in parts {
        let slices = resources.storage(info.name, axis.slicemap_bytes(&voxels.grid));
        let groups = [&Group::new(&[&voxels.uniforms, &slices])];
        let raster = Raster::new(resources, &RenderSpec { groups: &groups, ..spec.clone() })?;
        let [columns, rows, _] = axis.turned(&voxels.grid);
        largest = [columns.max(largest[0]), rows.max(largest[1])];
        draws.push((raster, [columns, rows].map(|side| side as f32), indices.clone()));
        slicemaps.push(slices);
    }
    let canvas = Canvas::new(resources, &spec, largest, None);
    let (triangles, bytes_read) = (triangles(parts), geometry.bytes());
    let geometry = geometry.clone();
    let stage = Stage::new(info, Work { triangles, bytes_read, ..Work::default() }, move |scope| {
        canvas.render(scope, |pass| {
            for (raster, [columns, rows], indices) in &draws {
                raster.bind(pass);
                pass.set_viewport(0.0, 0.0, *columns, *rows, 0.0, 1.0);
                geometry.draw_range(pass, indices.clone());
            }
        });
    });
    let meaning = "a bit for each slice, 32 slices a word; columns of the pass fastest, then rows";
    let output = |(number, slices)| words(&format!("slices-{number}"), meaning, slices);
    let outputs: Vec<_> = slicemaps.iter().enumerate().map(output).collect();
    Ok(stage.outputs(outputs).leaving(slicemaps))
}
