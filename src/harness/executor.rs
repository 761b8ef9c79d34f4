//! The scheduler's hands on a real device: builds cells, runs their frames, and writes their records.

use std::path::{Path, PathBuf};
use std::time::Instant;

use super::difference::References;
use super::outcome::{Facts, measured};
use super::plan::PlannedCell;
use super::progress::Progress;
use super::sample::{CellResult, Executor, Failure, Samples};
use super::{MAX_PASSES, landing, picture};
use crate::gpu::{self, ClockPlan, Encode, FrameSample, FrameTimer, Gpu, GpuError, StageCounters};
use crate::pipelines::Pipeline;
use crate::record::{Outcome, Record, RecordError, Writer};

/// The open device and what is kept on it from experiment to experiment.
pub struct Session {
    pub gpu: Gpu,
    options: gpu::Options,
    plan: ClockPlan,
    timer: FrameTimer,
    references: References,
    reopened: bool,
    pub spent: Spent,
}

/// Where the time of a run went.
#[derive(Clone, Copy, Debug, Default)]
pub struct Spent {
    /// Building pipelines, counting shader invocations, running references; seconds.
    pub set_up_s: f64,
    /// All frames, timed and untimed, warm-up included; nanoseconds.
    pub frames_ns: f64,
}

impl Session {
    pub fn new(gpu: Gpu, options: gpu::Options, plan: ClockPlan) -> Result<Self, GpuError> {
        let timer = FrameTimer::new(&gpu, plan, MAX_PASSES)?;
        Ok(Self {
            gpu,
            options,
            plan,
            timer,
            references: References::default(),
            reopened: false,
            spent: Spent::default(),
        })
    }

    fn reopen(&mut self) -> Result<(), String> {
        if std::mem::replace(&mut self.reopened, true) {
            return Err("it was lost before".to_owned());
        }
        self.gpu = Gpu::open(&self.options).map_err(|error| error.to_string())?;
        self.timer =
            FrameTimer::new(&self.gpu, self.plan, MAX_PASSES).map_err(|error| error.to_string())?;
        Ok(())
    }
}

/// Executes the cells of one experiment.
pub struct CellExecutor<'a> {
    session: &'a mut Session,
    cells: &'a [PlannedCell],
    built: Vec<Option<Built>>,
    output: Output<'a>,
    precision: f64,
    start: Instant,
    /// The first measured cell's picture has been tried.
    pictured: bool,
}

/// Where records, pictures and progress go.
pub struct Output<'a> {
    pub writer: &'a mut Writer,
    pub progress: &'a mut Progress,
    /// Folder of the pictures.
    pub pictures: &'a Path,
}

struct Built {
    pipeline: Box<dyn Pipeline>,
    counters: Vec<StageCounters>,
}

impl<'a> CellExecutor<'a> {
    pub fn new(
        session: &'a mut Session,
        cells: &'a [PlannedCell],
        precision: f64,
        output: Output<'a>,
    ) -> Self {
        Self {
            session,
            cells,
            built: cells.iter().map(|_| None).collect(),
            output,
            precision,
            start: Instant::now(),
            pictured: false,
        }
    }

    fn build(&mut self, cell: usize) -> Result<u64, GpuError> {
        let gpu = &self.session.gpu;
        let pipeline = self.cells[cell].subject.build(gpu)?;
        let stages = encodable(pipeline.as_ref());
        let counters = gpu::count(gpu, &stages, MAX_PASSES)?.unwrap_or_default();
        let bytes = pipeline.allocated_bytes();
        self.built[cell] = Some(Built { pipeline, counters });
        Ok(bytes)
    }

