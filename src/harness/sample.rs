//! The scheduler: which cell renders which frame next, and when a cell has seen enough.
//!
//! The cells of an experiment are prepared in groups that fit into memory together. Within a group they
//! are sampled round-robin, in an order drawn anew each round, so that the machine's drift falls on all
//! of them alike. A visit renders one frame with per-stage timing and one without, in random order: the
//! ratio of such pairs is the cost of timing. A cell is done at its precision or when its share of the
//! time is used up; time that precise cells leave over goes to the others.
//!
//! What each visit added is handed to [`Executor::keep`], so that a run that ends at any moment can be gone on with:
//! a cell begins with what [`Executor::earlier`] has of it.
//!
//! The scheduler reads no clock and touches no device: both are behind [`Executor`].

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};

use itertools::Itertools;
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use crate::gpu::{Fault, FrameSample, StageSample};
use crate::record::{Addition, Clock, FaultKind, FramePair, Rejection, StageTime};
use crate::statistics;

/// Pairs that each cell gets however slow it is: a median and a range need three.
pub const MIN_PAIRS: usize = 3;
/// Pairs before a cell may stop as precise: fewer agree by chance. hyperfine's least number of runs.
pub const MIN_PRECISE_PAIRS: usize = 10;
/// Pairs after which a cell stops in any case, so that records stay readable.
pub const MAX_PAIRS: usize = 500;
/// Warm-up is over once a frame is not faster than the one before it by more than this share.
pub const WARM_UP_TOLERANCE: f64 = 0.1;
/// Frames after which warm-up is given up, and said so.
pub const MAX_WARM_UP_FRAMES: u32 = 10;
/// Timed frames before a cell is judged by how many of them were rejected.
pub const MIN_JUDGED_FRAMES: usize = 6;
/// Share of rejected frames above which a cell fails.
pub const MAX_REJECTED_SHARE: f64 = 0.5;

/// Why a frame could not be rendered.
#[derive(Clone, Debug, PartialEq)]
pub enum Failure {
    /// This cell cannot be measured; others may be.
    Cell(String),
    /// The device is gone, and with it everything prepared on it.
    DeviceLost(String),
}

/// What the scheduler schedules. Cells are told apart by the caller's index.
pub trait Executor {
    /// An error that ends the run, such as a full disk.
    type Fatal;

    /// Makes everything that the cell's frames need; the GPU memory it took in bytes.
    fn prepare(&mut self, cell: usize) -> Result<u64, Failure>;
    /// One frame with per-stage timing.
    fn timed(&mut self, cell: usize) -> Result<FrameSample, Failure>;
    /// One frame without; its wall time in nanoseconds.
    fn untimed(&mut self, cell: usize) -> Result<f64, Failure>;
    /// What an earlier run took of this cell and did not finish, in its order. Asked once, before the first frame.
    fn earlier(&mut self, cell: usize) -> Vec<Addition>;
    /// Keeps what a visit added to a cell's samples.
    fn keep(&mut self, cell: usize, added: Addition) -> Result<(), Self::Fatal>;
    /// All cells were visited: what was kept must outlive this process from now on.
    fn end_round(&mut self) -> Result<(), Self::Fatal>;
    /// Takes a cell's result, before [`release`](Self::release).
    fn finish(&mut self, cell: usize, result: CellResult) -> Result<(), Self::Fatal>;
    /// Frees what [`prepare`](Self::prepare) made; also called for cells that failed.
    fn release(&mut self, cell: usize);
    /// Opens the device anew after its loss, or says why that is not possible.
    fn recover(&mut self) -> Result<(), String>;
    /// Seconds since any fixed moment.
    fn now_s(&self) -> f64;
}

/// When to stop.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Half the width of the frame time's 95 % interval over its median.
    pub precision: f64,
    /// Time for all cells of one call, in seconds.
    pub budget_s: f64,
    /// Memory that cells prepared at the same time should take together, in bytes. A group is closed
    /// once another cell as large as its largest would exceed this.
    pub group_bytes: u64,
    /// Seed of the order of cells and frames.
    pub seed: u64,
}

