//! Executor on the real device: builds cells, runs their frames, and writes their records.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::time::{Instant, SystemTime};

use anyhow::{Context, Result};
use image::RgbImage;
use itertools::Itertools as _;

use super::beside::Beside;
use super::cell_progress::{CellProgress, ComputedFigures, Done};
use super::difference::References;
use super::outcome::{CellFindings, build_record};
use super::plan::{PlannedCell, PlannedExperiment};
use super::repetitions;
use super::reports::RunOutput;
use super::sample::{self, CostForecast, Executor, Failure};
use super::schedule::{CellState, Schedule};
use super::sweep::SOURCE;
use super::{MAX_PASSES, host, picture, views};
use fathom_base::folder::Dir;
use fathom_base::{print, quiet};
use fathom_clock::Samples;
use fathom_experiments::CellPlan;
use fathom_experiments::schema::{Experiment, Pictures};
use fathom_gpu as gpu;
use fathom_gpu::{
    ClockPlan, DeviceError, FrameSample, FrameTimer, Gpu, GpuError, HostClock, MachineReader,
    Pacer, Stage, Waker,
};
use fathom_pipelines as pipelines;
use fathom_pipelines::{AnyPipeline, CountedReads, Judge, JudgeError, Judging, ReferenceCache};
use fathom_record::output::picture_path;
use fathom_record::{
    Begun, Ceiling, Cell, MachineState, Measured, NoteKind, Outcome, Picture, PictureKind,
    PictureScale, Profile, Record, RecordError, Run, SetUp,
};

/// What a software driver keeps of a pipeline's compiled shaders in the process: of 15 cells of `vao-samples`, 300 MiB more
/// on lavapipe than of one.
const SOFTWARE_CODE_BYTES: u64 = 20 << 20;

/// The open device and what is kept on it from experiment to experiment.
pub struct Session {
    pub gpu: Gpu,
    options: gpu::Options,
    plan: ClockPlan,
    ceilings: Vec<Ceiling>,
    timer: FrameTimer,
    machine: Option<MachineReader>,
    waker: Waker,
    pacer: Pacer,
    references: References,
    cache: Arc<ReferenceCache>,
    /// What needs no device.
    pub beside: Beside<Done>,
    reopened: bool,
    /// By pipeline: the first cell that was built, which tells its CPU costs, as the numbers of its experiment and its own.
    hosts: BTreeMap<String, (usize, usize)>,
    pub times: RunTimes,
}

#[derive(Clone, Debug, Default)]
pub struct RunTimes {
    /// What is not measuring; seconds.
    pub set_up_s: BTreeMap<SetUp, f64>,
    /// All frames, timed and untimed, warm-up included; nanoseconds.
    pub frames_ns: f64,
}

impl RunTimes {
    /// Adds the time since `start`, and gives this moment.
    pub fn since(&mut self, start: Instant, on: SetUp) -> Instant {
        let now = Instant::now();
        *self.set_up_s.entry(on).or_default() += (now - start).as_secs_f64();
        now
    }

    fn add(&mut self, took_s: &BTreeMap<SetUp, f64>) {
        took_s.iter().for_each(|(on, s)| *self.set_up_s.entry(*on).or_default() += s);
    }
}

impl Session {
    /// With the clocks and the adapter's limits, cores beside, and what was spent up to now.
    pub fn new(
        gpu: Gpu,
        options: gpu::Options,
        (plan, pacer): (ClockPlan, Pacer),
        ceilings: Vec<Ceiling>,
        workers: Option<usize>,
        times: RunTimes,
    ) -> Result<Self, GpuError> {
        let timer = FrameTimer::new(&gpu, plan, MAX_PASSES)?;
        let others = if gpu.adapter.software { 1 } else { quiet::cores_before().len().max(1) } - 1;
        Ok(Self {
            machine: MachineReader::open(&gpu.adapter),
            waker: Waker::default(),
            pacer,
            options,
            plan,
            ceilings,
            timer,
            references: References::default(),
            cache: Arc::new(ReferenceCache::load()),
            beside: Beside::new(workers.unwrap_or(others)),
            gpu,
            reopened: false,
            hosts: BTreeMap::new(),
            times,
        })
    }

