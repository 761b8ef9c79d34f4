//! Adds a stage of one's own behind the underwater pipeline and times both on the audited clock.
//!
//! The stage darkens the final image towards its corners. `cargo run --release --example own_stage`. A crate with pipelines of
//! its own, and all of fathom's commands over them, is in `examples/own_pipeline`.

use std::io::Write;

use fathom::Catalog;
use fathom::embedded::Folder;
use fathom::gpu::{FrameTimer, Gpu, Options, audit};
use fathom::harness::subject::Subjects;
use fathom::stages::prelude::*;
use glam::{UVec2, Vec2};

const INFO: StageInfo = StageInfo::unlisted("post/vignette");
const SHADERS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/own_stage/shaders");

shader_struct! {
    /// `Vignette` in `shaders/post/vignette.wgsl`.
    pub struct VignetteUniforms {
        pub size_px: Vec2,
    }
}

fn vignette(resources: &Resources<'_>, image: &wgpu::Texture) -> Result<Stage, GpuError> {
    let [width, height] = kit::size_px(image);
    let size_px = UVec2::new(width, height).as_vec2();
    let uniforms = resources.uniform(INFO.name, &VignetteUniforms { size_px });
    let groups = [&Group::new(&[&uniforms])];
    let blend = Some(wgpu::BlendState::ALPHA_BLENDING);
    let targets = [wgpu::ColorTargetState { blend, ..kit::opaque(image.format()) }];
    let pass = Pass::onto(resources, &RenderSpec::new(INFO.name, &groups, &targets), image)?;
    let work = pass.work(0, 4);
    Ok(pass.stage(&INFO, work).leaving(()))
}

fn main() -> anyhow::Result<()> {
    let catalog = Catalog::builtin().shaders(Folder::at(SHADERS));
    let shaders = Some(catalog.shaders.clone());
    let gpu = Gpu::open(&Options { shaders, ..Options::default() })?;
    let clock = audit(&gpu)?;

    let subject = Subjects::of(&catalog).subject("underwater", "tank", &[])?;
    let pipeline = subject.build(&gpu)?;
    let resources = Resources::new(&gpu);
    let vignette = gpu.scoped(|| vignette(&resources, pipeline.image()))?;

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
        let fragments = stage.work.fragments;
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
