//! Kernels that draw: fill and small triangles.

use super::kernel::{BenchKernel, KernelOutput, MAX_TURNS};
use crate::shader::compilation_options;
use crate::{ColorTarget, Gpu, GpuError, StageScope, Targets};

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
    let pipeline = pipeline(gpu, ("whole", None), format, is_blended)?;
    let target = target(gpu, format, [edge; 2]);
    let view = target.create_view(&Default::default());
    let encode = move |scope: &mut StageScope<'_>, turns| {
        // Within a pass a driver leaves out what is drawn over.
        let (passes, instances) = if is_blended { (1, turns) } else { (turns, 1) };
        render(scope, &view, passes, |pass| {
            pass.set_pipeline(&pipeline);
            pass.draw(0..3, 0..instances);
        });
    };
    let expected = move |turns| {
        let ones = if is_blended { f64::from(turns) } else { 1.0 };
        if format == wgpu::TextureFormat::R8Unorm { (ones / 255.0).min(1.0) } else { ones }
    };
    Ok(BenchKernel {
        work_per_turn: f64::from(edge).powi(2),
        max_turns: MAX_TURNS,
        frame_of: None,
        uniform: None,
        output: KernelOutput::Texels(target),
        expected: Box::new(expected),
        encode: Box::new(encode),
    })
}

/// A grid of triangles, each as large as a pixel, that all face away.
pub(super) fn small_triangles(gpu: &Gpu) -> Result<BenchKernel, GpuError> {
    let format = wgpu::TextureFormat::R8Unorm;
    let pipeline = pipeline(gpu, ("grid", Some(wgpu::Face::Front)), format, true)?;
    let target = target(gpu, format, [2 * COLUMNS, ROWS]);
    let view = target.create_view(&Default::default());
    let (indices, triangles) = (indices(gpu), 2 * COLUMNS * ROWS);
    let encode = move |scope: &mut StageScope<'_>, turns| {
        render(scope, &view, 1, |pass| {
            pass.set_pipeline(&pipeline);
            pass.set_index_buffer(indices.slice(..), wgpu::IndexFormat::Uint32);
            pass.draw_indexed(0..3 * triangles, 0, 0..turns);
        });
    };
    Ok(BenchKernel {
        work_per_turn: f64::from(triangles),
        max_turns: MAX_TURNS,
        frame_of: None,
        uniform: None,
        output: KernelOutput::Texels(target),
        expected: Box::new(|_| 0.0),
        encode: Box::new(encode),
    })
}

fn render(
    scope: &mut StageScope<'_>,
    view: &wgpu::TextureView,
    passes: u32,
    draw: impl Fn(&mut wgpu::RenderPass<'_>),
) {
    // Only the first pass clears.
    let color = [Some(wgpu::Color::TRANSPARENT), None]
        .map(|clear| [ColorTarget { view, clear, slice: None }]);
    let targets = |pass: u32| Targets { color: &color[usize::from(pass > 0)], depth: None };
    let series: Vec<Targets<'_>> = (0..passes).map(targets).collect();
    scope.render_series(&series, |_, pass| draw(pass));
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

fn target(gpu: &Gpu, format: wgpu::TextureFormat, [width, height]: [u32; 2]) -> wgpu::Texture {
    gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some("ceiling"),
        size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
        view_formats: &[],
    })
}

fn pipeline(
    gpu: &Gpu,
    (vertex, cull_mode): (&str, Option<wgpu::Face>),
    format: wgpu::TextureFormat,
    is_blended: bool,
) -> Result<wgpu::RenderPipeline, GpuError> {
    let is_unorm = format == wgpu::TextureFormat::R8Unorm;
    let shader = gpu.shader("ceilings/raster", &[("UNORM", i32::from(is_unorm))])?;
    let one = wgpu::BlendComponent {
        src_factor: wgpu::BlendFactor::One,
        dst_factor: wgpu::BlendFactor::One,
        operation: wgpu::BlendOperation::Add,
    };
    let blend = is_blended.then_some(wgpu::BlendState { color: one, alpha: one });
    let write_mask = wgpu::ColorWrites::ALL;
    Ok(gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("ceiling"),
        layout: None,
        vertex: wgpu::VertexState {
            module: &shader.module,
            entry_point: Some(vertex),
            compilation_options: compilation_options(),
            buffers: &[],
        },
        primitive: wgpu::PrimitiveState { cull_mode, ..Default::default() },
        depth_stencil: None,
        multisample: wgpu::MultisampleState::default(),
        fragment: Some(wgpu::FragmentState {
            module: &shader.module,
            entry_point: Some("one"),
            compilation_options: compilation_options(),
            targets: &[Some(wgpu::ColorTargetState { format, blend, write_mask })],
        }),
        multiview_mask: None,
        cache: None,
    }))
}
