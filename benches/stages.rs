//! Criterion over every stage, through the audited clock, so that criterion's reports show GPU time.
//!
//! The underwater stages run at the base size of UW §4.1 on scene `tank`. Throughput is in photons for the traces and in blended
//! fragments, as counted, for splats and lines. Splats of the base size (5 px) are bound by vertices and triangle set-up on a
//! software rasterizer; the same photons with splats of 20 px, the largest of UW §4.1, are bound by blending.
//!
//! Voxelization runs on scene `bunny_dry` at 128 voxels by each method, with throughput in triangles; the marching at the
//! 600 × 600 pixels and 400 samples per pixel of VAO Fig. 8, with throughput in the samples that are really taken; the rest at
//! small sizes. Every stage of the registry is measured, or the run ends with an error.

use std::time::Duration;

use criterion::{Criterion, Throughput};
use fathom::gpu::{FrameTimer, Gpu, GpuError, Options, audit, audit_table};
use fathom::harness::MAX_PASSES;
use fathom::harness::subject::{Subject, Subjects};
use fathom::parameter;
use fathom::pipelines::AnyPipeline;
use fathom::pipelines::underwater;
use fathom::record::Work;
use fathom::stages::{REGISTRY, Stage};
use serde_json::{Value, json};

fn main() {
    if let Err(error) = run() {
        eprintln!("error: {error:#}");
        std::process::exit(2);
    }
}

/// One configuration of a pipeline.
struct Group {
    name: &'static str,
    pipeline: &'static str,
    scene: &'static str,
    params: Vec<(&'static str, Value)>,
    /// Stages to measure, `FAMILY/` for all of a family; none means all that no earlier group has measured.
    stages: &'static [&'static str],
}

