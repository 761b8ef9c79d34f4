//! Kernels that draw: fill and small triangles.

use super::kernel::{BenchKernel, KernelOutput, KernelWork, MAX_TURNS};
use crate::kit::{
    Bindings, Canvas, Raster, RenderSpec, Resources, additive, draw_fullscreen, opaque,
};
use crate::{Gpu, GpuError, MAX_ITERATIONS, StageScope};

/// Edge of the target of fill in pixels: a pass takes much longer than its beginning and end.
const SOFTWARE_EDGE: u32 = 512;
const GPU_EDGE: u32 = 2048;
/// That of fragments that load and compute.
const SOFTWARE_SHADED_EDGE: u32 = 128;
const GPU_SHADED_EDGE: u32 = 1024;
/// Half floats count by ones up to here.
const MAX_HALF: f64 = 2048.0;
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
        match format {
            wgpu::TextureFormat::R8Unorm | wgpu::TextureFormat::Rgba8Unorm => {
                (ones / 255.0).min(1.0)
            }
            wgpu::TextureFormat::R16Float | wgpu::TextureFormat::Rgba16Float => ones.min(MAX_HALF),
            _ => ones,
        }
    };
    Ok(BenchKernel {
        work_per_iteration: f64::from(edge).powi(2),
        max_iterations: MAX_TURNS,
        uniform: None,
        output: KernelOutput::Texels(target),
        expected: Box::new(expected),
        encode: Box::new(encode),
    })
}

/// Fragments of this entry point, whose turn is so much work and adds `result`.
pub(super) fn shade(
    gpu: &Gpu,
    fragment: &str,
    (work, result): (u32, u32),
    reads: &[Bindings],
) -> Result<BenchKernel, GpuError> {
    let edge = if gpu.adapter.software { SOFTWARE_SHADED_EDGE } else { GPU_SHADED_EDGE };
    let resources = Resources::new(gpu);
    let uniform = resources.uniform("ceiling", &KernelWork::new(0));
    let own = Bindings::new(&[&uniform]);
    let groups: Vec<_> = std::iter::once(&own).chain(reads).collect();
    let targets = [opaque(wgpu::TextureFormat::R32Float)];
    let code = ("ceilings/raster", &[("UNORM", 0)]);
    let spec = RenderSpec {
        vertex: "whole",
        fragment: Some(fragment),
        ..RenderSpec::new(code, &groups, &targets)
    };
    let canvas = Canvas::new(&resources, &spec, [edge; 2], wgpu::Color::TRANSPARENT);
    let (raster, target) = (Raster::new(&resources, &spec)?, canvas.textures[0].clone());
    let encode = move |scope: &mut StageScope<'_>, _| {
        canvas.render(scope, |pass| {
            raster.bind(pass);
            draw_fullscreen(pass);
        });
    };
    Ok(BenchKernel {
        work_per_iteration: f64::from(edge).powi(2) * f64::from(work),
        // Sums are exact in 32-bit floats.
        max_iterations: (MAX_ITERATIONS as u32).min(MAX_TURNS / result),
        uniform: Some(uniform),
        output: KernelOutput::Texels(target),
        expected: Box::new(move |turns| f64::from(result) * f64::from(turns)),
        encode: Box::new(encode),
    })
}

/// A grid of triangles, each as large as a pixel, that all face away or are all drawn.
pub(super) fn small_triangles(gpu: &Gpu, drawn: bool) -> Result<BenchKernel, GpuError> {
    let culled = (!drawn).then_some(wgpu::Face::Front);
    let (vertex, format) = (("grid", culled), wgpu::TextureFormat::R8Unorm);
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
        uniform: None,
        output: KernelOutput::Texels(target),
        // The triangles cover each pixel once.
        expected: Box::new(
            move |turns| if drawn { (f64::from(turns) / 255.0).min(1.0) } else { 0.0 },
        ),
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
    let is_unorm =
        [wgpu::TextureFormat::R8Unorm, wgpu::TextureFormat::Rgba8Unorm].contains(&format);
    let defs = [("UNORM", i32::from(is_unorm))];
    let targets = [if is_blended { additive(format) } else { opaque(format) }];
    let spec = RenderSpec {
        vertex,
        cull_mode,
        ..RenderSpec::new(("ceilings/raster", &defs), &[], &targets)
    };
    let canvas = Canvas::new(&resources, &spec, size_px, wgpu::Color::TRANSPARENT);
    Ok((Raster::new(&resources, &spec)?, canvas))
}