    /// Puts each stage's share of its limit into the record of a cell whose figures are known.
    pub fn add_shares(&mut self, measured: &mut Measured) -> Result<(), String> {
        let Self { gpu, plan, ceilings, .. } = self;
        let again = |limit| gpu::measure(gpu, *plan, limit);
        super::ceilings::add_shares(measured, ceilings, again)
    }

    /// The same before they are: a share above 100 % is not believed, nor its limit measured again.
    fn add_possible_shares(&self, measured: &mut Measured) {
        for stage in &mut measured.stages {
            let share = stage.share_of(&self.ceilings);
            stage.ceiling = share.filter(|share| !share.is_impossible());
        }
    }

    /// Opens the device anew after its loss, once, or says why that is not possible.
    pub fn reopen(&mut self) -> Result<(), String> {
        if std::mem::replace(&mut self.reopened, true) {
            return Err("it was lost before".to_owned());
        }
        self.gpu = Gpu::open(&self.options).map_err(|error| error.to_string())?;
        let timer = FrameTimer::new(&self.gpu, self.plan, MAX_PASSES);
        self.timer = timer.map_err(|error| error.to_string())?;
        self.pacer = Pacer::new(&self.gpu, self.plan).map_err(|error| error.to_string())?;
        Ok(())
    }
}

/// Writes a picture from what was read back.
type WritePicture = Box<dyn FnOnce(&Judge<'_>, &mut CellFindings) + Send>;

const NO_ERRORS: &str = "errors not computed";

fn no_picture(shows: PictureKind) -> &'static str {
    match shows {
        PictureKind::Image => "no picture",
        PictureKind::Error => "no picture of the error",
    }
}

/// Executes a batch of cells of one experiment.
pub struct CellExecutor<'a> {
    session: &'a mut Session,
    experiment: &'a Experiment,
    /// The experiment's number in the schedule.
    number: usize,
    /// Quantities and errors that its claims and plots read.
    quantities: Vec<String>,
    cells: &'a [PlannedCell],
    built: BTreeMap<usize, BuiltCell>,
    output: &'a mut RunOutput,
    progress: &'a mut CellProgress,
    schedule: &'a mut Schedule,
}

struct BuiltCell {
    pipeline: Box<AnyPipeline>,
    /// Time of its frames, seconds, and how many they are.
    frames: (f64, u32),
    /// What this thread took for the submission of each untimed one.
    submits_ns: Vec<f64>,
}

impl<'a> CellExecutor<'a> {
    pub fn new(
        session: &'a mut Session,
        output: &'a mut RunOutput,
        number: usize,
        planned: &'a PlannedExperiment,
        progress: &'a mut CellProgress,
        schedule: &'a mut Schedule,
    ) -> Self {
        let PlannedExperiment { experiment, cells } = planned;
        let asked = experiment.measures().into_iter().flat_map(|measure| measure.quantities());
        Self {
            session,
            experiment,
            number,
            quantities: asked.map(str::to_owned).collect(),
            cells,
            built: BTreeMap::new(),
            output,
            progress,
            schedule,
        }
    }

    /// Says in the records that a cell is begun of which there is nothing yet: it may end the process.
    fn begin(&mut self, cell: usize) -> Result<(), Failure> {
        if self.state(cell).recorded || self.progress.samples.contains_key(&cell) {
            return Ok(());
        }
        let begun = begin_record(&self.output.header, &self.cells[cell]);
        let written = self.output.folder.writer.append_unsynced(&[Record::Begun(begun)]);
        written.map_err(|error| Failure::Cell(error.to_string()))
    }

    fn state(&mut self, cell: usize) -> &mut CellState {
        &mut self.schedule.cells[self.number][cell]
    }

