//! Criterion over every stage, through the audited clock, so that criterion's reports show GPU time.
//!
//! The underwater stages run at the base size of UW §4.1 on scene `tank`. Splats of the base size (5 px) and of 20 px, the largest of
//! UW §4.1, are added up by compute and by the rasterizer. What binds each is told in `src/stages/caustics/splat.rs`.
//!
//! Voxelization runs on scene `bunny_dry` at 128 voxels by each method; the marching at the 600 × 600 pixels and 400 samples per pixel
//! of VAO Fig. 8; the rest at small sizes. Stages that no group here runs are measured in their gate cells. Throughput is in the
//! photons, fragments or triangles that a stage declares.

use std::time::Duration;

use anyhow::Context;
use criterion::{Criterion, Throughput};
use fathom::Catalog;
use fathom::compare::cells::Gates;
use fathom::experiments::parse_set;
use fathom::gpu::{
    self, ClockPlan, DeviceError, FrameTimer, Gpu, GpuError, Options, Stage, audit, audit_table,
};
use fathom::harness::MAX_PASSES;
use fathom::harness::subject::Subjects;
use fathom::record::Work;

fn main() {
    if let Err(error) = run() {
        eprintln!("error: {error:#}");
        std::process::exit(2);
    }
}

/// A configuration of a pipeline in each line: name, pipeline, scene, parameters, and the stages to measure. `FAMILY/` is all of a
/// family, none all that no earlier group has measured.
const GROUPS: &str = "\
underwater | underwater | tank | |
underwater, splats of 20 px | underwater | tank | caustics.splatting=compute caustics.point_size_min_px=20 | caustics/splat
underwater, rasterized splats | underwater | tank | caustics.splatting=raster caustics.point_size_min_px=5 | caustics/splat
underwater, rasterized splats of 20 px | underwater | tank | caustics.splatting=raster caustics.point_size_min_px=20 | caustics/splat
voxelize, slicemap | voxelize | bunny_dry | view.width=64 view.height=64 voxel.method=slicemap voxel.resolution=128 | voxel/
voxelize, slice | voxelize | bunny_dry | view.width=64 view.height=64 voxel.method=slice voxel.resolution=128 | voxel/
voxelize, overlap | voxelize | bunny_dry | view.width=64 view.height=64 voxel.method=overlap voxel.resolution=128 | voxel/
voxelize, alpha | voxelize | bunny_dry | view.width=64 view.height=64 voxel.method=max_alpha voxel.resolution=128 | voxel/
volume_ao, 400 samples per pixel | volume_ao | bunny_dry | ao.rays=50 ao.samples=8 | ao/march
volume_ao | volume_ao | bunny_dry | view.width=96 view.height=96 ao.skipping=true |
volume_ao, moving | volume_ao | bunny_dry | view.width=96 view.height=96 animation.deform=twist |
hsao | hsao | bunny_dry | view.width=96 view.height=96 |
gtao | gtao | bunny_dry | view.width=96 view.height=96 |
isosurface | scalar_ao | smoke | view.width=96 view.height=96 |
direct | scalar_ao | smoke | view.width=96 view.height=96 scalar.mode=direct |
positional | scalar_ao | smoke | view.width=96 view.height=96 scalar.mode=positional |";

struct Suite {
    bench: StageBench,
    subjects: Subjects,
    measured: Vec<&'static str>,
}

fn run() -> anyhow::Result<()> {
    let gpu = Gpu::open(&Options::default())?;
    let clock = audit(&gpu)?;
    println!("{}", audit_table(&clock));
    let criterion = Criterion::default().configure_from_args();
    let mut suite = Suite {
        bench: StageBench::new(gpu, clock.plan, criterion)?,
        subjects: Subjects::default(),
        measured: Vec::new(),
    };
    for group in GROUPS.lines() {
        suite.group(group)?;
    }
    let Suite { mut bench, measured, .. } = suite;
    let catalog = Catalog::builtin();
    let mut gates = Gates::load(None, catalog.gates)?;
    for cell in &mut gates.configurations {
        cell.stages.retain(|stage| !measured.contains(&stage.as_str()));
    }
    gate_cells(&catalog, &mut bench, gates)?;
    bench.criterion.final_summary();
    Ok(())
}

