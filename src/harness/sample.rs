//! Samples one visit of a batch of cells: which cell renders which frame next.
//!
//! The cells of a batch are prepared in groups that fit into memory together. Within a group they
//! are sampled round-robin, those that a claim compares back to back, in an order drawn anew each round
//! ([`visit`]): so the machine's drift affects all of them alike. A round renders a frame of each of its cells with
//! per-stage timing and one without: the ratio of the two is the cost of timing.
//!
//! A visit is [`VISIT_PAIRS`] rounds after a warm-up, however the samples turn out: more of them would show the same state of the machine
//! again. `harness::schedule` plans the next visit, by time alone. Cells whose times are not asked for render one frame.
//!
//! Before each preparation and each round the scheduler asks whether what is foreseen for it still fits before the deadline. What was
//! foreseen may be wrong: once the deadline is over no further step begins, be it a frame or the reading of a cell's figures.
//!
//! What cells have is handed to [`Executor::save`] after their first round and every `KEEP_INTERVAL_S`, so that a run that ends at any
//! moment can be gone on with: a cell begins with what [`Executor::earlier_samples`] has of it.
//!
//! The scheduler reads no clock and touches no device: both are behind [`Executor`].

pub mod visit;

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};

use rand::SeedableRng;
use rand_pcg::Pcg64;

use self::visit::{MAX_VISIT_S, VisitFrame, Visits};
use fathom_clock::{FrameSample, Samples, WarmUp};
use fathom_record::MachineState;

/// Pairs of frames of a cell in a visit: one in each order of the cells that are visited together.
pub const VISIT_PAIRS: usize = 2;

/// A run that is killed loses what was sampled for no longer than this and one step, seconds.
const KEEP_INTERVAL_S: f64 = 10.0;

/// Why a frame could not be rendered.
#[derive(Clone, Debug, PartialEq)]
pub enum Failure {
    /// This cell cannot be measured; others may be.
    Cell(String),
    /// The device is gone, and with it everything prepared on it.
    DeviceLost(String),
}

/// Takes the steps that the scheduler chooses. A cell is named by the caller's index.
pub trait Executor {
    /// An error that ends the run, such as a full disk.
    type Fatal;

    /// Makes everything that the cell's frames need; the GPU memory it took in bytes.
    fn prepare(&mut self, cell: usize) -> Result<u64, Failure>;
    /// Hands uploads over that wait, which would run with whatever is submitted next, and brings the GPU out of the clocks that it
    /// idles at.
    fn wake(&mut self) -> Result<(), Failure> {
        Ok(())
    }
    /// How long the machine takes for two fixed kernels at this moment, nanoseconds.
    fn pace(&mut self) -> Result<Option<[f64; 2]>, Failure> {
        Ok(None)
    }
    /// One frame with per-stage timing.
    fn time_frame(&mut self, cell: usize) -> Result<FrameSample, Failure>;
    /// One frame without; its wall time in nanoseconds.
    fn run_frame(&mut self, cell: usize) -> Result<f64, Failure>;
    /// What was taken of this cell before. Asked before its first frame.
    fn earlier_samples(&mut self, cell: usize) -> Samples;
    /// Keeps what was sampled of a cell up to now, which must outlive this process.
    fn save(&mut self, cell: usize, samples: &Samples) -> Result<(), Self::Fatal>;
    /// Its times are not asked for: one frame is rendered, untimed.
    fn untimed_only(&self, cell: usize) -> bool;
    fn forecast(&self, cell: usize) -> CostForecast;
    /// The cells of a batch in chains, in the order in which claims compare them; a cell that none compares is alone.
    fn chains(&self, cells: &[usize]) -> Vec<Vec<usize>>;
    /// Takes what was sampled of a cell, or why it failed, before [`release`](Self::release).
    fn finish(&mut self, cell: usize, result: Result<Samples, String>) -> Result<(), Self::Fatal>;
    /// Frees what [`prepare`](Self::prepare) made; also called for cells that failed.
    fn release(&mut self, cell: usize);
    /// Why the device is lost, where it is.
    fn loss_reason(&self) -> Option<String> {
        None
    }
    /// Seconds since any fixed moment.
    fn now_s(&self) -> f64;
    /// Seconds of Unix time.
    fn unix_s(&self) -> f64;
    /// The adapter's clocks and what holds them down; none where no driver tells.
    fn machine(&self) -> Option<MachineState> {
        None
    }
}

