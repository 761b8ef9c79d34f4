//! Adds a stage of one's own behind the underwater pipeline and times both on the audited clock.
//!
//! The stage darkens the final image towards its corners. `cargo run --release --example own_stage`. A crate with pipelines of
//! its own, and all of fathom's commands over them, is in `examples/own_pipeline`.

use std::io::Write;

use fathom::Catalog;
use fathom::embedded::Folder;
use fathom::gpu::{
    ColorTarget, FrameTimer, Gpu, GpuError, Options, Stage, StageInfo, StageScope, Targets, audit,
};
use fathom::harness::subject::Subjects;
use fathom::record::Work;
use fathom::shader_struct;
use fathom::stages::kit::{self, Bind, Group, Raster, RenderSpec, Resources};
use glam::{UVec2, Vec2};

const NAME: &str = "post/vignette";
const SHADERS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/own_stage/shaders");

shader_struct! {
    /// `Vignette` in `shaders/post/vignette.wgsl`.
    pub struct VignetteUniforms {
        pub size_px: Vec2,
    }
}

struct Vignette {
    raster: Raster,
    groups: Vec<wgpu::BindGroup>,
    image: wgpu::Texture,
    view: wgpu::TextureView,
}

impl Vignette {
    fn new(resources: &Resources<'_>, image: &wgpu::Texture) -> Result<Self, GpuError> {
        let size_px = UVec2::new(image.width(), image.height()).as_vec2();
        let uniforms = resources.uniform(NAME, &VignetteUniforms { size_px });
        let group = Group::new(resources.gpu, NAME, &[Bind::Uniform(&uniforms)]);
        let blend = Some(wgpu::BlendState::ALPHA_BLENDING);
        let targets = [wgpu::ColorTargetState { blend, ..kit::opaque(image.format()) }];
        let groups = [&group];
        let raster = Raster::new(resources, &RenderSpec::new(NAME, NAME, &groups, &targets))?;
        Ok(Self {
            raster,
            groups: kit::bare(&groups),
            view: kit::view(image),
            image: image.clone(),
        })
    }
}

impl Stage for Vignette {
    fn info(&self) -> &'static StageInfo {
        const { &StageInfo::unlisted(NAME) }
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        let color = [ColorTarget { view: &self.view, clear: None, slice: None }];
        scope.render(&Targets { color: &color, depth: None }, |pass| {
            self.raster.bind(pass);
            kit::bind_groups(pass, &self.groups);
            pass.draw(0..3, 0..1);
        });
    }

    fn work(&self) -> Work {
        let pixels = kit::pixels(&self.image);
        Work { fragments: pixels, bytes_written: pixels * 4, ..Work::default() }
    }
}

fn main() -> anyhow::Result<()> {
    let catalog = Catalog::builtin().shaders(Folder::at(SHADERS));
    let shaders = Some(catalog.shaders.clone());
    let gpu = Gpu::open(&Options { shaders, ..Options::default() })?;
    let clock = audit(&gpu)?;

    let subject = Subjects::of(&catalog).subject("underwater", "tank", &[])?;
    let pipeline = subject.build(&gpu)?;
    let resources = Resources::new(&gpu);
    let vignette = gpu.scoped(|| Vignette::new(&resources, pipeline.image()))?;

    let mut stages = pipeline.stages();
    stages.push(&vignette);
    let mut timer = FrameTimer::new(&gpu, clock.plan, 64)?;
    // The first frames compile the shaders.
    for _ in 0..3 {
        timer.untimed(&gpu, &stages)?;
    }
    let frame = timer.timed(&gpu, &stages)?;
    let mut out = std::io::stdout().lock();
    for (stage, sample) in stages.iter().zip(&frame.stages) {
        let fragments = stage.work().fragments;
        let bound = if sample.is_resolved() { "" } else { "<" };
        let ms = sample.at_least_resolution_ns() / 1e6;
        writeln!(
            out,
            "{:18} {bound:1}{ms:8.3} ms  {fragments:>9} fragments declared",
            sample.stage
        )?;
    }
    Ok(())
}