/// Why a cell's sampling ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Stopped {
    Precise,
    #[default]
    OutOfTime,
    EnoughPairs,
    Interrupted,
}

/// One stage's durations, in the order of the frames; see [`StageSample`].
#[derive(Clone, Debug, PartialEq)]
pub struct StageSamples {
    pub name: String,
    pub clock: Clock,
    pub ns: Vec<f64>,
    pub submit_cost_ns: Vec<f64>,
    pub resolution_ns: Vec<f64>,
}

/// Everything sampled of one cell. Durations in nanoseconds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Samples {
    pub stages: Vec<StageSamples>,
    pub envelope_ns: Vec<f64>,
    pub gaps_ns: Vec<f64>,
    pub untimed_ns: Vec<f64>,
    pub warm_up_frames: u32,
    /// The frame time still fell when warm-up was given up.
    pub unsteady: bool,
    /// Timed frames never used, counted by reason.
    pub rejected: BTreeMap<Rejection, u32>,
    /// So many of the pairs, the first, are of an earlier run.
    pub earlier_pairs: usize,
    pub stopped: Stopped,
}

impl Samples {
    /// What an earlier run kept. Where stages or clocks changed, what came before does not count.
    fn of(additions: &[Addition]) -> Self {
        let mut samples = Self::default();
        for added in additions {
            let other_stages = |pair: &FramePair| !samples.has_stages(&pair.stages);
            if added.pair.as_ref().is_some_and(other_stages) {
                samples = Self::default();
            }
            samples.add(added);
        }
        samples.earlier_pairs = samples.pairs();
        samples
    }

    /// Timed frames, each with an untimed one beside it.
    pub fn pairs(&self) -> usize {
        self.untimed_ns.len()
    }

    fn add(&mut self, added: &Addition) {
        if added.afresh {
            *self = Self::default();
        }
        self.warm_up_frames += added.warm_up_frames;
        self.unsteady |= added.unsteady;
        if let Some(pair) = &added.pair {
            self.add_pair(pair);
        }
        if let Some(reason) = &added.rejected {
            *self.rejected.entry(reason.clone()).or_default() += 1;
        }
    }

    fn add_pair(&mut self, pair: &FramePair) {
        if self.stages.is_empty() {
            let empty = |stage: &StageTime| StageSamples {
                name: stage.stage.clone(),
                clock: stage.clock,
                ns: Vec::new(),
                submit_cost_ns: Vec::new(),
                resolution_ns: Vec::new(),
            };
            self.stages = pair.stages.iter().map(empty).collect();
        }
        for (samples, stage) in self.stages.iter_mut().zip(&pair.stages) {
            samples.ns.push(stage.ns);
            samples.submit_cost_ns.push(stage.submit_cost_ns);
            samples.resolution_ns.push(stage.resolution_ns);
        }
        self.envelope_ns.push(pair.envelope_ns);
        self.gaps_ns.push(pair.gaps_ns);
        self.untimed_ns.push(pair.untimed_ns);
    }

    /// These stages, on the same clocks, were sampled before, or none were.
    fn has_stages(&self, stages: &[StageTime]) -> bool {
        let same = |(known, stage): (&StageSamples, &StageTime)| {
            known.name == stage.stage && known.clock == stage.clock
        };
        self.stages.is_empty()
            || self.stages.len() == stages.len() && self.stages.iter().zip(stages).all(same)
    }

    /// Why the cell cannot be trusted, if too many of its frames were rejected.
    fn verdict_on_rejections(&self) -> Option<String> {
        let rejected = self.rejected.values().sum::<u32>() as usize;
        let judged = rejected + self.pairs();
        let too_many = rejected as f64 > MAX_REJECTED_SHARE * judged as f64;
        (judged >= MIN_JUDGED_FRAMES && too_many).then(|| {
            let mut reasons =
                self.rejected.iter().map(|(reason, count)| format!("{reason} ({count} times)"));
            format!("{rejected} of {judged} timed frames rejected: {}", reasons.join(", "))
        })
    }

    fn relative_half_width(&self) -> f64 {
        statistics::relative_half_width(&self.envelope_ns)
            .max(statistics::relative_half_width(&self.untimed_ns))
    }
}