/// Seconds that the steps of a cell are expected to take.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CostForecast {
    pub prepare_s: f64,
    /// A timed and an untimed frame.
    pub pair_s: f64,
    /// Reading its figures, and their errors.
    pub finish_s: f64,
}

impl CostForecast {
    /// All of a visit: after a warm-up of two frames, or of one where the figures are known.
    pub fn visit_s(&self) -> f64 {
        let warm_up = if self.finish_s > 0.0 { 1.0 } else { 0.5 };
        self.prepare_s + self.pair_s * (VISIT_PAIRS as f64 + warm_up) + self.finish_s
    }
}

/// What and until when to sample.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Nothing is begun that is not foreseen to be over by then, on the executor's clock, seconds.
    pub deadline_s: f64,
    /// The first pair of frames is begun whatever is foreseen for it.
    pub at_least_one: bool,
    /// Memory that cells prepared at the same time should take together, in bytes. A group is closed
    /// once another cell as large as its largest would exceed this.
    pub group_bytes: u64,
    /// Seed of the order of cells and frames.
    pub seed: u64,
    /// Number of the first round.
    pub first_round: u32,
}

/// Why a cell failed in whose step the device was lost.
pub fn device_lost(reason: &str) -> String {
    format!("device lost: {reason}")
}

struct LiveCell {
    samples: Samples,
    /// Pairs to have in the end.
    target: usize,
    /// Of the latest pair.
    pair_s: Option<f64>,
    /// It has rendered frames since it was prepared.
    warm: bool,
    /// So many of its pairs were handed over.
    kept_pairs: usize,
}

impl LiveCell {
    fn new(samples: Samples) -> Self {
        Self {
            kept_pairs: samples.pairs(),
            target: samples.pairs() + VISIT_PAIRS,
            samples,
            pair_s: None,
            warm: false,
        }
    }

    /// Another pair is due: the cell has rendered nothing yet that its figures could be read from, or has too few pairs.
    fn needs_pair(&self) -> bool {
        !self.warm || self.samples.pairs() < self.target
    }
}

/// Samples one visit of `cells`, or up to the deadline, or until `interrupted` is set. Cells of which anything was sampled are handed
/// to [`Executor::finish`]; what there is of them when the time is over, the run is interrupted or the device is lost is
/// only kept. Returns the number of the next round.
pub fn sample<X: Executor>(
    executor: &mut X,
    cells: &[usize],
    settings: &Settings,
    interrupted: &AtomicBool,
) -> Result<u32, X::Fatal> {
    let mut sampler = Sampler {
        visits: Visits::new(executor.chains(cells)),
        interrupted,
        settings,
        random: Pcg64::seed_from_u64(settings.seed ^ u64::from(settings.first_round)),
        live: BTreeMap::new(),
        round: settings.first_round,
        kept_s: executor.now_s(),
        executor,
        owes_one: settings.at_least_one,
        late: false,
    };
    let mut waiting = cells;
    while !waiting.is_empty() && !sampler.has_to_end() {
        let prepared = sampler.prepare_group(waiting)?;
        sampler.sample_group()?;
        if prepared == 0 {
            break;
        }
        waiting = &waiting[prepared..];
    }
    Ok(sampler.round)
}

/// What a visit has of a cell up to now.
#[derive(Default)]
struct VisitSamples {
    timed: Option<FrameSample>,
    frame_ns: Option<f64>,
    /// What its frames took.
    frames_s: f64,
    pacer_ns: Option<[f64; 2]>,
}

struct Sampler<'a, X: Executor> {
    executor: &'a mut X,
    interrupted: &'a AtomicBool,
    settings: &'a Settings,
    random: Pcg64,
    visits: Visits,
    /// By the number of the cell.
    live: BTreeMap<usize, LiveCell>,
    round: u32,
    /// When everything was handed over.
    kept_s: f64,
    /// The first pair of frames is still to be taken, whatever is foreseen for it.
    owes_one: bool,
    /// A visit did not fit before the deadline.
    late: bool,
}

