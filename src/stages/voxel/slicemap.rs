//! `voxel/slicemap-x`, `-y`, `-z`: the scene drawn along an axis, each fragment setting the bit of its depth slice. VAO §4.2.
//!
//! A fragment sets one voxel, that of the surface at the middle of its pixel: where a surface is steep to the axis, voxels stay
//! empty, and the passes along the other axes fill them.
//!
//! Most triangles of scanned models are smaller than a pixel, and most of those cover no pixel's centre. Raster units set each up and
//! shade four pixels for each fragment, so a compute shader takes the small ones, by the same rule (Karis, Stubbe and Wihlidal,
//! *Nanite: A Deep Dive*, SIGGRAPH 2021).

use serde::{Deserialize, Serialize};

use super::{VoxelPart, triangles, words};
use crate::geometry::Geometry;
use crate::prelude::*;
use fathom_gpu::kit::{Canvas, Raster};
use fathom_scene::Grid;

pub const INFO_X: StageInfo =
    slicemap("voxel/slicemap-x", "bits of depth slices along x by atomic OR, all in one pass");
pub const INFO_Y: StageInfo =
    slicemap("voxel/slicemap-y", "bits of depth slices along y by atomic OR, all in one pass");
pub const INFO_Z: StageInfo =
    slicemap("voxel/slicemap-z", "bits of depth slices along z by atomic OR, all in one pass");

const fn slicemap(name: &'static str, about: &'static str) -> StageInfo {
    StageInfo { name, about, source: "VAO §4.2" }
}

/// Format of the target that a render pass must have: nothing is written to it.
const DUMMY: wgpu::TextureFormat = wgpu::TextureFormat::R8Unorm;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SliceAxis {
    X,
    Y,
    Z,
}

impl SliceAxis {
    pub const ALL: [SliceAxis; 3] = [SliceAxis::X, SliceAxis::Y, SliceAxis::Z];

    /// The stage's.
    pub fn info(self) -> &'static StageInfo {
        match self {
            SliceAxis::X => &INFO_X,
            SliceAxis::Y => &INFO_Y,
            SliceAxis::Z => &INFO_Z,
        }
    }

    /// A voxel's column, row and slice; of a grid's cells how many of them there are.
    pub fn turn(self, [x, y, z]: [u32; 3]) -> [u32; 3] {
        match self {
            SliceAxis::X => [y, z, x],
            SliceAxis::Y => [x, z, y],
            SliceAxis::Z => [x, y, z],
        }
    }

    /// Size of a slicemap of 32 slices a word.
    pub fn slicemap_bytes(self, grid: &Grid) -> u64 {
        let [columns, rows, slices] = self.turn(grid.cells).map(u64::from);
        columns * rows * slices.div_ceil(32) * 4
    }
}

/// Who rasterizes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Rasterizer {
    /// A compute shader the small triangles, the raster units the large ones.
    Mixed,
    /// The raster units all of them: VAO §4.2.
    Hardware,
}

fathom_base::choices!(Rasterizer);

/// Pixels that the box of a small triangle has at most, at rest and seen along any axis.
const SMALL_PIXELS: f64 = 64.0;
/// Of a triangle that is turned: a thin one's box may be twice as long, and as wide. Triangles that stretch further are for the raster
/// units.
const MAX_SMALL_ITERATIONS: u64 = (2 * SMALL_PIXELS as u64).pow(2) + 1;

/// A part's triangles by who rasterizes them: three indices each. None of no triangles.
struct Split {
    small: Option<Buffer>,
    large: Option<Buffer>,
}

impl Split {
    fn new(
        resources: &Resources<'_>,
        geometry: &Geometry,
        VoxelPart { voxels, indices }: &VoxelPart,
        rasterizer: Rasterizer,
    ) -> Self {
        let is_small = |triangle: usize| {
            let pixels = |side: f32| 1.0 + f64::from(side) / voxels.grid.voxel_m;
            let [long, short] = geometry.sizes[triangle].sides_m.map(pixels);
            rasterizer == Rasterizer::Mixed && long * short <= SMALL_PIXELS
        };
        let [first, end] = [indices.start, indices.end].map(|index| index as usize / 3);
        let (small, large): (Vec<_>, Vec<_>) =
            (first..end).partition(|triangle| is_small(*triangle));
        let buffer = |triangles: Vec<usize>| {
            let corners = triangles.iter().flat_map(|t| &geometry.corners[3 * t..3 * t + 3]);
            let corners: Vec<u32> = corners.copied().collect();
            let usage = wgpu::BufferUsages::INDEX | wgpu::BufferUsages::STORAGE;
            let bytes = bytemuck::cast_slice(&corners);
            (!corners.is_empty()).then(|| resources.filled("slicemap indices", bytes, usage))
        };
        Self { small: buffer(small), large: buffer(large) }
    }
}

