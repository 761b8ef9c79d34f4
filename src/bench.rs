//! Criterion over stages, through the audited clock, so that criterion's reports show GPU time. `fathom bench` runs the gate cells of a
//! catalogue; `cargo bench` runs every stage of fathom, at the sizes of the publications where they give any.

use std::time::Duration;

use anyhow::{Context, Result};
use criterion::{Criterion, Throughput};

use crate::compare::cells::Gates;
use crate::gpu::{self, ClockPlan, DeviceError, FrameTimer, Gpu, GpuError, Stage};
use crate::harness::MAX_PASSES;
use crate::harness::catalog::Catalog;
use crate::harness::subject::Subjects;
use crate::record::Work;

/// Samples of a stage, and the time that they take.
const SAMPLES: usize = 10;
const WARM_UP: Duration = Duration::from_millis(300);
const MEASUREMENT: Duration = Duration::from_secs(2);
/// Readings of a stage before its clock is given up.
const ATTEMPTS: u32 = 20;

/// The device, its clock and criterion.
pub struct StageBench {
    pub gpu: Gpu,
    criterion: Criterion,
    timer: FrameTimer,
}

impl StageBench {
    pub fn new(gpu: Gpu, plan: ClockPlan, criterion: Criterion) -> Result<Self, GpuError> {
        let timer = FrameTimer::new(&gpu, plan, MAX_PASSES)?;
        Ok(Self { gpu, criterion, timer })
    }

    /// Runs a frame, which fills every stage's inputs and compiles the shaders.
    pub fn warm_up(&mut self, stages: &[&Stage]) -> Result<(), GpuError> {
        self.timer.untimed(&self.gpu, stages)?;
        Ok(())
    }

    /// One of a frame's stages alone in its frames; faulty readings are taken again, and are an error if they go on. Throughput is in
    /// `counted` elements, or in those that the stage declares.
    pub fn stage(
        &mut self,
        group: &str,
        stages: &[&Stage],
        stage: &Stage,
        counted: Option<u64>,
    ) -> Result<(), GpuError> {
        let mut group = self.criterion.benchmark_group(group);
        group.sample_size(SAMPLES).warm_up_time(WARM_UP).measurement_time(MEASUREMENT);
        if let Some(elements) = counted.or(declared(&stage.work)) {
            group.throughput(Throughput::Elements(elements));
        }
        let before = gpu::refilling(stages, stage);
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

    /// Criterion's last words.
    pub fn finish(&self) {
        self.criterion.final_summary();
    }
}

/// Criterion over gate cells of a catalogue.
pub fn gate_cells(catalog: &Catalog, bench: &mut StageBench, gates: Gates) -> Result<()> {
    let mut subjects = Subjects::of(catalog).within(&bench.gpu.capacity);
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
            bench.stage(&cell.id, &stages, stage, None)?;
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
            timer.untimed(gpu, before)?;
        }
        let sample = timer.timed(gpu, &[stage])?;
        if sample.faults.is_empty() {
            return Ok(sample.stages[0].at_least_resolution_ns());
        }
    }
    let name = stage.name();
    let message = format!("{name}: no acceptable reading of the clock in {ATTEMPTS} frames");
    Err(DeviceError::Internal(message).into())
}