impl<X: Executor> Sampler<'_, X> {
    fn has_to_end(&self) -> bool {
        self.late || self.is_over()
    }

    /// No further step is begun.
    fn is_over(&self) -> bool {
        self.interrupted.load(Ordering::Relaxed)
            || self.executor.loss_reason().is_some()
            || self.executor.now_s() >= self.settings.deadline_s
    }

    /// Whether a step of this length, and the rest of all prepared cells after it, fits before the deadline.
    fn fits(&self, step_s: f64) -> bool {
        let rest_s: f64 = self.live.keys().map(|cell| self.executor.forecast(*cell).finish_s).sum();
        self.executor.now_s() + step_s + rest_s <= self.settings.deadline_s
    }

    /// Prepares the first of the waiting cells, as many as fit into memory together, at least one of those that there is time for; how many. Cells whose times
    /// are not asked for are done then.
    fn prepare_group(&mut self, waiting: &[usize]) -> Result<usize, X::Fatal> {
        let (mut used, mut largest, mut prepared) = (0u64, 0u64, waiting.len());
        for (done, &cell) in waiting.iter().enumerate() {
            let full = used.saturating_add(largest) > self.settings.group_bytes;
            let foreseen = self.executor.forecast(cell);
            // Of what the first cell took it is known whether there is time for others.
            let fits = self.owes_one && done == 0 || self.fits(foreseen.visit_s());
            if self.is_over() || (done > 0 && full) || !fits {
                prepared = done;
                break;
            }
            let earlier = self.executor.earlier_samples(cell);
            self.live.insert(cell, LiveCell::new(earlier));
            let mut bytes = 0;
            self.attempt(cell, |sampler| {
                bytes = sampler.executor.prepare(cell)?;
                Ok(())
            })?;
            if self.executor.untimed_only(cell) && !self.is_over() {
                self.attempt(cell, |sampler| sampler.executor.run_frame(cell).map(drop))?;
                self.close_sampled(cell)?;
                self.owes_one = false;
            } else {
                used = used.saturating_add(bytes);
                largest = largest.max(bytes);
            }
        }
        Ok(prepared)
    }

    fn sample_group(&mut self) -> Result<(), X::Fatal> {
        if let Some(cell) = self.live.keys().next().copied().filter(|_| !self.is_over()) {
            self.attempt(cell, |sampler| sampler.executor.wake())?;
        }
        while !self.has_to_end() {
            let wanting = self.live.iter().filter(|(_, live)| live.needs_pair());
            let wanting: Vec<usize> = wanting.map(|(cell, _)| *cell).collect();
            if wanting.is_empty() {
                break;
            }
            let pair_s =
                |cell: usize| self.live.get(&cell).and_then(|live| live.pair_s).unwrap_or(0.0);
            for frames in self.visits.round(&wanting, pair_s, &mut self.random) {
                self.visit(&frames)?;
            }
            self.round += 1;
        }
        self.finish_rest()
    }

    /// The frames of a round of cells that are visited together, after warm-ups that are due; then a cell may have failed.
    fn visit(&mut self, frames: &[VisitFrame]) -> Result<(), X::Fatal> {
        let mut taken: BTreeMap<usize, VisitSamples> =
            frames.iter().map(|frame| (frame.cell, VisitSamples::default())).collect();
        let foreseen_s = taken.keys().filter_map(|cell| {
            let live = self.live.get(cell)?;
            let pair_s = live.pair_s.unwrap_or_else(|| self.executor.forecast(*cell).pair_s);
            Some(if live.warm { pair_s } else { 2.0 * pair_s })
        });
        let foreseen_s = foreseen_s.sum();
        self.late |= !self.owes_one && !self.fits(foreseen_s);
        if self.has_to_end() {
            return Ok(());
        }
        for &cell in taken.keys() {
            self.attempt(cell, |sampler| sampler.warm_up(cell))?;
        }
        let (mut paced_s, mut pacer_ns) = (f64::NEG_INFINITY, None);
        for VisitFrame { cell, timed } in frames.iter().copied() {
            if self.is_over() || !self.live.get(&cell).is_some_and(|live| live.warm) {
                continue;
            }
            if self.executor.now_s() - paced_s >= MAX_VISIT_S {
                self.attempt(cell, |sampler| {
                    pacer_ns = sampler.executor.pace()?;
                    Ok(())
                })?;
                paced_s = self.executor.now_s();
            }
            let start_s = self.executor.now_s();
            let taken = taken.entry(cell).or_default();
            taken.pacer_ns = taken.pacer_ns.or(pacer_ns);
            self.attempt(cell, |sampler| {
                if timed {
                    taken.timed = Some(sampler.executor.time_frame(cell)?);
                } else {
                    taken.frame_ns = Some(sampler.executor.run_frame(cell)?);
                }
                Ok(())
            })?;
            taken.frames_s += self.executor.now_s() - start_s;
        }
        self.owes_one = false;
        let (unix_s, machine) = (self.executor.unix_s(), self.executor.machine());
        for (cell, taken) in taken {
            self.add(cell, taken, unix_s, machine.clone())?;
        }
        self.save_due()
    }

    /// Hands over what cells have: those of a first pair at once, and all of them every now and then.
    fn save_due(&mut self) -> Result<(), X::Fatal> {
        let now_s = self.executor.now_s();
        let is_due = now_s - self.kept_s >= KEEP_INTERVAL_S;
        if is_due {
            self.kept_s = now_s;
        }
        for (cell, live) in &mut self.live {
            let pairs = live.samples.pairs();
            if pairs != live.kept_pairs && (is_due || live.kept_pairs == 0) {
                live.kept_pairs = pairs;
                self.executor.save(*cell, &live.samples)?;
            }
        }
        Ok(())
    }

    /// See [`WarmUp`].
    fn warm_up(&mut self, cell: usize) -> Result<(), Failure> {
        if self.live[&cell].warm {
            return Ok(());
        }
        let last = self.live[&cell].samples.pairs.last();
        let mut warm_up = WarmUp::after(last.map(|pair| pair.envelope_ns));
        while !warm_up.is_over() && !self.is_over() {
            warm_up.add(if warm_up.is_timed() {
                self.executor.time_frame(cell)?.envelope_ns
            } else {
                self.executor.run_frame(cell)?
            });
        }
        self.live.entry(cell).and_modify(|live| {
            live.warm = true;
            live.samples.warm_up_frames += warm_up.frames;
            live.samples.unsteady |= !warm_up.steady;
        });
        Ok(())
    }

    /// Adds what a visit gave of a cell. An interruption or a loss of the device may have left a frame without the other.
    fn add(
        &mut self,
        cell: usize,
        taken: VisitSamples,
        unix_s: f64,
        machine: Option<MachineState>,
    ) -> Result<(), X::Fatal> {
        let Some(live) = self.live.get_mut(&cell) else {
            return Ok(());
        };
        if let (Some(frame), Some(frame_ns)) = (taken.timed, taken.frame_ns) {
            live.pair_s = Some(taken.frames_s);
            let all_earlier = live.samples.pairs() == live.samples.earlier_pairs;
            if all_earlier && !live.samples.has_stages(&frame.stages) {
                (live.samples, live.kept_pairs) = (Samples::default(), 0);
            }
            live.samples.add(frame, frame_ns, self.round, unix_s, machine, taken.pacer_ns);
        }
        match live.samples.verdict_on_rejections() {
            Some(reason) => self.close(cell, Err(reason)),
            None => Ok(()),
        }
    }

    /// Runs one step of a cell that is not closed; a failure closes the cell.
    fn attempt(
        &mut self,
        cell: usize,
        step: impl FnOnce(&mut Self) -> Result<(), Failure>,
    ) -> Result<(), X::Fatal> {
        if !self.live.contains_key(&cell) {
            return Ok(());
        }
        match step(self) {
            Ok(()) => Ok(()),
            Err(Failure::Cell(reason)) => self.close(cell, Err(reason)),
            Err(Failure::DeviceLost(reason)) => self.close(cell, Err(device_lost(&reason))),
        }
    }

    /// Closes a cell with what was sampled of it, unless it is closed.
    fn close_sampled(&mut self, cell: usize) -> Result<(), X::Fatal> {
        let Some(live) = self.live.get_mut(&cell) else {
            return Ok(());
        };
        let samples = std::mem::take(&mut live.samples);
        self.close(cell, Ok(samples))
    }

    fn close(&mut self, cell: usize, result: Result<Samples, String>) -> Result<(), X::Fatal> {
        self.live.remove(&cell);
        let finished = self.executor.finish(cell, result);
        self.executor.release(cell);
        finished
    }

    /// Hands over what the group's cells have. What rendered nothing, or comes when the run is over or the device is lost, is kept for later.
    fn finish_rest(&mut self) -> Result<(), X::Fatal> {
        while let Some((&cell, live)) = self.live.first_key_value() {
            if self.is_over() || !live.warm || live.samples.pairs() == 0 {
                if live.samples.pairs() != live.kept_pairs {
                    self.executor.save(cell, &live.samples)?;
                }
                self.live.remove(&cell);
                self.executor.release(cell);
            } else {
                self.close_sampled(cell)?;
                self.save_due()?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
