//! Criterion over every stage at base size (UW §4.1, scene `tank`), through the audited clock, so that criterion's
//! reports show GPU time. Throughput is in photons for the traces and in blended fragments, as counted, for splats and lines.
//!
//! Splats of the base size (5 px) are bound by vertices and triangle set-up on a software rasterizer; the same photons with
//! splats of 20 px, the largest of UW §4.1, are bound by blending.

use std::time::Duration;

use criterion::{Criterion, Throughput};
use fathom::gpu::{Encode, FrameTimer, Gpu, GpuError, Options, audit, audit_table};
use fathom::pipelines::Pipeline;
use fathom::pipelines::underwater::{self, Params, Underwater};
use fathom::record::Work;
use fathom::scene::{Scene, SceneFile};
use fathom::stages::Stage;

fn main() {
    if let Err(error) = run() {
        eprintln!("error: {error:#}");
        std::process::exit(2);
    }
}

fn run() -> anyhow::Result<()> {
    let mut criterion = Criterion::default().configure_from_args();
    let gpu = Gpu::open(&Options::default())?;
    let clock = audit(&gpu)?;
    println!("{}", audit_table(&clock));
    let file = SceneFile::load("tank")?;
    let scene = Scene::build(&file)?;
    let mut timer = FrameTimer::new(&gpu, clock.plan, MAX_PASSES)?;
    let base = Params::from_scene(&file);
    bench(
        &mut criterion,
        &gpu,
        &mut timer,
        &scene,
        "underwater",
        &base,
        |_| true,
    )?;
    let mut large = base;
    large.caustics.point_size_min_px = large.caustics.point_size_max_px;
    bench(
        &mut criterion,
        &gpu,
        &mut timer,
        &scene,
        "underwater, splats of 20 px",
        &large,
        |stage| stage == "caustics/splat",
    )?;
    criterion.final_summary();
    Ok(())
}

/// Passes of a frame, with room to spare.
const MAX_PASSES: u32 = 64;

/// The stages of one configuration whose names are `wanted`.
fn bench(
    criterion: &mut Criterion,
    gpu: &Gpu,
    timer: &mut FrameTimer,
    scene: &Scene,
    group: &str,
    params: &Params,
    wanted: impl Fn(&str) -> bool,
) -> anyhow::Result<()> {
    let fragments = underwater::blended_fragments(gpu, scene, params)?;
    let pipeline = gpu.scoped(|| Underwater::new(gpu, scene, params.clone()))?;
    let stages = pipeline.stages();
    let frame: Vec<&dyn Encode> = stages.iter().map(|stage| *stage as &dyn Encode).collect();
    // Fills every stage's inputs and compiles the shaders.
    timer.untimed(gpu, &frame)?;
    for stage in stages.into_iter().filter(|stage| wanted(stage.name())) {
        let blended = fragments.get(stage.name()).copied();
        measure(criterion, gpu, timer, (group, stage), blended)?;
    }
    Ok(())
}

/// One stage alone in its frames; faulty readings are taken again, and end the run if they go on.
fn measure(
    criterion: &mut Criterion,
    gpu: &Gpu,
    timer: &mut FrameTimer,
    (group, stage): (&str, &dyn Stage),
    blended: Option<u64>,
) -> Result<(), GpuError> {
    let mut group = criterion.benchmark_group(group);
    group.sample_size(10);
    group.warm_up_time(Duration::from_millis(500));
    group.measurement_time(Duration::from_secs(3));
    if let Some(elements) = blended.or(declared(&stage.work())) {
        group.throughput(Throughput::Elements(elements));
    }
    let mut failure = None;
    group.bench_function(stage.name(), |bencher| {
        bencher.iter_custom(|iterations| {
            let mut total_ns = 0.0;
            for _ in 0..iterations {
                match stage_ns(gpu, timer, stage) {
                    Ok(ns) => total_ns += ns,
                    Err(error) => failure = Some(error),
                }
            }
            Duration::from_nanos((total_ns.round() as u64).max(1))
        });
    });
    group.finish();
    failure.map_or(Ok(()), Err)
}

fn declared(work: &Work) -> Option<u64> {
    [work.photons, work.fragments, work.triangles]
        .into_iter()
        .find(|&count| count > 0)
}

/// Readings of a stage before its clock is given up.
const ATTEMPTS: u32 = 20;

fn stage_ns(gpu: &Gpu, timer: &mut FrameTimer, stage: &dyn Stage) -> Result<f64, GpuError> {
    for _ in 0..ATTEMPTS {
        let sample = timer.timed(gpu, &[stage as &dyn Encode])?;
        if sample.faults.is_empty() {
            return Ok(sample.stages[0].ns);
        }
    }
    Err(GpuError::Internal(format!(
        "{}: no acceptable reading of the clock in {ATTEMPTS} frames",
        stage.name()
    )))
}
