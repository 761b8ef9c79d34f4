//! The scheduler: which cell renders which frame next, and when a cell has seen enough.
//!
//! The cells of an experiment are prepared in groups that fit into memory together. Within a group they
//! are sampled round-robin, in an order drawn anew each round, so that the machine's drift affects all
//! of them alike. A visit renders one frame with per-stage timing and one without, in random order: the
//! ratio of such pairs is the cost of timing.
//!
//! Every cell gets the pairs of the first look. Then the scheduler looks at the samples. As long as claims are open,
//! only the cells of these claims are sampled on, up to the next look; after that the cells whose frame time is not precise yet,
//! those with the widest intervals first.
//! A look comes at [`LOOK_PAIRS`] pairs only, however the samples turn out, and the claims' intervals allow for that many looks.
//! Cells whose times nobody asks for render one frame.
//!
//! What each visit added is handed to [`Executor::keep`], so that a run that ends at any moment can be gone on with:
//! a cell begins with what [`Executor::earlier`] has of it.
//!
//! The scheduler reads no clock and touches no device: both are behind [`Executor`].

pub mod visit;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicBool, Ordering};

use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use fathom_clock::{FrameSample, Samples, Stopped, WarmUp, fault, frame_pair};
use fathom_experiments::LOOKS;
use fathom_record::{Addition, FramePair, MachineState};

/// Pairs of a cell at which its samples are looked at; each other one is twice the one before. A verdict needs 8 at least, and from
/// 12 on no interval ends at a single outlier. The end of the time is one more look.
pub const LOOK_PAIRS: [usize; LOOKS - 1] = [12, 24, 48, 96, 192];
/// Cells whose interval is at least so wide, as a share of the widest, are sampled on together.
const WIDE: f64 = 0.5;
/// Pairs that each cell gets however slow it is.
pub const MIN_PAIRS: usize = LOOK_PAIRS[0];
/// Pairs after which a cell stops in any case.
pub const MAX_PAIRS: usize = LOOK_PAIRS[LOOKS - 2];
/// Time that a cell may take to settle its claims and to become precise even when the budget is used up: short frames cost
/// hardly anything.
const FREE_S: f64 = 0.25;
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
    /// Its times are not asked for: one frame is rendered, untimed.
    fn untimed_only(&self, cell: usize) -> bool;
    /// Of these cells, whose samples are given, those that could settle a claim that is open.
    fn unsettled(&mut self, cells: &[(usize, &Samples)]) -> BTreeSet<usize>;
    /// Takes what was sampled of a cell, or why it failed, before [`release`](Self::release).
    fn finish(&mut self, cell: usize, result: Result<Samples, String>) -> Result<(), Self::Fatal>;
    /// Frees what [`prepare`](Self::prepare) made; also called for cells that failed.
    fn release(&mut self, cell: usize);
    /// Opens the device anew after its loss, or says why that is not possible.
    fn recover(&mut self) -> Result<(), String>;
    /// Seconds since any fixed moment.
    fn now_s(&self) -> f64;
    /// Seconds of Unix time.
    fn unix_s(&self) -> f64;
    /// The adapter's clocks and what holds them down; none where no driver tells.
    fn machine(&self) -> Option<MachineState> {
        None
    }
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
    /// Number of the first round.
    pub first_round: u32,
}

struct Live {
    samples: Samples,
    /// Pairs until the next look.
    target: usize,
    spent_s: f64,
    /// It has rendered frames on this device.
    warm: bool,
    /// Its samples are an earlier run's, and no frame of this run was held against them.
    unconfirmed: bool,
}

impl Live {
    fn new(earlier: &[Addition]) -> Self {
        let samples = Samples::of(earlier);
        Self {
            unconfirmed: samples.pairs() > 0,
            target: look_after(samples.pairs().saturating_sub(1)).unwrap_or(MAX_PAIRS),
            spent_s: 0.0,
            samples,
            warm: false,
        }
    }

    /// Another pair is due: the cell has rendered nothing yet that its figures could be read from, or has too few pairs, or
    /// is on its way to the next look and there is time.
    fn wants(&self, time_is_left: bool) -> bool {
        let pairs = self.samples.pairs();
        !self.warm || pairs < MIN_PAIRS || self.may_go_on(time_is_left) && pairs < self.target
    }

    fn may_go_on(&self, time_is_left: bool) -> bool {
        time_is_left || self.spent_s < FREE_S
    }

    /// There is enough of it for a record.
    fn suffices(&self) -> bool {
        self.warm && self.samples.pairs() >= MIN_PAIRS
    }
}

/// The first look at more pairs than these.
fn look_after(pairs: usize) -> Option<usize> {
    LOOK_PAIRS.into_iter().find(|look| *look > pairs)
}

