//! Kernels that draw: fill and small primitives.

use super::kernel::{Kernel, all_are, format, is_unorm};
use crate::readback::read_texture;
use crate::shader::compilation_options;
use crate::{ColorTarget, DepthTarget, StageScope, Targets};
use crate::{Gpu, GpuError};
use fathom_record::ceilings::{Blending, SmallPrimitive, TexelFormat};

/// Edge of the target of fill in pixels: a pass takes much longer than its beginning and end.
const SOFTWARE_EDGE: u32 = 512;
const GPU_EDGE: u32 = 2048;
/// The grid of small primitives: its cells are two pixels wide and one high.
const COLUMNS: u32 = 128;
const ROWS: u32 = 256;
/// Sums of ones are exact in 16-bit floats up to here, and stay there.
const MOST_HALF: u32 = 2048;
/// Largest sum of steps of an 8-bit format.
const MOST_UNORM: u32 = 255;

/// How a turn is drawn.
#[derive(Clone, Copy)]
enum Turned {
    /// In a pass of its own: within a pass a driver leaves out what is drawn over.
    Passes,
    /// As an instance.
    Instances,
}

/// A pipeline without bindings and its target.
pub(super) struct Raster {
    pipeline: wgpu::RenderPipeline,
    target: wgpu::Texture,
    view: wgpu::TextureView,
    indices: Option<wgpu::Buffer>,
    vertices: u32,
    turned: Turned,
    per_turn: f64,
    /// What every pixel must hold after so many turns.
    answer: Box<dyn Fn(u32) -> f64>,
}

/// What the constructors choose of a pipeline.
struct Draw<'a> {
    vertex: &'a str,
    defs: &'a [(&'a str, i32)],
    format: TexelFormat,
    blending: Blending,
    topology: wgpu::PrimitiveTopology,
    cull: Option<wgpu::Face>,
}

impl Raster {
    /// A triangle over the whole target.
    pub(super) fn fill(gpu: &Gpu, of: TexelFormat, blending: Blending) -> Result<Self, GpuError> {
        let edge = if gpu.adapter.software { SOFTWARE_EDGE } else { GPU_EDGE };
        let opaque = blending == Blending::Opaque;
        let defs = [("UNORM", i32::from(is_unorm(of) && !opaque))];
        let draw = Draw {
            vertex: "whole",
            defs: &defs,
            format: of,
            blending,
            topology: wgpu::PrimitiveTopology::TriangleList,
            cull: None,
        };
        let target = target(gpu, format(of), [edge; 2]);
        let answer: Box<dyn Fn(u32) -> f64> = if of == TexelFormat::Depth32Float {
            Box::new(|_| 0.5)
        } else if opaque {
            Box::new(|_| 1.0)
        } else {
            Box::new(move |turns| added(of, turns))
        };
        Ok(Self {
            pipeline: pipeline(gpu, &draw)?,
            view: target.create_view(&Default::default()),
            target,
            indices: None,
            vertices: 3,
            turned: if opaque { Turned::Passes } else { Turned::Instances },
            per_turn: f64::from(edge).powi(2),
            answer,
        })
    }

    /// A grid of primitives, each as large as a pixel.
    pub(super) fn primitives(gpu: &Gpu, primitive: SmallPrimitive) -> Result<Self, GpuError> {
        use SmallPrimitive::{ClippedPoint, CulledTriangle, Point, Triangle};
        let drawn = matches!(primitive, Triangle | Point);
        let triangles = matches!(primitive, Triangle | CulledTriangle);
        let defs = [("CLIPPED", i32::from(primitive == ClippedPoint))];
        let draw = Draw {
            vertex: if triangles { "grid" } else { "point" },
            defs: &defs,
            format: TexelFormat::R16Float,
            blending: Blending::Additive,
            topology: if triangles {
                wgpu::PrimitiveTopology::TriangleList
            } else {
                wgpu::PrimitiveTopology::PointList
            },
            cull: (primitive == CulledTriangle).then_some(wgpu::Face::Front),
        };
        let target = target(gpu, wgpu::TextureFormat::R16Float, [2 * COLUMNS, ROWS]);
        let count = 2 * COLUMNS * ROWS;
        let all = move |turns| if drawn { added(TexelFormat::R16Float, turns) } else { 0.0 };
        Ok(Self {
            pipeline: pipeline(gpu, &draw)?,
            view: target.create_view(&Default::default()),
            target,
            indices: triangles.then(|| indices(gpu)),
            vertices: if triangles { 3 * count } else { count },
            turned: Turned::Instances,
            per_turn: f64::from(count),
            answer: Box::new(all),
        })
    }