fn groups() -> Vec<Group> {
    let group =
        |name, pipeline, scene, params, stages| Group { name, pipeline, scene, params, stages };
    let voxelize = |name, method| {
        let size = [("view.width", json!(64)), ("view.height", json!(64))];
        let method = [("voxel.method", json!(method)), ("voxel.resolution", json!(128))];
        let params = size.into_iter().chain(method).collect();
        group(name, "voxelize", "bunny_dry", params, &["voxel/"])
    };
    let small = || vec![("view.width", json!(96)), ("view.height", json!(96))];
    let with = |more: Vec<(&'static str, Value)>| small().into_iter().chain(more).collect();
    vec![
        group("underwater", "underwater", "tank", Vec::new(), &[]),
        group(
            "underwater, splats of 20 px",
            "underwater",
            "tank",
            vec![("caustics.point_size_min_px", json!(20.0))],
            &["caustics/splat"],
        ),
        voxelize("voxelize, slicemap", "slicemap"),
        voxelize("voxelize, slice", "slice"),
        voxelize("voxelize, overlap", "overlap"),
        voxelize("voxelize, thin overlap", "overlap_thin"),
        voxelize("voxelize, alpha", "max_alpha"),
        group(
            "volume_ao, 400 samples per pixel",
            "volume_ao",
            "bunny_dry",
            vec![("ao.rays", json!(50)), ("ao.samples", json!(8))],
            &["ao/march"],
        ),
        group("volume_ao", "volume_ao", "bunny_dry", with(vec![("ao.skipping", json!(true))]), &[]),
        group(
            "volume_ao, moving",
            "volume_ao",
            "bunny_dry",
            with(vec![("animation.deform", json!("twist"))]),
            &[],
        ),
        group("hsao", "hsao", "bunny_dry", small(), &[]),
        group("isosurface", "scalar_ao", "smoke", small(), &[]),
        group("direct", "scalar_ao", "smoke", with(vec![("scalar.mode", json!("direct"))]), &[]),
        group(
            "positional",
            "scalar_ao",
            "smoke",
            with(vec![("scalar.mode", json!("positional"))]),
            &[],
        ),
    ]
}

/// Stages that no frame holds: a picture of the volume, and answers at given points.
const APART: [&str; 3] = ["voxel/view", "ao/query", "photons/query"];

struct Bench {
    criterion: Criterion,
    gpu: Gpu,
    timer: FrameTimer,
    subjects: Subjects,
    measured: Vec<&'static str>,
}

fn run() -> anyhow::Result<()> {
    let gpu = Gpu::open(&Options::default())?;
    let clock = audit(&gpu)?;
    println!("{}", audit_table(&clock));
    let mut bench = Bench {
        criterion: Criterion::default().configure_from_args(),
        timer: FrameTimer::new(&gpu, clock.plan, MAX_PASSES)?,
        gpu,
        subjects: Subjects::default(),
        measured: Vec::new(),
    };
    for group in groups() {
        bench.group(&group)?;
    }
    bench.criterion.final_summary();
    let missing = REGISTRY.iter().map(|stage| stage.name);
    let missing: Vec<&str> =
        missing.filter(|name| !bench.measured.contains(name) && !APART.contains(name)).collect();
    anyhow::ensure!(missing.is_empty(), "not measured: {}", missing.join(", "));
    Ok(())
}

impl Bench {
    fn group(&mut self, group: &Group) -> anyhow::Result<()> {
        let params = group.params.iter();
        let params: Vec<_> =
            params.map(|(path, value)| ((*path).to_owned(), value.clone())).collect();
        let subject = self.subjects.subject(group.pipeline, group.scene, &params)?;
        let pipeline = subject.build(&self.gpu)?;
        let stages = pipeline.stages();
        let frame: Vec<&dyn Stage> = stages.iter().map(|stage| *stage as &dyn Stage).collect();
        // Fills every stage's inputs and compiles the shaders.
        self.timer.untimed(&self.gpu, &frame)?;
        let blended = match group.pipeline {
            "underwater" => {
                let params = subject.parameters::<underwater::Underwater>()?;
                underwater::blended_fragments(&self.gpu, &subject.scene, params)?
            }
            _ => Default::default(),
        };
        let samples = counted_samples(&self.gpu, &subject, pipeline.as_ref())?;
        for stage in stages {
            let name = stage.name();
            let wanted = match group.stages {
                [] => !self.measured.contains(&name),
                named => named.iter().any(|wanted| match wanted.ends_with('/') {
                    true => name.starts_with(wanted),
                    false => name == *wanted,
                }),
            };
            if wanted {
                let counted = match name {
                    "ao/march" => samples,
                    _ => blended.get(name).copied(),
                };
                self.stage(group.name, stage, counted)?;
            }
        }
        Ok(())
    }

    /// One stage alone in its frames; faulty readings are taken again, and end the run if they go on.
    fn stage(
        &mut self,
        group: &str,
        stage: &dyn Stage,
        counted: Option<u64>,
    ) -> Result<(), GpuError> {
        self.measured.push(stage.name());
        let mut group = self.criterion.benchmark_group(group);
        group.sample_size(10);
        group.warm_up_time(Duration::from_millis(300));
        group.measurement_time(Duration::from_secs(2));
        if let Some(elements) = counted.or(declared(&stage.work())) {
            group.throughput(Throughput::Elements(elements));
        }
        let mut failure = None;
        let (gpu, timer) = (&self.gpu, &mut self.timer);
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
}

/// Samples of volumes that a frame takes, where the pipeline counts them.
fn counted_samples(
    gpu: &Gpu,
    subject: &Subject,
    pipeline: &dyn AnyPipeline,
) -> Result<Option<u64>, GpuError> {
    let quantities = pipeline.quantities(gpu)?;
    let number = |path| parameter::get(&subject.params, path).and_then(Value::as_f64);
    let samples = || {
        let covered =
            quantities.get("covered_share")? * number("view.width")? * number("view.height")?;
        Some(quantities.get("samples_per_pixel_mean")? * covered * number("ao.scale")?.powi(2))
    };
    Ok(samples().map(|count| count.round() as u64))
}

fn declared(work: &Work) -> Option<u64> {
    [work.photons, work.fragments, work.triangles].into_iter().find(|&count| count > 0)
}

/// Readings of a stage before its clock is given up.
const ATTEMPTS: u32 = 20;

/// A stage's time; the clock's resolution where the stage is shorter.
fn stage_ns(gpu: &Gpu, timer: &mut FrameTimer, stage: &dyn Stage) -> Result<f64, GpuError> {
    for _ in 0..ATTEMPTS {
        let sample = timer.timed(gpu, &[stage as &dyn Stage])?;
        if sample.faults.is_empty() {
            return Ok(sample.stages[0].at_least_resolution_ns());
        }
    }
    Err(GpuError::Internal(format!(
        "{}: no acceptable reading of the clock in {ATTEMPTS} frames",
        stage.name()
    )))
}
