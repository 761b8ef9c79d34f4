//! Kernels that draw: fill and small triangles.

use super::kernel::{BenchKernel, KernelOutput, MAX_TURNS};
use crate::kit::{Canvas, Raster, RenderSpec, Resources, additive, opaque};
use crate::{Gpu, GpuError, StageScope};

/// Edge of the target of fill in pixels: a pass takes much longer than its beginning and end.
const SOFTWARE_EDGE: u32 = 512;
const GPU_EDGE: u32 = 2048;
/// The grid of small triangles, as in the shader: its cells are two pixels wide and one high.
const COLUMNS: u32 = 128;
const ROWS: u32 = 256;

/// A triangle over the whole target.
pub(super) fn fill(
    gpu: &Gpu,
    format: wgpu::TextureFormat,
    is_blended: bool,
) -> Result<BenchKernel, GpuError> {
    let edge = if gpu.adapter.software { SOFTWARE_EDGE } else { GPU_EDGE };
    let (raster, canvas) = targets(gpu, ("whole", None), (format, is_blended), [edge; 2])?;
    let target = canvas.textures[0].clone();
    let encode = move |scope: &mut StageScope<'_>, turns| {
        // Within a pass a driver leaves out what is drawn over.
        let (passes, instances) = if is_blended { (1, turns) } else { (turns, 1) };
        canvas.series(scope, passes as usize, |_, pass| {
            raster.bind(pass);
            pass.draw(0..3, 0..instances);
        });
    };
    let expected = move |turns| {
        let ones = if is_blended { f64::from(turns) } else { 1.0 };
        if format == wgpu::TextureFormat::R8Unorm { (ones / 255.0).min(1.0) } else { ones }
    };
    Ok(BenchKernel {
        work_per_iteration: f64::from(edge).powi(2),
        max_iterations: MAX_TURNS,
        frame_of: None,
        uniform: None,
        output: KernelOutput::Texels(target),
        expected: Box::new(expected),
        encode: Box::new(encode),
    })
}

/// A grid of triangles, each as large as a pixel, that all face away.
pub(super) fn small_triangles(gpu: &Gpu) -> Result<BenchKernel, GpuError> {
    let (vertex, format) = (("grid", Some(wgpu::Face::Front)), wgpu::TextureFormat::R8Unorm);
    let (raster, canvas) = targets(gpu, vertex, (format, true), [2 * COLUMNS, ROWS])?;
    let target = canvas.textures[0].clone();
    let (indices, triangles) = (indices(gpu), 2 * COLUMNS * ROWS);
    let encode = move |scope: &mut StageScope<'_>, turns| {
        canvas.render(scope, |pass| {
            raster.bind(pass);
            pass.set_index_buffer(indices.slice(..), wgpu::IndexFormat::Uint32);
            pass.draw_indexed(0..3 * triangles, 0, 0..turns);
        });
    };
    Ok(BenchKernel {
        work_per_iteration: f64::from(triangles),
        max_iterations: MAX_TURNS,
        frame_of: None,
        uniform: None,
        output: KernelOutput::Texels(target),
        expected: Box::new(|_| 0.0),
        encode: Box::new(encode),
    })
}

/// Two triangles of each cell, counter-clockwise.
fn indices(gpu: &Gpu) -> wgpu::Buffer {
    let cells = (0..ROWS).flat_map(|row| (0..COLUMNS).map(move |column| (row, column)));
    let corners = cells.flat_map(|(row, column)| {
        let first = row * (COLUMNS + 1) + column;
        let above = first + COLUMNS + 1;
        [first, first + 1, above, above, first + 1, above + 1]
    });
    let contents: Vec<u8> = corners.flat_map(u32::to_le_bytes).collect();
    gpu.filled("ceiling", &contents, wgpu::BufferUsages::INDEX)
}

/// A pipeline that adds or writes ones, and what it draws into.
fn targets(
    gpu: &Gpu,
    (vertex, cull_mode): (&str, Option<wgpu::Face>),
    (format, is_blended): (wgpu::TextureFormat, bool),
    size_px: [u32; 2],
) -> Result<(Raster, Canvas), GpuError> {
    let resources = Resources::new(gpu);
    let defs = [("UNORM", i32::from(format == wgpu::TextureFormat::R8Unorm))];
    let targets = [if is_blended { additive(format) } else { opaque(format) }];
    let spec = RenderSpec {
        vertex,
        cull_mode,
        ..RenderSpec::new(("ceilings/raster", &defs), &[], &targets)
    };
    let canvas = Canvas::new(&resources, &spec, size_px, wgpu::Color::TRANSPARENT);
    Ok((Raster::new(&resources, &spec)?, canvas))
}
