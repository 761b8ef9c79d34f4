//! Adds a stage of one's own behind the underwater pipeline and times both on the audited clock.
//!
//! The stage darkens the final image towards its corners. `cargo run --release --example own_stage`.

use anyhow::Context;
use fathom::gpu::{ColorTarget, FrameTimer, Gpu, Options, StageScope, Targets, audit};
use fathom::pipelines;
use fathom::record::Work;
use fathom::scene::{Scene, SceneFile};
use fathom::stages::Stage;

/// Vignette by a blended screen triangle, whose alpha grows with the distance from the middle.
const SHADER: &str = "
@vertex
fn vertex(@builtin(vertex_index) i: u32) -> @builtin(position) vec4<f32> {
    return vec4(f32(i & 1u) * 4.0 - 1.0, f32(i >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}
@fragment
fn fragment(@builtin(position) pixel: vec4<f32>) -> @location(0) vec4<f32> {
    let from_middle = length(pixel.xy / 400.0 - 1.0);
    return vec4(0.0, 0.0, 0.0, 0.3 * from_middle * from_middle);
}";

struct Vignette {
    pipeline: wgpu::RenderPipeline,
    view: wgpu::TextureView,
    pixels: u64,
}

impl Vignette {
    fn new(gpu: &Gpu, image: &wgpu::Texture) -> Self {
        let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("post/vignette"),
            source: wgpu::ShaderSource::Wgsl(SHADER.into()),
        });
        let target = wgpu::ColorTargetState {
            format: image.format(),
            blend: Some(wgpu::BlendState::ALPHA_BLENDING),
            write_mask: wgpu::ColorWrites::ALL,
        };
        let pipeline = gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("post/vignette"),
            layout: None,
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some("vertex"),
                compilation_options: Default::default(),
                buffers: &[],
            },
            primitive: Default::default(),
            depth_stencil: None,
            multisample: Default::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: Some("fragment"),
                compilation_options: Default::default(),
                targets: &[Some(target)],
            }),
            multiview_mask: None,
            cache: None,
        });
        Self {
            pipeline,
            view: image.create_view(&Default::default()),
            pixels: u64::from(image.width()) * u64::from(image.height()),
        }
    }
}

impl Stage for Vignette {
    fn name(&self) -> &'static str {
        "post/vignette"
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        let color = [ColorTarget { view: &self.view, clear: None, slice: None }];
        let targets = Targets { color: &color, depth: None };
        scope.render(&targets, |pass| {
            pass.set_pipeline(&self.pipeline);
            pass.draw(0..3, 0..1);
        });
    }

    fn work(&self) -> Work {
        Work { fragments: self.pixels, bytes_written: self.pixels * 4, ..Work::default() }
    }
}

fn main() -> anyhow::Result<()> {
    let gpu = Gpu::open(&Options::default())?;
    let clock = audit(&gpu)?;

    let file = SceneFile::load("tank")?;
    let scene = Scene::build(&file)?;
    let kind = pipelines::find("underwater").context("the underwater pipeline is built in")?;
    let params = (kind.defaults)(&file);
    let pipeline = gpu.scoped(|| (kind.build)(&gpu, &scene, &params))?;
    let vignette = gpu.scoped(|| Ok(Vignette::new(&gpu, pipeline.image())))?;

    let mut stages = pipeline.stages();
    stages.push(&vignette);
    let passes: Vec<&dyn Stage> = stages.iter().map(|stage| *stage as &dyn Stage).collect();
    let mut timer = FrameTimer::new(&gpu, clock.plan, 64)?;
    // The first frames compile the shaders.
    for _ in 0..3 {
        timer.untimed(&gpu, &passes)?;
    }
    let frame = timer.timed(&gpu, &passes)?;
    for (stage, sample) in stages.iter().zip(&frame.stages) {
        let fragments = stage.work().fragments;
        let bound = if sample.is_resolved() { "" } else { "<" };
        println!(
            "{:18} {bound:1}{:8.3} ms  {fragments:>9} fragments declared",
            sample.name,
            sample.at_least_resolution_ns() / 1e6
        );
    }
    Ok(())
}