    /// Figures that need a read-back, errors against the reference, and a picture: what can fail here is
    /// noted and costs no measurement.
    fn facts<'b>(&mut self, cell: usize, built: &'b Built) -> Facts<'b> {
        let pipeline = built.pipeline.as_ref();
        let mut notes = Vec::new();
        let quantities = pipeline.quantities(&self.session.gpu);
        let mut quantities = quantities.unwrap_or_else(|error| {
            notes.push(format!("quantities not read: {error}"));
            Default::default()
        });
        let start = Instant::now();
        let subject = &self.cells[cell].subject;
        match landing::cell_errors(&self.session.gpu, subject, pipeline) {
            Ok(errors) => quantities.extend(errors),
            Err(error) => notes.push(format!("photon errors not computed: {error}")),
        }
        if let Some(reference) = &self.cells[cell].reference {
            let Session {
                gpu,
                timer,
                references,
                ..
            } = &mut *self.session;
            match references.difference(gpu, timer, pipeline, reference) {
                Ok(error) => {
                    quantities.insert(reference.plan.quantity.clone(), error);
                }
                Err(error) => {
                    notes.push(format!("{} not computed: {error}", reference.plan.quantity))
                }
            }
        }
        if !std::mem::replace(&mut self.pictured, true) {
            let path = self.picture_path(cell);
            if let Err(error) = picture::save(&self.session.gpu, pipeline, &path) {
                notes.push(format!("no picture: {error}"));
            }
        }
        self.session.spent.set_up_s += start.elapsed().as_secs_f64();
        let (counters, precision) = (built.counters.as_slice(), self.precision);
        Facts {
            pipeline,
            counters,
            quantities,
            notes,
            precision,
        }
    }

    /// `EXPERIMENT-CELL.png`, with what file names do not bear replaced.
    fn picture_path(&self, cell: usize) -> PathBuf {
        let plan = &self.cells[cell].plan;
        let plain = |c: char| {
            if c.is_ascii_alphanumeric() || ".-_=".contains(c) {
                c
            } else {
                '_'
            }
        };
        let name: String = plan.cell.chars().map(plain).collect();
        self.output
            .pictures
            .join(format!("{}-{name}.png", plan.experiment))
    }

    fn sampled(&mut self, cell: usize, samples: Samples) -> Outcome {
        match self.built[cell].take() {
            Some(built) => {
                let facts = self.facts(cell, &built);
                Outcome::Measured(Box::new(measured(samples, facts)))
            }
            None => Outcome::Failed {
                reason: "its pipeline is gone".to_owned(),
            },
        }
    }

    fn frame<T>(
        &mut self,
        cell: usize,
        run: impl FnOnce(&mut FrameTimer, &Gpu, &[&dyn Encode]) -> Result<T, GpuError>,
        ns: impl FnOnce(&T) -> f64,
    ) -> Result<T, Failure> {
        let Some(built) = &self.built[cell] else {
            return Err(Failure::Cell("its pipeline was not built".to_owned()));
        };
        let stages = encodable(built.pipeline.as_ref());
        let Session {
            gpu, timer, spent, ..
        } = &mut *self.session;
        let frame = run(timer, gpu, &stages).map_err(failure)?;
        spent.frames_ns += ns(&frame);
        self.output.progress.tick();
        Ok(frame)
    }
}

/// A pipeline's stages as a frame takes them.
pub(crate) fn encodable(pipeline: &dyn Pipeline) -> Vec<&dyn Encode> {
    pipeline
        .stages()
        .into_iter()
        .map(|stage| stage as &dyn Encode)
        .collect()
}

fn failure(error: GpuError) -> Failure {
    match error {
        GpuError::Lost(reason) => Failure::DeviceLost(reason),
        other => Failure::Cell(other.to_string()),
    }
}

impl Executor for CellExecutor<'_> {
    type Fatal = RecordError;

    fn prepare(&mut self, cell: usize) -> Result<u64, Failure> {
        self.output.progress.preparing(&self.cells[cell].plan);
        let start = Instant::now();
        let bytes = self.build(cell);
        self.session.spent.set_up_s += start.elapsed().as_secs_f64();
        bytes.map_err(failure)
    }

    fn timed(&mut self, cell: usize) -> Result<FrameSample, Failure> {
        self.frame(
            cell,
            |timer, gpu, stages| timer.timed(gpu, stages),
            |frame| frame.envelope_ns,
        )
    }

    fn untimed(&mut self, cell: usize) -> Result<f64, Failure> {
        self.frame(
            cell,
            |timer, gpu, stages| timer.untimed(gpu, stages),
            |wall_ns| *wall_ns,
        )
    }

    fn finish(&mut self, cell: usize, result: CellResult) -> Result<(), RecordError> {
        let outcome = match result {
            CellResult::Sampled(samples) => self.sampled(cell, samples),
            CellResult::Failed(reason) => Outcome::Failed { reason },
        };
        let record = self.cells[cell].record(outcome);
        self.output.progress.finished(&record);
        self.output.writer.write(&Record::Cell(Box::new(record)))
    }

    fn release(&mut self, cell: usize) {
        self.built[cell] = None;
        // Freed memory is given back when the device is polled; an error will show at the next frame.
        let _ = self.session.gpu.wait();
    }

    fn recover(&mut self) -> Result<(), String> {
        self.session.reopen()
    }

    fn now_s(&self) -> f64 {
        self.start.elapsed().as_secs_f64()
    }
}