#[derive(Clone, Debug, PartialEq)]
pub enum CellResult {
    Sampled(Samples),
    Failed(String),
}

struct Live {
    cell: usize,
    samples: Samples,
    spent_s: f64,
    last_pair_s: f64,
    /// It has rendered frames on this device.
    warm: bool,
    /// Its samples are an earlier run's, and no frame of this run was held against them.
    unconfirmed: bool,
}

impl Live {
    fn new(cell: usize, earlier: &[Addition]) -> Self {
        let samples = Samples::of(earlier);
        Self {
            cell,
            unconfirmed: !samples.stages.is_empty(),
            samples,
            spent_s: 0.0,
            last_pair_s: 0.0,
            warm: false,
        }
    }

    /// Another pair is due: the cell has rendered nothing yet that its figures could be read from, or has too few pairs, or
    /// its share of the time is closer with it than without.
    fn wants(&self, share_s: f64) -> bool {
        !self.warm
            || self.samples.pairs() < MIN_PAIRS
            || self.spent_s + self.last_pair_s / 2.0 < share_s
    }

    /// There is enough of it for a record.
    fn suffices(&self) -> bool {
        self.warm && self.samples.pairs() >= MIN_PAIRS
    }
}

/// Samples `cells` until each is precise or the budget is used up, or `interrupted` is set. Every cell is
/// handed to [`Executor::finish`], except those that an interruption left with too little: what there is of them was kept.
pub fn sample<X: Executor>(
    executor: &mut X,
    cells: &[usize],
    settings: &Settings,
    interrupted: &AtomicBool,
) -> Result<(), X::Fatal> {
    let end_s = executor.now_s() + settings.budget_s;
    let mut sampler = Sampler {
        executor,
        interrupted,
        settings,
        random: Pcg64::seed_from_u64(settings.seed),
        live: Vec::new(),
        left_over_s: 0.0,
        hopeless: None,
    };
    let mut waiting = cells;
    while !waiting.is_empty() && !sampler.interrupted() {
        let prepared = sampler.prepare_group(waiting)?;
        let share = prepared as f64 / waiting.len() as f64;
        sampler.left_over_s = (end_s - sampler.executor.now_s()).max(0.0) * share;
        sampler.sample_group()?;
        waiting = &waiting[prepared..];
    }
    Ok(())
}

struct Sampler<'a, X: Executor> {
    executor: &'a mut X,
    interrupted: &'a AtomicBool,
    settings: &'a Settings,
    random: Pcg64,
    live: Vec<Live>,
    /// The group's time that its finished cells have not used.
    left_over_s: f64,
    /// Why nothing can be measured any more.
    hopeless: Option<String>,
}