/// Samples `cells` until all claims are settled and all cells precise, or the budget is used up, or `interrupted` is set. Every
/// cell is handed to [`Executor::finish`], except those that an interruption left with too little: what there is of them was
/// kept. Returns the number of the next round.
pub fn sample<X: Executor>(
    executor: &mut X,
    cells: &[usize],
    settings: &Settings,
    interrupted: &AtomicBool,
) -> Result<u32, X::Fatal> {
    let end_s = executor.now_s() + settings.budget_s;
    let mut sampler = Sampler {
        executor,
        interrupted,
        settings,
        random: Pcg64::seed_from_u64(settings.seed),
        live: BTreeMap::new(),
        round: settings.first_round,
        end_s,
        hopeless: None,
    };
    let mut waiting = cells;
    while !waiting.is_empty() && !sampler.interrupted() {
        let prepared = sampler.prepare_group(waiting)?;
        let share = prepared as f64 / waiting.len() as f64;
        let now_s = sampler.executor.now_s();
        sampler.end_s = now_s + (end_s - now_s).max(0.0) * share;
        sampler.sample_group()?;
        waiting = &waiting[prepared..];
    }
    Ok(sampler.round)
}

struct Sampler<'a, X: Executor> {
    executor: &'a mut X,
    interrupted: &'a AtomicBool,
    settings: &'a Settings,
    random: Pcg64,
    /// By the number of the cell.
    live: BTreeMap<usize, Live>,
    round: u32,
    /// When the group's time is over.
    end_s: f64,
    /// Why nothing can be measured any more.
    hopeless: Option<String>,
}

