//! `voxel/slicemap-x`, `-y`, `-z`: the scene drawn along an axis, each fragment setting the bit of its depth slice. VAO §4.2.
//!
//! A fragment sets one voxel, that of the surface at the middle of its pixel: where a surface is steep to the axis, voxels stay
//! empty, and the passes along the other axes fill them.

use super::{Part, triangles, words};
use crate::geometry::Geometry;
use crate::kit::{self, Bind, Buffer, Group, Raster, RenderSpec, Resources};
use crate::{Output, Stage, StageInfo};
use fathom_gpu::{ColorTarget, GpuError, StageScope, Targets};
use fathom_record::Work;
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

/// One volume's share of a pass.
struct Draw {
    group: Group,
    part: Part,
    size_px: [u32; 2],
    slices: Buffer,
}

pub struct Slicemap {
    axis: Axis,
    raster: Raster,
    geometry: Geometry,
    draws: Vec<Draw>,
    dummy: wgpu::TextureView,
}

impl Slicemap {
    pub fn new(
        resources: &Resources<'_>,
        geometry: &Geometry,
        parts: &[Part],
        axis: Axis,
    ) -> Result<Self, GpuError> {
        let name = axis.info().name;
        let draw = |part: &Part| {
            let grid = &part.voxels.grid;
            let slices = resources.storage(name, axis.slicemap_bytes(grid));
            let [columns, rows, _] = axis.turned(grid);
            let binds = [Bind::Uniform(&part.voxels.uniforms), Bind::Write(&slices)];
            let group = Group::new(resources.gpu, name, &binds);
            Draw { group, part: part.clone(), size_px: [columns, rows], slices }
        };
        let draws: Vec<Draw> = parts.iter().map(draw).collect();
        let groups: Vec<&Group> = draws.iter().take(1).map(|draw| &draw.group).collect();
        let write_mask = wgpu::ColorWrites::empty();
        let target = [wgpu::ColorTargetState { write_mask, ..kit::opaque(DUMMY) }];
        let defs = [("AXIS", axis as i32)];
        let spec = RenderSpec {
            buffers: &[Geometry::layout(true)],
            ..RenderSpec::new(name, ("voxel/slicemap", &defs[..]), &groups, &target)
        };
        let raster = Raster::new(resources, &spec)?;
        let largest = |side: usize| draws.iter().map(|d| d.size_px[side]).max().unwrap_or(1);
        let dummy = kit::view(&resources.target(name, [largest(0), largest(1)], DUMMY));
        Ok(Self { axis, raster, geometry: geometry.clone(), draws, dummy })
    }

    /// Each volume's slices: words of 32 slices, layers of the pass's columns × rows.
    pub fn slicemaps(&self) -> impl Iterator<Item = &Buffer> {
        self.draws.iter().map(|draw| &draw.slices)
    }
}

impl Stage for Slicemap {
    fn info(&self) -> &'static StageInfo {
        self.axis.info()
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        let color = [ColorTarget { view: &self.dummy, clear: None, slice: None }];
        scope.render(&Targets { color: &color, depth: None }, |pass| {
            self.raster.bind(pass);
            for draw in &self.draws {
                let [columns, rows] = draw.size_px.map(|n| n as f32);
                pass.set_viewport(0.0, 0.0, columns, rows, 0.0, 1.0);
                pass.set_bind_group(0, &draw.group.group, &[]);
                self.geometry.draw_range(pass, draw.part.indices.clone());
            }
        });
    }

    fn work(&self) -> Work {
        let parts: Vec<Part> = self.draws.iter().map(|draw| draw.part.clone()).collect();
        Work { triangles: triangles(&parts), bytes_read: self.geometry.bytes(), ..Work::default() }
    }

    fn outputs(&self) -> Vec<Output> {
        let meaning =
            "a bit for each slice, 32 slices a word; columns of the pass fastest, then rows";
        let output = |(number, slices)| words(format!("slices-{number}"), meaning, slices);
        self.slicemaps().enumerate().map(output).collect()
    }
}