impl<X: Executor> Sampler<'_, X> {
    fn interrupted(&self) -> bool {
        self.interrupted.load(Ordering::Relaxed)
    }

    /// Prepares the first of the waiting cells, as many as fit into memory together, at least one; how many.
    fn prepare_group(&mut self, waiting: &[usize]) -> Result<usize, X::Fatal> {
        let (mut used, mut largest) = (0u64, 0u64);
        for (done, &cell) in waiting.iter().enumerate() {
            let full = used.saturating_add(largest) > self.settings.group_bytes;
            if self.interrupted() || (done > 0 && full) {
                return Ok(done);
            }
            let earlier = self.executor.earlier(cell);
            self.live.push(Live::new(cell, &earlier));
            self.attempt(cell, |sampler| {
                let bytes = sampler.executor.prepare(cell)?;
                used = used.saturating_add(bytes);
                largest = largest.max(bytes);
                Ok(())
            })?;
        }
        Ok(waiting.len())
    }

    fn sample_group(&mut self) -> Result<(), X::Fatal> {
        loop {
            let share_s = self.left_over_s / self.live.len().max(1) as f64;
            let mut round: Vec<usize> =
                self.live.iter().filter(|live| live.wants(share_s)).map(|live| live.cell).collect();
            if round.is_empty() || self.interrupted() {
                break;
            }
            round.shuffle(&mut self.random);
            for cell in round {
                self.visit(cell)?;
            }
            self.executor.end_round()?;
        }
        self.finish_rest()
    }

    /// One pair of frames, after warm-up if that is due; then the cell may be done.
    fn visit(&mut self, cell: usize) -> Result<(), X::Fatal> {
        if self.interrupted() || self.position(cell).is_none() {
            return Ok(());
        }
        let start_s = self.executor.now_s();
        let mut added = Addition::default();
        self.attempt(cell, |sampler| sampler.warm_up(cell, &mut added))?;
        let warm_s = self.executor.now_s();
        self.attempt(cell, |sampler| sampler.pair(cell, &mut added))?;
        let end_s = self.executor.now_s();
        let Some(at) = self.position(cell) else {
            self.left_over_s -= end_s - start_s;
            return Ok(());
        };
        self.live[at].spent_s += end_s - start_s;
        self.live[at].last_pair_s = end_s - warm_s;
        self.live[at].samples.add(&added);
        self.executor.keep(cell, added)?;
        self.judge(at)
    }

    fn judge(&mut self, at: usize) -> Result<(), X::Fatal> {
        let live = &self.live[at];
        if let Some(reason) = live.samples.verdict_on_rejections() {
            return self.close(at, CellResult::Failed(reason));
        }
        let precise = live.samples.pairs() >= MIN_PRECISE_PAIRS
            && live.samples.relative_half_width() <= self.settings.precision;
        if precise {
            self.close_sampled(at, Stopped::Precise)
        } else if live.samples.pairs() >= MAX_PAIRS {
            self.close_sampled(at, Stopped::EnoughPairs)
        } else {
            Ok(())
        }
    }

    /// Renders frames of both kinds in turn until they no longer get faster: the first ones hold the
    /// driver's compilation of shaders.
    fn warm_up(&mut self, cell: usize, added: &mut Addition) -> Result<(), Failure> {
        let Some(at) = self.position(cell).filter(|at| !self.live[*at].warm) else {
            return Ok(());
        };
        let mut before_ns = f64::INFINITY;
        let mut frames = 0;
        while frames < MAX_WARM_UP_FRAMES && !self.interrupted() {
            let wall_ns = if frames % 2 == 0 {
                self.executor.timed(cell)?.envelope_ns
            } else {
                self.executor.untimed(cell)?
            };
            frames += 1;
            self.live[at].warm = frames > 1 && wall_ns >= before_ns * (1.0 - WARM_UP_TOLERANCE);
            if self.live[at].warm {
                break;
            }
            before_ns = wall_ns;
        }
        let live = &mut self.live[at];
        added.warm_up_frames = frames;
        added.unsteady = !live.warm;
        live.warm = true;
        Ok(())
    }

    /// A timed and an untimed frame, in random order.
    fn pair(&mut self, cell: usize, added: &mut Addition) -> Result<(), Failure> {
        let Some(at) = self.position(cell) else {
            return Ok(());
        };
        let (frame, untimed_ns) = if self.random.random_bool(0.5) {
            let frame = self.executor.timed(cell)?;
            (frame, self.executor.untimed(cell)?)
        } else {
            let untimed_ns = self.executor.untimed(cell)?;
            (self.executor.timed(cell)?, untimed_ns)
        };
        let pair = frame_pair(&frame, untimed_ns);
        let live = &mut self.live[at];
        if std::mem::take(&mut live.unconfirmed) && !live.samples.has_stages(&pair.stages) {
            live.samples = Samples::default();
            added.afresh = true;
        }
        added.rejected = fault(&frame, untimed_ns, &live.samples.stages);
        added.pair = added.rejected.is_none().then_some(pair);
        Ok(())
    }

    /// Runs one step of a cell; a failure closes the cell, and the loss of the device concerns all.
    fn attempt(
        &mut self,
        cell: usize,
        step: impl FnOnce(&mut Self) -> Result<(), Failure>,
    ) -> Result<(), X::Fatal> {
        if self.position(cell).is_none() {
            return Ok(());
        }
        let result = match &self.hopeless {
            Some(reason) => Err(Failure::Cell(reason.clone())),
            None => step(self),
        };
        match result {
            Ok(()) => Ok(()),
            Err(Failure::Cell(reason)) => self.fail(cell, reason),
            Err(Failure::DeviceLost(reason)) => {
                self.fail(cell, format!("device lost: {reason}"))?;
                self.recover(&reason)
            }
        }
    }

    /// Prepares the surviving cells on a new device; they keep their samples and warm up again.
    fn recover(&mut self, reason: &str) -> Result<(), X::Fatal> {
        if let Err(why) = self.executor.recover() {
            self.hopeless = Some(format!("device lost before ({reason}) and not recovered: {why}"));
        }
        let survivors: Vec<usize> = self.live.iter().map(|live| live.cell).collect();
        for cell in survivors {
            let Some(at) = self.position(cell) else {
                continue;
            };
            self.live[at].warm = false;
            self.executor.release(cell);
            self.attempt(cell, |sampler| sampler.executor.prepare(cell).map(|_| ()))?;
        }
        Ok(())
    }

    fn position(&self, cell: usize) -> Option<usize> {
        self.live.iter().position(|live| live.cell == cell)
    }

    fn fail(&mut self, cell: usize, reason: String) -> Result<(), X::Fatal> {
        match self.position(cell) {
            Some(at) => self.close(at, CellResult::Failed(reason)),
            None => Ok(()),
        }
    }

    fn close_sampled(&mut self, at: usize, stopped: Stopped) -> Result<(), X::Fatal> {
        let samples = std::mem::take(&mut self.live[at].samples);
        self.close(at, CellResult::Sampled(Samples { stopped, ..samples }))
    }

    fn close(&mut self, at: usize, result: CellResult) -> Result<(), X::Fatal> {
        let live = self.live.remove(at);
        self.left_over_s -= live.spent_s;
        let finished = self.executor.finish(live.cell, result);
        self.executor.release(live.cell);
        finished
    }

    /// Hands over what the group's remaining cells have.
    fn finish_rest(&mut self) -> Result<(), X::Fatal> {
        let interrupted = self.interrupted();
        while let Some(live) = self.live.first() {
            if interrupted && !live.suffices() {
                let live = self.live.remove(0);
                self.executor.release(live.cell);
                continue;
            }
            let stopped = if interrupted { Stopped::Interrupted } else { Stopped::OutOfTime };
            self.close_sampled(0, stopped)?;
        }
        Ok(())
    }
}