    fn draw(&self, pass: &mut wgpu::RenderPass<'_>, instances: u32) {
        pass.set_pipeline(&self.pipeline);
        match &self.indices {
            Some(indices) => {
                pass.set_index_buffer(indices.slice(..), wgpu::IndexFormat::Uint32);
                pass.draw_indexed(0..self.vertices, 0, 0..instances);
            }
            None => pass.draw(0..self.vertices, 0..instances),
        }
    }
}

/// What so many ones, added one by one, make in a format.
fn added(of: TexelFormat, turns: u32) -> f64 {
    match of {
        TexelFormat::R8Unorm | TexelFormat::Rgba8Unorm => {
            f64::from(turns.min(MOST_UNORM)) / f64::from(MOST_UNORM)
        }
        TexelFormat::R16Float | TexelFormat::Rgba16Float => f64::from(turns.min(MOST_HALF)),
        _ => f64::from(turns),
    }
}

/// Two triangles of each cell, counter-clockwise.
fn indices(gpu: &Gpu) -> wgpu::Buffer {
    use wgpu::util::DeviceExt as _;
    let cells = (0..ROWS).flat_map(|row| (0..COLUMNS).map(move |column| (row, column)));
    let corners = cells.flat_map(|(row, column)| {
        let first = row * (COLUMNS + 1) + column;
        let above = first + COLUMNS + 1;
        [first, first + 1, above, above, first + 1, above + 1]
    });
    let contents: Vec<u8> = corners.flat_map(u32::to_le_bytes).collect();
    gpu.device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
        label: Some("ceiling"),
        contents: &contents,
        usage: wgpu::BufferUsages::INDEX,
    })
}

pub(super) fn target(gpu: &Gpu, format: wgpu::TextureFormat, edges: [u32; 2]) -> wgpu::Texture {
    gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some("ceiling"),
        size: wgpu::Extent3d { width: edges[0], height: edges[1], depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
        view_formats: &[],
    })
}

fn pipeline(gpu: &Gpu, draw: &Draw<'_>) -> Result<wgpu::RenderPipeline, GpuError> {
    let shader = gpu.shader("ceilings/raster", draw.defs)?;
    let one = wgpu::BlendComponent {
        src_factor: wgpu::BlendFactor::One,
        dst_factor: wgpu::BlendFactor::One,
        operation: wgpu::BlendOperation::Add,
    };
    let blend = wgpu::BlendState { color: one, alpha: one };
    let color = [Some(wgpu::ColorTargetState {
        format: format(draw.format),
        blend: (draw.blending == Blending::Additive).then_some(blend),
        write_mask: wgpu::ColorWrites::ALL,
    })];
    let depth = draw.format == TexelFormat::Depth32Float;
    Ok(gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("ceiling"),
        layout: None,
        vertex: wgpu::VertexState {
            module: &shader.module,
            entry_point: Some(draw.vertex),
            compilation_options: compilation_options(),
            buffers: &[],
        },
        primitive: wgpu::PrimitiveState {
            topology: draw.topology,
            cull_mode: draw.cull,
            ..Default::default()
        },
        depth_stencil: depth.then(|| wgpu::DepthStencilState {
            format: wgpu::TextureFormat::Depth32Float,
            depth_write_enabled: Some(true),
            depth_compare: Some(wgpu::CompareFunction::Always),
            stencil: wgpu::StencilState::default(),
            bias: wgpu::DepthBiasState::default(),
        }),
        multisample: wgpu::MultisampleState::default(),
        fragment: (!depth).then(|| wgpu::FragmentState {
            module: &shader.module,
            entry_point: Some("one"),
            compilation_options: compilation_options(),
            targets: &color,
        }),
        multiview_mask: None,
        cache: None,
    }))
}

impl Kernel for Raster {
    fn work_per_turn(&self) -> f64 {
        self.per_turn
    }

    fn encode(&self, scope: &mut StageScope<'_>, turns: u32) {
        let (passes, instances) = match self.turned {
            Turned::Passes => (turns, 1),
            Turned::Instances => (1, turns),
        };
        // Only the first pass clears.
        let color = [Some(wgpu::Color::TRANSPARENT), None]
            .map(|clear| [ColorTarget { view: &self.view, clear, slice: None }]);
        let targets = |pass: u32| match self.target.format() {
            wgpu::TextureFormat::Depth32Float => {
                let clear = (pass == 0).then_some(0.0);
                let depth = DepthTarget { view: &self.view, clear, read_only: false };
                Targets { color: &[], depth: Some(depth) }
            }
            _ => Targets { color: &color[usize::from(pass > 0)], depth: None },
        };
        let series: Vec<Targets<'_>> = (0..passes).map(targets).collect();
        scope.render_series(&series, |_, pass| self.draw(pass, instances));
    }

    fn compare(&self, gpu: &Gpu, turns: u32) -> Result<Result<(), String>, GpuError> {
        let texels = read_texture(gpu, &self.target)?.data;
        Ok(all_are(texels.into_iter().map(f64::from), (self.answer)(turns), 1e-6))
    }
}