impl<X: Executor> Sampler<'_, X> {
    fn interrupted(&self) -> bool {
        self.interrupted.load(Ordering::Relaxed)
    }

    /// Prepares the first of the waiting cells, as many as fit into memory together, at least one; how many. Cells whose times
    /// are not asked for are done then.
    fn prepare_group(&mut self, waiting: &[usize]) -> Result<usize, X::Fatal> {
        let (mut used, mut largest) = (0u64, 0u64);
        for (done, &cell) in waiting.iter().enumerate() {
            let full = used.saturating_add(largest) > self.settings.group_bytes;
            if self.interrupted() || (done > 0 && full) {
                return Ok(done);
            }
            let earlier = self.executor.earlier(cell);
            self.live.insert(cell, Live::new(&earlier));
            let mut bytes = 0;
            self.attempt(cell, |sampler| {
                bytes = sampler.executor.prepare(cell)?;
                Ok(())
            })?;
            if self.executor.untimed_only(cell) {
                self.attempt(cell, |sampler| sampler.executor.untimed(cell).map(drop))?;
                self.close_sampled(cell, Stopped::UntimedOnly)?;
            } else {
                used = used.saturating_add(bytes);
                largest = largest.max(bytes);
            }
        }
        Ok(waiting.len())
    }

    fn sample_group(&mut self) -> Result<(), X::Fatal> {
        while !self.interrupted() {
            let time_is_left = self.executor.now_s() < self.end_s;
            let wanting = self.live.iter().filter(|(_, live)| live.wants(time_is_left));
            let mut round: Vec<usize> = wanting.map(|(cell, _)| *cell).collect();
            if round.is_empty() {
                if self.look(time_is_left)? {
                    continue;
                }
                break;
            }
            round.shuffle(&mut self.random);
            for cell in round {
                self.visit(cell)?;
            }
            self.round += 1;
            self.executor.end_round()?;
        }
        self.finish_rest()
    }

    /// Decides which cells are sampled on, and closes those that need no more while others go on; whether any does.
    fn look(&mut self, time_is_left: bool) -> Result<bool, X::Fatal> {
        let samples: Vec<(usize, &Samples)> =
            self.live.iter().map(|(cell, live)| (*cell, &live.samples)).collect();
        let open = self.executor.unsettled(&samples);
        let goes_on = |live: &Live| {
            live.may_go_on(time_is_left) && look_after(live.samples.pairs()).is_some()
        };
        let width = |live: &Live| live.samples.relative_half_width();
        let going = || self.live.iter().filter(|(_, live)| goes_on(live));
        let any_open = going().any(|(cell, _)| open.contains(cell));
        let widest = going().map(|(_, live)| width(live)).fold(0.0, f64::max);
        let enough = self.settings.precision;
        let (mut done, mut any) = (Vec::new(), false);
        for (cell, live) in &mut self.live {
            let wide = width(live) > enough;
            let vague = wide && goes_on(live);
            let next = if any_open {
                open.contains(cell) && goes_on(live)
            } else {
                vague && width(live) >= widest * WIDE
            };
            if next {
                live.target = look_after(live.samples.pairs()).unwrap_or(MAX_PAIRS);
                any = true;
            } else if !vague {
                let stopped = match (wide, time_is_left) {
                    (false, _) => Stopped::Precise,
                    (true, true) => Stopped::EnoughPairs,
                    (true, false) => Stopped::OutOfTime,
                };
                done.push((*cell, stopped));
            }
        }
        for (cell, stopped) in done {
            self.close_sampled(cell, stopped)?;
        }
        Ok(any)
    }

    /// One pair of frames, after warm-up if that is due; then the cell may have failed.
    fn visit(&mut self, cell: usize) -> Result<(), X::Fatal> {
        if self.interrupted() {
            return Ok(());
        }
        let start_s = self.executor.now_s();
        let mut added = Addition::default();
        self.attempt(cell, |sampler| sampler.warm_up(cell, &mut added))?;
        self.attempt(cell, |sampler| sampler.pair(cell, &mut added))?;
        let Some(live) = self.live.get_mut(&cell) else {
            return Ok(());
        };
        live.spent_s += self.executor.now_s() - start_s;
        live.samples.add(&added);
        let verdict = live.samples.verdict_on_rejections();
        self.executor.keep(cell, added)?;
        match verdict {
            Some(reason) => self.close(cell, Err(reason)),
            None => Ok(()),
        }
    }

    /// See [`WarmUp`].
    fn warm_up(&mut self, cell: usize, added: &mut Addition) -> Result<(), Failure> {
        if self.live[&cell].warm {
            return Ok(());
        }
        let mut warm_up = WarmUp::default();
        while !warm_up.is_over() && !self.interrupted() {
            warm_up.add(if warm_up.is_timed() {
                self.executor.timed(cell)?.envelope_ns
            } else {
                self.executor.untimed(cell)?
            });
        }
        added.warm_up_frames = warm_up.frames;
        added.unsteady = !warm_up.steady;
        self.live.entry(cell).and_modify(|live| live.warm = true);
        Ok(())
    }

    /// A timed and an untimed frame, in random order.
    fn pair(&mut self, cell: usize, added: &mut Addition) -> Result<(), Failure> {
        let (frame, untimed_ns) = if self.random.random_bool(0.5) {
            let frame = self.executor.timed(cell)?;
            (frame, self.executor.untimed(cell)?)
        } else {
            let untimed_ns = self.executor.untimed(cell)?;
            (self.executor.timed(cell)?, untimed_ns)
        };
        let taken = (self.round, self.executor.unix_s());
        let machine = self.executor.machine();
        let pair = FramePair { machine, ..frame_pair(&frame, untimed_ns, taken) };
        let Some(live) = self.live.get_mut(&cell) else {
            return Ok(());
        };
        if std::mem::take(&mut live.unconfirmed) && !live.samples.has_stages(&pair.stages) {
            live.samples = Samples::default();
            added.afresh = true;
        }
        added.rejected = fault(&frame, untimed_ns, live.samples.stages());
        added.pair = added.rejected.is_none().then_some(pair);
        Ok(())
    }

    /// Runs one step of a cell that is not closed; a failure closes the cell, and the loss of the device concerns all.
    fn attempt(
        &mut self,
        cell: usize,
        step: impl FnOnce(&mut Self) -> Result<(), Failure>,
    ) -> Result<(), X::Fatal> {
        if !self.live.contains_key(&cell) {
            return Ok(());
        }
        let result = match &self.hopeless {
            Some(reason) => Err(Failure::Cell(reason.clone())),
            None => step(self),
        };
        match result {
            Ok(()) => Ok(()),
            Err(Failure::Cell(reason)) => self.close(cell, Err(reason)),
            Err(Failure::DeviceLost(reason)) => {
                self.close(cell, Err(format!("device lost: {reason}")))?;
                self.recover(&reason)
            }
        }
    }

    /// Prepares the surviving cells on a new device; they keep their samples and warm up again.
    fn recover(&mut self, reason: &str) -> Result<(), X::Fatal> {
        if let Err(why) = self.executor.recover() {
            self.hopeless = Some(format!("device lost before ({reason}) and not recovered: {why}"));
        }
        let survivors: Vec<usize> = self.live.keys().copied().collect();
        for cell in survivors {
            let Some(live) = self.live.get_mut(&cell) else {
                continue;
            };
            live.warm = false;
            self.executor.release(cell);
            self.attempt(cell, |sampler| sampler.executor.prepare(cell).map(|_| ()))?;
        }
        Ok(())
    }

    /// Closes a cell with what was sampled of it, unless it is closed.
    fn close_sampled(&mut self, cell: usize, stopped: Stopped) -> Result<(), X::Fatal> {
        let Some(live) = self.live.get_mut(&cell) else {
            return Ok(());
        };
        let samples = std::mem::take(&mut live.samples);
        self.close(cell, Ok(Samples { stopped, ..samples }))
    }

    fn close(&mut self, cell: usize, result: Result<Samples, String>) -> Result<(), X::Fatal> {
        self.live.remove(&cell);
        let finished = self.executor.finish(cell, result);
        self.executor.release(cell);
        finished
    }

    /// Hands over what the group's remaining cells have.
    fn finish_rest(&mut self) -> Result<(), X::Fatal> {
        let interrupted = self.interrupted();
        let stopped = if interrupted { Stopped::Interrupted } else { Stopped::OutOfTime };
        while let Some((&cell, live)) = self.live.first_key_value() {
            if interrupted && !live.suffices() {
                self.live.remove(&cell);
                self.executor.release(cell);
            } else {
                self.close_sampled(cell, stopped)?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