/// Indices in a buffer of them.
fn count(indices: &Buffer) -> u32 {
    (indices.size() / 4) as u32
}

/// The stages of the axes. Each leaves each volume's slices: words of 32 slices, layers of the pass's columns × rows.
pub fn new(
    resources: &Resources<'_>,
    geometry: &Geometry,
    parts: &[VoxelPart],
    rasterizer: Rasterizer,
) -> Result<[Stage<Vec<Buffer>>; 3], GpuError> {
    let split = |part| Split::new(resources, geometry, part, rasterizer);
    let splits: Vec<_> = parts.iter().map(split).collect();
    if splits.iter().any(|split| split.small.is_some()) {
        resources.iterations("small triangles", MAX_SMALL_ITERATIONS);
    }
    let [x, y, z] = SliceAxis::ALL.map(|axis| along(resources, geometry, parts, &splits, axis));
    Ok([x?, y?, z?])
}

fn along(
    resources: &Resources<'_>,
    geometry: &Geometry,
    parts: &[VoxelPart],
    splits: &[Split],
    axis: SliceAxis,
) -> Result<Stage<Vec<Buffer>>, GpuError> {
    let info = axis.info();
    let (defs, targets) = ([("AXIS", axis as i32)], [kit::unwritten_target(DUMMY)]);
    let code = ("voxel/slicemap", &defs);
    let spec = RenderSpec {
        label: info.name,
        buffers: &[Geometry::layout(true)],
        ..RenderSpec::new(code, &[], &targets)
    };
    let (mut slicemaps, mut dispatches, mut draws) = (Vec::new(), Vec::new(), Vec::new());
    let mut largest = [1, 1];
    for (VoxelPart { voxels, .. }, Split { small, large }) in parts.iter().zip(splits) {
        let slices = resources.storage(info.name, axis.slicemap_bytes(&voxels.grid));
        let group = Bindings::new(&[&voxels.uniforms, &slices, &geometry.vertices]).and(small);
        if let Some(small) = small {
            let workgroups = kit::linear_workgroups(u64::from(count(small) / 3));
            dispatches.push(Dispatch::new(resources, code, &[&group], workgroups)?);
        }
        if let Some(large) = large {
            resources.fragment_writes(info.name);
            let raster = Raster::new(resources, &RenderSpec { groups: &[&group], ..spec.clone() })?;
            let [columns, rows, _] = axis.turn(voxels.grid.cells);
            largest = [columns.max(largest[0]), rows.max(largest[1])];
            draws.push((raster, [columns, rows].map(|side| side as f32), large.clone()));
        }
        slicemaps.push(slices);
    }
    let canvas = Canvas::new(resources, &spec, largest, None);
    let work =
        Work { triangles: triangles(parts), bytes_read: geometry.bytes(), ..Work::default() };
    let drawn = draws.iter().map(|(.., large)| u64::from(count(large) / 3)).sum();
    let min_work = Work { triangles: drawn, ..work };
    let vertices = geometry.vertices.clone();
    let stage = Stage::new(info, work, move |scope| {
        if !dispatches.is_empty() {
            Dispatch::pass(&dispatches, scope);
        }
        if draws.is_empty() {
            return;
        }
        canvas.render(scope, |pass| {
            pass.set_vertex_buffer(0, vertices.slice(..));
            for (raster, [columns, rows], large) in &draws {
                raster.bind(pass);
                pass.set_viewport(0.0, 0.0, *columns, *rows, 0.0, 1.0);
                pass.set_index_buffer(large.slice(..), wgpu::IndexFormat::Uint32);
                pass.draw_indexed(0..count(large), 0, 0..1);
            }
        });
    });
    Ok(stage.with_min_work(min_work).dumps(outputs(&slicemaps)).with_output(slicemaps))
}

fn outputs(slicemaps: &[Buffer]) -> Vec<StageDump> {
    let meaning = "a bit for each slice, 32 slices a word; columns of the pass fastest, then rows";
    let output = |(number, slices)| words(&format!("slices-{number}"), meaning, slices);
    slicemaps.iter().enumerate().map(output).collect()
}