impl Suite {
    fn group(&mut self, line: &'static str) -> anyhow::Result<()> {
        let mut parts = line.split('|').map(str::trim);
        let [group, pipeline, scene, params, wanted] =
            [(); 5].map(|()| parts.next().unwrap_or_default());
        let params: Vec<_> = params.split_whitespace().map(parse_set).collect::<Result<_, _>>()?;
        let subject = self.subjects.subject(pipeline, scene, &params)?;
        let pipeline = subject.build(&self.bench.gpu)?;
        let stages = pipeline.stages();
        self.bench.warm_up(&stages)?;
        for stage in &stages {
            let name = stage.name();
            let is_wanted = match wanted {
                "" => !self.measured.contains(&name),
                family if family.ends_with('/') => name.starts_with(family),
                stage => name == stage,
            };
            if is_wanted {
                self.measured.push(name);
                self.bench.stage(group, &stages, stage)?;
            }
        }
        Ok(())
    }
}

/// Samples of a stage, and the time that they take.
const SAMPLES: usize = 10;
const WARM_UP: Duration = Duration::from_millis(300);
const MEASUREMENT: Duration = Duration::from_secs(2);
/// Readings of a stage before its clock is given up.
const ATTEMPTS: u32 = 20;

/// The device, its clock and criterion.
struct StageBench {
    gpu: Gpu,
    criterion: Criterion,
    timer: FrameTimer,
}

impl StageBench {
    fn new(gpu: Gpu, plan: ClockPlan, criterion: Criterion) -> Result<Self, GpuError> {
        let timer = FrameTimer::new(&gpu, plan, MAX_PASSES)?;
        Ok(Self { gpu, criterion, timer })
    }

    /// Runs a frame, which fills every stage's inputs and compiles the shaders.
    fn warm_up(&mut self, stages: &[&Stage]) -> Result<(), GpuError> {
        self.timer.run_stages(&self.gpu, stages)?;
        Ok(())
    }

    /// One of a frame's stages alone in its frames; faulty readings are taken again, and are an error if they go on. Throughput is in
    /// the elements that the stage declares.
    fn stage(&mut self, group: &str, stages: &[&Stage], stage: &Stage) -> Result<(), GpuError> {
        let mut group = self.criterion.benchmark_group(group);
        group.sample_size(SAMPLES).warm_up_time(WARM_UP).measurement_time(MEASUREMENT);
        if let Some(elements) = declared(&stage.work) {
            group.throughput(Throughput::Elements(elements));
        }
        let before = gpu::stages_before(stages, stage);
        let mut failure = None;
        let (gpu, timer) = (&self.gpu, &mut self.timer);
        group.bench_function(stage.name(), |bencher| {
            bencher.iter_custom(|iterations| {
                let mut total_ns = 0.0;
                for _ in 0..iterations {
                    match stage_ns(gpu, timer, &before, stage) {
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
}

/// Criterion over the gate cells that are left.
fn gate_cells(catalog: &Catalog, bench: &mut StageBench, gates: Gates) -> anyhow::Result<()> {
    let mut subjects = Subjects::new(catalog).with_capacity(&bench.gpu.capacity);
    for cell in gates.configurations {
        if cell.stages.is_empty() {
            continue;
        }
        let set: Vec<_> = cell.params.into_iter().collect();
        let subject = subjects.subject(&cell.pipeline, &cell.scene, &set)?;
        let pipeline = subject.build(&bench.gpu)?;
        let stages = pipeline.stages();
        bench.warm_up(&stages)?;
        for name in &cell.stages {
            let stage = stages.iter().find(|stage| stage.name() == name);
            let stage = stage.with_context(|| format!("{} runs no stage `{name}`", cell.id))?;
            bench.stage(&cell.id, &stages, stage)?;
        }
    }
    Ok(())
}

fn declared(work: &Work) -> Option<u64> {
    [work.photons, work.fragments, work.triangles].into_iter().find(|&count| count > 0)
}

/// A stage's time; the clock's resolution where the stage is shorter.
fn stage_ns(
    gpu: &Gpu,
    timer: &mut FrameTimer,
    before: &[&Stage],
    stage: &Stage,
) -> Result<f64, GpuError> {
    for _ in 0..ATTEMPTS {
        if !before.is_empty() {
            timer.run_stages(gpu, before)?;
        }
        let sample = timer.time_stages(gpu, &[stage])?;
        if sample.faults.is_empty() {
            return Ok(sample.stages[0].ns_or_resolution());
        }
    }
    let name = stage.name();
    let message = format!("{name}: no acceptable reading of the clock in {ATTEMPTS} frames");
    Err(DeviceError::Internal(message).into())
}