fn frame_pair(frame: &FrameSample, untimed_ns: f64) -> FramePair {
    let stages = frame.stages.iter().map(|stage| StageTime {
        stage: stage.name.to_owned(),
        clock: stage.clock,
        ns: stage.ns,
        submit_cost_ns: stage.submit_cost_ns,
        resolution_ns: stage.resolution_ns,
    });
    FramePair {
        stages: stages.collect(),
        envelope_ns: frame.envelope_ns,
        gaps_ns: frame.gaps_ns,
        untimed_ns,
    }
}

/// Why a pair of frames cannot be used: the timer's own reason first, then what no duration may be. A frame with several faults
/// is one rejected frame.
fn fault(frame: &FrameSample, untimed_ns: f64, before: &[StageSamples]) -> Option<Rejection> {
    if let Some(Fault { stage, kind, .. }) = frame.faults.first() {
        return Some(Rejection { stage: Some((*stage).to_owned()), fault: *kind });
    }
    let positive = |ns: f64| ns.is_finite() && ns > 0.0;
    // Less than nothing is left only where a cost was taken off, which scatters. What was read is more than nothing.
    let read = |stage: &StageSample| stage.ns + stage.submit_cost_ns;
    let same = frame.stages.len() == before.len()
        && frame.stages.iter().zip(before).all(|(now, before)| now.name == before.name);
    let faults = [
        (FaultKind::FrameNotPositive, !positive(frame.envelope_ns)),
        (FaultKind::UntimedNotPositive, !positive(untimed_ns)),
        (FaultKind::StageNotPositive, !frame.stages.iter().all(|stage| positive(read(stage)))),
        (FaultKind::OtherStages, !before.is_empty() && !same),
    ];
    faults.into_iter().find(|(_, found)| *found).map(|(fault, _)| fault.into())
}

#[cfg(test)]
mod tests;