    /// Reads figures and pictures back, and gives the task that computes errors from them: what can fail is noted and costs no
    /// measurement.
    fn read(
        &mut self,
        cell: usize,
        built: &BuiltCell,
    ) -> impl FnOnce() -> ComputedFigures + Send + 'static {
        let (pipeline, start) = (built.pipeline.as_ref(), Instant::now());
        let mut findings = CellFindings::default();
        findings.add("quantities not read", pipeline.quantities(&self.session.gpu));
        // They explain times, and errors where a claim or a plot asks for them.
        let asked = self.quantities.iter().any(|name| name.starts_with("samples_per_pixel"));
        if asked || !self.cells[cell].plan.errors_only {
            let counted = pipeline.counted_reads(&self.session.gpu);
            let counted = findings.noted(NoteKind::NotComputed, "reads not counted", counted);
            for CountedReads { stage, reads, quantities } in counted.into_iter().flatten() {
                findings.reads.insert(stage.to_owned(), reads);
                findings.quantities.extend(quantities);
            }
        }
        let start = self.session.times.since(start, SetUp::Quantities);
        let judging = pipeline.judge(&self.session.gpu, &self.quantities);
        let judging = findings.noted(NoteKind::NotComputed, NO_ERRORS, judging);
        let start = self.session.times.since(start, SetUp::Errors);
        self.views(cell, pipeline, &mut findings);
        self.compare(cell, pipeline, &mut findings);
        let start = self.session.times.since(start, SetUp::Comparisons);
        let pictures = self.read_pictures(cell, pipeline, &mut findings);
        let start = self.session.times.since(start, SetUp::Pictures);
        let is_late = self.now_s() >= self.output.deadline_s();
        let plan = &self.cells[cell].plan;
        let Session { gpu, timer, hosts, times, .. } = &mut *self.session;
        // A resumed run measures it with the first cell whose figures it reads.
        if !is_late && hosts.get(&plan.pipeline) == Some(&(self.number, cell)) {
            let costs = host::costs(gpu, timer, pipeline, &built.submits_ns);
            let failure = "what it costs the CPU not measured";
            findings.host = findings.noted(NoteKind::NotComputed, failure, costs);
        }
        times.since(start, SetUp::Quantities);
        let scene = Arc::clone(&self.cells[cell].subject.scene);
        let cache = Arc::clone(&self.session.cache);
        let max_points = match self.output.header.profile {
            Profile::Quick => pipelines::MAX_POINTS_QUICK,
            Profile::Paper => pipelines::MAX_POINTS,
        };
        let place = (self.number, cell);
        move || {
            let judge = Judge { max_points, ..Judge::new(&scene, &cache) };
            let mut times = RunTimes::default();
            let start = Instant::now();
            if let Some(judging) = judging {
                let judged = judging(&judge).map(|judged| {
                    findings.errors = judged.errors;
                    findings.notes.extend(judged.notes);
                    judged.quantities
                });
                findings.add(NO_ERRORS, judged);
            }
            let start = times.since(start, SetUp::Errors);
            pictures.into_iter().for_each(|write| write(&judge, &mut findings));
            times.since(start, SetUp::Pictures);
            ComputedFigures { place, findings, took_s: times.set_up_s }
        }
    }

    /// How views of the cell differ, where that is asked.
    fn views(&mut self, cell: usize, pipeline: &AnyPipeline, findings: &mut CellFindings) {
        let Some(asked) = &self.experiment.views else { return };
        let (name, Session { gpu, timer, .. }) = (&asked.quantity, &mut *self.session);
        let others = self.cells[cell].views.as_ref();
        let others =
            others.context("the pipeline has no seed, so noise cannot be separated from the dependence on the view");
        let spread = others.and_then(|others| views::spread(gpu, timer, pipeline, others));
        let figures = spread.map(|spread| spread.figures(name));
        findings.add(&format!("{name} not computed"), figures);
    }

    /// Differences from the cell's reference run, and between its repetitions.
    fn compare(&mut self, cell: usize, pipeline: &AnyPipeline, findings: &mut CellFindings) {
        let Session { gpu, timer, references, .. } = &mut *self.session;
        let PlannedCell { plan, reference, repetitions, .. } = &self.cells[cell];
        if let (Some(asked), Some(subject)) = (&plan.reference, reference) {
            let name = &asked.quantity;
            let difference = references.difference(gpu, timer, pipeline, subject, &asked.stages);
            let figures = difference.map(|value| [(name.clone(), value)]);
            findings.add(&format!("{name} not computed"), figures);
        }
        if let (Some(asked), Some(planned)) = (&self.experiment.repetitions, repetitions) {
            let own = &self.cells[cell].subject;
            let found = repetitions::noise(gpu, timer, own, pipeline, planned, &asked.output);
            let noise = findings.noted(NoteKind::NotComputed, "noise not computed", found);
            let names = asked.output.iter().map(|output| output.noise.clone());
            findings.repeated.extend(names.zip(noise.into_iter().flatten()));
        }
    }

    /// What writes them, one after the other.
    fn read_pictures(
        &mut self,
        cell: usize,
        pipeline: &AnyPipeline,
        findings: &mut CellFindings,
    ) -> Vec<WritePicture> {
        let later = std::mem::replace(&mut self.progress.pictured, true);
        if later && self.experiment.pictures == Pictures::First {
            return Vec::new();
        }
        let CellPlan { experiment, cell, .. } = &self.cells[cell].plan;
        let is_sweep = self.experiment.source == SOURCE;
        let write = |shows: PictureKind, draw: Judging<(RgbImage, Option<PictureScale>)>| {
            let path = picture_path(experiment, cell, shows);
            let folder = self.output.folder.output.folder.clone();
            let write: WritePicture = Box::new(move |judge, findings| {
                let drawn = draw(judge);
                // A sweep asks for it, whatever its pipeline has.
                if is_sweep && matches!(drawn, Err(JudgeError::NoPicture(_))) {
                    return;
                }
                let saved = drawn.map_err(anyhow::Error::from).and_then(|(drawn, scale)| {
                    let opened = Dir::open(&folder);
                    let folder = opened.map_err(|source| picture::write_error(&folder, source))?;
                    picture::write(&drawn, &folder, Path::new(&path))?;
                    Ok(Picture { path, shows, scale })
                });
                let saved = findings.noted(NoteKind::NoPicture, no_picture(shows), saved);
                findings.pictures.extend(saved);
            });
            write
        };
        let (gpu, shows_visibility) = (&self.session.gpu, pipeline.shows_visibility());
        let failure = no_picture(PictureKind::Image);
        let image = findings.noted(NoteKind::NoPicture, failure, picture::read(gpu, pipeline));
        let image = image.map(|pixels| {
            let scale = shows_visibility.then_some(PictureScale::Visibility);
            let draw =
                move |_: &Judge<'_>| Ok((picture::downscaled(&pixels, shows_visibility, 1), scale));
            write(PictureKind::Image, Box::new(draw))
        });
        let of_error = self.experiment.error_picture.then(|| pipeline.error_picture(gpu));
        let failure = no_picture(PictureKind::Error);
        let of_error = of_error.and_then(|of| findings.noted(NoteKind::NoPicture, failure, of));
        let of_error = of_error.map(|draw| {
            let draw = |judge: &Judge<'_>| draw(judge).map(|(drawn, scale)| (drawn, Some(scale)));
            write(PictureKind::Error, Box::new(draw))
        });
        image.into_iter().chain(of_error).collect()
    }

    /// The record of a cell that is finished, with its stages' shares of their ceilings.
    fn sampled(&mut self, cell: usize, samples: &Samples) -> Result<Cell, String> {
        let built = self.built.remove(&cell).ok_or("its pipeline is gone")?;
        if !self.progress.is_read(cell) {
            let start = Instant::now();
            let task = self.read(cell, &built);
            if let Some(reason) = self.session.gpu.loss_reason() {
                // A later attempt may find what could not be found then.
                return Err(sample::device_lost(&reason));
            }
            self.progress.awaited.insert(cell);
            let done = self.session.beside.run(|| Done::Figures(Box::new(task())));
            if let Some(Done::Figures(computed)) = done {
                self.session.times.add(&computed.took_s);
                self.progress.keep_findings(cell, computed.findings);
            }
            self.state(cell).costs.finish_s = Some(start.elapsed().as_secs_f64());
        }
        let mut measured = self.build_record(cell, samples, &built.pipeline);
        self.built.insert(cell, built);
        if self.progress.findings.contains_key(&cell) {
            self.session.add_shares(&mut measured)?;
        } else {
            self.session.add_possible_shares(&mut measured);
        }
        Ok(self.cells[cell].record(Outcome::Measured(Box::new(measured))))
    }

    /// Counts what its frame does, once: the first frame of its warm-up.
    fn count(&mut self, cell: usize, pipeline: &AnyPipeline) -> Result<(), GpuError> {
        if self.cells[cell].plan.errors_only || self.progress.counters.contains_key(&cell) {
            return Ok(());
        }
        let start = Instant::now();
        let counted = gpu::count(&self.session.gpu, &pipeline.stages(), MAX_PASSES);
        self.progress.counters.insert(cell, counted.map_err(GpuError::from)?);
        self.session.times.since(start, SetUp::Counting);
        Ok(())
    }

    fn build_record(&self, cell: usize, samples: &Samples, pipeline: &AnyPipeline) -> Measured {
        let CellProgress { counters, findings, .. } = &*self.progress;
        let counters = counters.get(&cell).map_or(&[][..], Vec::as_slice);
        let found = findings.get(&cell).cloned().unwrap_or_else(CellFindings::unfinished);
        build_record(samples, pipeline, counters, found)
    }

    fn frame<T>(
        &mut self,
        cell: usize,
        run: impl FnOnce(&mut FrameTimer, &Gpu, &[&Stage]) -> Result<T, GpuError>,
        ns: impl FnOnce(&T) -> f64,
    ) -> Result<T, Failure> {
        if self.built.get(&cell).is_some_and(|built| built.frames.1 == 0) {
            self.begin(cell)?;
        }
        let Some(built) = self.built.get_mut(&cell) else {
            return Err(Failure::Cell("its pipeline was not built".to_owned()));
        };
        let stages = built.pipeline.stages();
        let Session { gpu, timer, times, .. } = &mut *self.session;
        let start = Instant::now();
        let frame = run(timer, gpu, &stages)?;
        built.frames.0 += start.elapsed().as_secs_f64();
        built.frames.1 += 1;
        times.frames_ns += ns(&frame);
        self.output.progress.tick();
        Ok(frame)
    }
}

/// That a cell is begun, of which nothing is measured yet.
pub fn begin_record(run: &Run, cell: &PlannedCell) -> Begun {
    Begun::new(run, &cell.record(Outcome::OverBudget))
}

impl From<GpuError> for Failure {
    fn from(error: GpuError) -> Self {
        match error {
            GpuError::Device(DeviceError::Lost(reason)) => Self::DeviceLost(reason),
            // A compiler's message has many lines, and a reason one.
            other => Self::Cell(other.to_string().lines().map(str::trim).join(" ")),
        }
    }
}

impl Executor for CellExecutor<'_> {
    type Fatal = RecordError;

    fn prepare(&mut self, cell: usize) -> Result<u64, Failure> {
        self.begin(cell)?;
        let PlannedCell { plan, subject, .. } = &self.cells[cell];
        self.output.progress.preparing(plan);
        let Session { gpu, times, hosts, .. } = &mut *self.session;
        let begun = Instant::now();
        let pipeline = subject.build_planned(gpu)?;
        if !plan.errors_only && !self.progress.is_read(cell) {
            hosts.entry(plan.pipeline.clone()).or_insert((self.number, cell));
        }
        times.since(begun, SetUp::Pipelines);
        self.count(cell, &pipeline)?;
        let code = if self.session.gpu.adapter.software { SOFTWARE_CODE_BYTES } else { 0 };
        let bytes = pipeline.allocated_bytes() + code;
        self.built.insert(cell, BuiltCell { pipeline, frames: (0.0, 0), submits_ns: Vec::new() });
        self.state(cell).costs.prepare_s = Some(begun.elapsed().as_secs_f64());
        Ok(bytes)
    }

    fn wake(&mut self) -> Result<(), Failure> {
        let Session { gpu, waker, .. } = &mut *self.session;
        gpu.flush().map_err(GpuError::from)?;
        Ok(waker.wake(gpu)?)
    }

    fn pace(&mut self) -> Result<Option<[f64; 2]>, Failure> {
        let Session { gpu, pacer, .. } = &mut *self.session;
        Ok(Some(pacer.read(gpu)?))
    }

    fn time_frame(&mut self, cell: usize) -> Result<FrameSample, Failure> {
        self.frame(
            cell,
            |timer, gpu, stages| Ok(timer.time_stages(gpu, stages)?),
            |frame| frame.envelope_ns,
        )
    }

    fn run_frame(&mut self, cell: usize) -> Result<f64, Failure> {
        let clock = HostClock::from_plan(&self.session.plan);
        let run =
            |timer: &mut FrameTimer, gpu: &Gpu, stages: &[&Stage]| Ok(timer.on_host(gpu, stages)?);
        let time = self.frame(cell, run, |time| time.time_ns(clock))?;
        self.built.entry(cell).and_modify(|built| built.submits_ns.push(time.submit_ns));
        Ok(time.time_ns(clock))
    }

    fn earlier_samples(&mut self, cell: usize) -> Samples {
        self.progress.samples.get(&cell).cloned().unwrap_or_default()
    }

    fn save(&mut self, cell: usize, samples: &Samples) -> Result<(), RecordError> {
        let Some(built) = self.built.get(&cell) else { return Ok(()) };
        let samples = samples.clone();
        let mut measured = self.build_record(cell, &samples, &built.pipeline);
        self.session.add_possible_shares(&mut measured);
        let record = self.cells[cell].record(Outcome::Measured(Box::new(measured)));
        self.state(cell).visits = samples.count_visits();
        self.progress.samples.insert(cell, samples);
        if self.progress.awaited.contains(&cell) {
            self.progress.records.insert(record.cell.clone(), record.clone());
        }
        self.output.folder.writer.append_unsynced(&[Record::Cell(Box::new(record))])
    }

    fn finish(&mut self, cell: usize, result: Result<Samples, String>) -> Result<(), RecordError> {
        let samples = result.as_ref().cloned().unwrap_or_default();
        let record = result.and_then(|samples| self.sampled(cell, &samples));
        let frames = self.built.get(&cell).map_or((0.0, 0), |built| built.frames);
        let now_s = self.now_s();
        let state = self.state(cell);
        (state.recorded, state.is_excluded) = (true, record.is_err());
        (state.visits, state.visited_s) = (samples.count_visits(), now_s);
        state.half_width = samples.relative_half_width();
        if frames.1 > 0 {
            state.costs.pair_s = Some(2.0 * frames.0 / f64::from(frames.1));
        }
        self.progress.samples.insert(cell, samples);
        let planned = &self.cells[cell];
        match record {
            Ok(record) => {
                self.progress.records.insert(record.cell.clone(), record.clone());
                self.output.finish(record)
            }
            Err(reason) => {
                let CellPlan { experiment, cell, .. } = &planned.plan;
                if self.progress.records.get(cell).and_then(Cell::measured).is_none() {
                    return self.output.finish(planned.record(Outcome::Failed { reason }));
                }
                // What was measured before it failed stands.
                print::note(format!("{experiment} {cell}: not sampled on: {reason}"));
                Ok(())
            }
        }
    }

    fn release(&mut self, cell: usize) {
        self.built.remove(&cell);
        // Freed memory is given back when the device is polled; an error will show at the next frame.
        let _ = self.session.gpu.wait();
    }

    fn loss_reason(&self) -> Option<String> {
        self.session.gpu.loss_reason()
    }

    fn chains(&self, cells: &[usize]) -> Vec<Vec<usize>> {
        let unmeasured = || Outcome::Skipped { reason: String::new() };
        let records = cells.iter().map(|cell| self.cells[*cell].record(unmeasured()));
        let records: Vec<Cell> = records.collect();
        let chains = self.experiment.chains(&records.iter().collect::<Vec<_>>());
        let numbers = |chain: Vec<usize>| chain.into_iter().map(|place| cells[place]).collect();
        chains.into_iter().map(numbers).collect()
    }

    fn untimed_only(&self, cell: usize) -> bool {
        self.cells[cell].plan.errors_only
    }

    fn forecast(&self, cell: usize) -> CostForecast {
        self.schedule.forecast(self.number, cell)
    }

    fn now_s(&self) -> f64 {
        self.output.now_s()
    }

    fn machine(&self) -> Option<MachineState> {
        self.session.machine.as_ref()?.read()
    }

    fn unix_s(&self) -> f64 {
        let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
        // Milliseconds say enough of a moment, and are short in a record.
        since.map_or(0.0, |since| since.as_millis() as f64 * 1e-3)
    }
}
