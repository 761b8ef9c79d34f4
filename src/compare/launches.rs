//! Launches of the time gate: which worker samples which cell when, and what is kept when a worker fails.
//!
//! A *launch* is a fresh pair of workers, and two more for the control. In each of its rounds every cell is sampled once by
//! each side, one right after the other; the order of cells is drawn anew each round, and which side comes first is drawn so
//! that each comes first in half of the rounds. The control is sampled by two workers of its own, both of the base in one launch
//! and of the head in the next.
//!
//! A launch counts when it has gone through all its rounds. One in which a worker died is discarded and run anew without the
//! cell that killed it.

use std::collections::BTreeSet;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_pcg::Pcg64;
use strum::Display;

use super::worker_process::WorkerFault;
use fathom_record::MachineState;
use fathom_record::comparison::{CellId, Compared, Fault, Gate, Launch, Pair, PairStates, Side};

/// What the launches until the next look measure.
#[derive(Clone, Debug)]
pub struct GateSchedule {
    pub cells: Vec<CellId>,
    /// Measured once more with one build on both sides.
    pub control: Option<CellId>,
    /// All those that the comparison then has.
    pub launches: u32,
    /// Rounds of each launch.
    pub pairs: u32,
    pub seed: u64,
}

/// The gate is given up after so many failed launches that no cell caused.
const MAX_BROKEN_LAUNCHES: u32 = 2;

/// Role of a worker in a launch.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Display)]
pub enum WorkerRole {
    #[strum(to_string = "base")]
    Base,
    #[strum(to_string = "head")]
    Head,
    /// The launch's control side once more, as the head of the control.
    #[strum(to_string = "control")]
    ControlHead,
    /// And once more, as the base of the control. The worker that samples every cell would differ from a control that samples one
    /// by up to 3 %.
    #[strum(to_string = "control's base")]
    ControlBase,
}

impl WorkerRole {
    /// The build that it runs in a launch.
    pub fn side(self, launch: u32) -> Side {
        match self {
            Self::Base => Side::Base,
            Self::Head => Side::Head,
            Self::ControlHead | Self::ControlBase => Side::BOTH[launch as usize % 2],
        }
    }

    pub fn is_control(self) -> bool {
        matches!(self, Self::ControlBase | Self::ControlHead)
    }
}

/// Why a worker could not be used, and which.
#[derive(Clone, Debug, PartialEq)]
pub struct RoleFault {
    pub role: WorkerRole,
    /// The configuration that it was to prepare, if that was it.
    pub configuration: Option<String>,
    pub fault: WorkerFault,
}

/// A launch ready for its rounds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OpenedLaunch {
    /// What sides refused.
    pub refused: Vec<RoleFault>,
    /// The only core that is measured on, if the workers are kept on one.
    pub core: Option<usize>,
    /// Conditions of a quiet measurement that could not be had.
    pub notes: Vec<String>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct SideSample {
    pub ns: f64,
    /// The adapter after it, where its driver tells.
    pub machine: Option<MachineState>,
}

/// The workers of one launch at a time.
pub trait LaunchWorkers {
    /// Starts fresh workers and prepares the configurations of `cells`, and that of `control` for its workers. A worker that ends
    /// meanwhile is an error.
    fn open(
        &mut self,
        launch: u32,
        cells: &[CellId],
        control: Option<&CellId>,
    ) -> Result<OpenedLaunch, RoleFault>;
    /// The shortest of so many frames, while the other workers rest.
    fn sample(
        &mut self,
        role: WorkerRole,
        cell: &CellId,
        frames: u32,
    ) -> Result<SideSample, WorkerFault>;
    /// Ends the workers.
    fn close(&mut self);
}

/// What an earlier run of the same comparison has left.
#[derive(Clone, Debug, Default)]
pub struct EarlierLaunches {
    /// Launches that count.
    pub complete: u32,
    /// The highest number of a launch that any record names.
    pub last: Option<u32>,
    /// Cells that were given up.
    pub given_up: BTreeSet<CellId>,
    /// The control was given up.
    pub control_lost: bool,
}

/// Runs the missing launches. `sink` takes the lines of each launch together, as soon as it has ended.
pub fn run<E>(
    schedule: &GateSchedule,
    workers: &mut dyn LaunchWorkers,
    before: &EarlierLaunches,
    interrupted: &AtomicBool,
    mut sink: impl FnMut(Vec<Compared>) -> Result<(), E>,
) -> Result<(), E> {
    let remaining = schedule.cells.iter().filter(|cell| !before.given_up.contains(cell));
    let mut gate = LaunchRunner {
        schedule,
        workers,
        launch: before.last.map_or(0, |last| last + 1),
        cells: remaining.cloned().collect(),
        control: schedule.control.clone().filter(|_| !before.control_lost),
        interrupted,
    };
    let mut complete = before.complete;
    let mut broken = 0;
    while complete < schedule.launches && !gate.cells.is_empty() && !gate.is_interrupted() {
        let outcome = gate.launch();
        gate.workers.close();
        match outcome {
            LaunchOutcome::Complete(lines) => {
                sink(lines)?;
                complete += 1;
            }
            LaunchOutcome::Interrupted => break,
            LaunchOutcome::Discarded(faults) => {
                broken += u32::from(faults.iter().any(|fault| fault.cell.is_none()));
                sink(faults.into_iter().map(Compared::Fault).collect())?;
                if broken >= MAX_BROKEN_LAUNCHES {
                    break;
                }
            }
        }
        gate.launch += 1;
    }
    Ok(())
}

/// Runs launches and keeps count of the cells that are left.
struct LaunchRunner<'a> {
    schedule: &'a GateSchedule,
    workers: &'a mut dyn LaunchWorkers,
    /// Number of the launch that is run.
    launch: u32,
    cells: Vec<CellId>,
    control: Option<CellId>,
    interrupted: &'a AtomicBool,
}

enum LaunchOutcome {
    /// Its pairs, its faults, and the line that makes it count.
    Complete(Vec<Compared>),
    /// It does not count, for these reasons.
    Discarded(Vec<Fault>),
    Interrupted,
}

/// One thing to be sampled in a round.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Visit {
    cell: CellId,
    control: bool,
    /// By round: the base comes first.
    base_first: Vec<bool>,
    /// Of a sample, of either side.
    frames: u32,
}

/// The frames of a sample last at least so long together, so that a stage of microseconds is no mere reading of the clock;
/// the shortest counts, as what disturbs a frame only makes it longer.
///
/// Time for more frames than that is better spent on more pairs. On a machine with four times as many busy processes as
/// cores, ratios of single frames of 0.8 ms scattered by 9 % and those of the shortest of four by 7 %, which four times the
/// pairs would have brought to 4.5 %.
const SAMPLE_NS: f64 = 3e5;
/// Most frames of a sample.
const MAX_FRAMES: f64 = 8.0;

impl LaunchRunner<'_> {
    fn launch(&mut self) -> LaunchOutcome {
        let start = Instant::now();
        let mut faults = Vec::new();
        let opened = match self.workers.open(self.launch, &self.cells, self.control.as_ref()) {
            Ok(opened) => opened,
            Err(_) if self.is_interrupted() => return LaunchOutcome::Interrupted,
            Err(cause) => return LaunchOutcome::Discarded(self.unprepared(&cause)),
        };
        for cause in opened.refused {
            faults.extend(self.unprepared(&cause));
        }
        let mut random = random(self.schedule.seed, self.launch);
        let mut visits = self.visits(&mut random);
        let mut pairs = Vec::new();
        // The round before the first settles what a stage alone in a frame needs, by one frame of each side, and is not kept.
        for round in std::iter::once(None).chain((0..self.schedule.pairs).map(Some)) {
            visits.shuffle(&mut random);
            let mut at = 0;
            while at < visits.len() {
                if self.is_interrupted() {
                    return LaunchOutcome::Interrupted;
                }
                match self.pair(round, &visits[at]) {
                    Ok(pair) => {
                        if round.is_none() {
                            let shortest_ns = pair.base_ns.min(pair.head_ns);
                            let frames = (SAMPLE_NS / shortest_ns).ceil().clamp(1.0, MAX_FRAMES);
                            visits[at].frames = frames as u32;
                        }
                        pairs.extend(round.map(|_| pair));
                        at += 1;
                    }
                    // Whatever interrupted this process may have ended its workers as well.
                    Err(_) if self.is_interrupted() => return LaunchOutcome::Interrupted,
                    Err(cause) => {
                        let lost = visits.remove(at);
                        faults.extend(self.lose(&cause, |cell, control| {
                            (cell, control) == (&lost.cell, lost.control)
                        }));
                        if !cause.fault.is_alive() {
                            return LaunchOutcome::Discarded(faults);
                        }
                    }
                }
            }
        }
        pairs.retain(|pair| {
            let whole = |visit: &Visit| visit.cell == pair.cell && visit.control == pair.control;
            visits.iter().any(whole)
        });
        let ended = Launch {
            launch: self.launch,
            wall_s: start.elapsed().as_secs_f64(),
            second: false,
            core: opened.core,
            notes: opened.notes,
        };
        let faults = faults.into_iter().map(Compared::Fault);
        let lines = pairs.into_iter().map(Compared::Pair).chain(faults);
        LaunchOutcome::Complete(lines.chain([Compared::Launch(ended)]).collect())
    }

    fn is_interrupted(&self) -> bool {
        self.interrupted.load(Ordering::Relaxed)
    }

    fn visits(&self, random: &mut Pcg64) -> Vec<Visit> {
        let cells = self.cells.iter().map(|cell| (cell, false));
        let control = self.control.iter().map(|cell| (cell, true));
        let visit = |(cell, control): (&CellId, bool)| {
            // Of an odd number the one more falls to another side in the next launch.
            let mut base_first: Vec<bool> = (0..self.schedule.pairs)
                .map(|round| (round + self.launch).is_multiple_of(2))
                .collect();
            base_first.shuffle(random);
            Visit { cell: cell.clone(), control, base_first, frames: 1 }
        };
        cells.chain(control).map(visit).collect()
    }

    /// Samples both sides of a cell. The round before the first has no number; which side comes first in it alternates by launch.
    fn pair(&mut self, round: Option<u32>, visit: &Visit) -> Result<Pair, RoleFault> {
        let (base, head) = if visit.control {
            (WorkerRole::ControlBase, WorkerRole::ControlHead)
        } else {
            (WorkerRole::Base, WorkerRole::Head)
        };
        let mut sample = |role| {
            let sampled = self.workers.sample(role, &visit.cell, visit.frames);
            sampled.map_err(|fault| RoleFault { role, configuration: None, fault })
        };
        let base_first = match round {
            Some(round) => visit.base_first[round as usize],
            None => self.launch.is_multiple_of(2),
        };
        let (of_base, of_head) = if base_first {
            let of_base = sample(base)?;
            (of_base, sample(head)?)
        } else {
            let of_head = sample(head)?;
            (sample(base)?, of_head)
        };
        Ok(Pair {
            launch: self.launch,
            round: round.unwrap_or(0),
            cell: visit.cell.clone(),
            control: visit.control,
            second: false,
            first: if base_first { Side::Base } else { Side::Head },
            base_ns: of_base.ns,
            head_ns: of_head.ns,
            machine: PairStates { base: of_base.machine, head: of_head.machine },
        })
    }

    /// The faults that end the part of some cells in the gate, and of the control if it is one of them.
    fn lose(&mut self, cause: &RoleFault, is_lost: impl Fn(&CellId, bool) -> bool) -> Vec<Fault> {
        let cells: Vec<CellId> = self.cells.extract_if(.., |cell| is_lost(cell, false)).collect();
        let control = self.control.take_if(|cell| is_lost(cell, true));
        let faults = cells.into_iter().map(|cell| self.fault(Some(cell), cause));
        let of_control = |cell| Fault { control: true, ..self.fault(Some(cell), cause) };
        faults.chain(control.map(of_control)).collect()
    }

    /// The faults that follow where workers could not be made ready: of all cells of a configuration, of the control alone if
    /// only that could not be prepared, or of the launch.
    fn unprepared(&mut self, cause: &RoleFault) -> Vec<Fault> {
        let Some(id) = &cause.configuration else { return vec![self.fault(None, cause)] };
        let control_alone = cause.role.is_control();
        self.lose(cause, |cell, control| cell.configuration() == id && (control || !control_alone))
    }

    fn fault(&self, cell: Option<CellId>, cause: &RoleFault) -> Fault {
        let reason = format!("{} worker: {}", cause.role, cause.fault);
        let side = cause.role.side(self.launch);
        let fault = Fault::new(Gate::Time, Some(side), cell, reason);
        Fault { launch: Some(self.launch), ..fault }
    }
}

/// The random numbers of a launch: each launch of a seed has a stretch of them to itself.
pub(super) fn random(seed: u64, launch: u32) -> Pcg64 {
    let mut random = Pcg64::seed_from_u64(seed);
    random.advance(u128::from(launch) << 64);
    random
}

#[cfg(test)]
mod tests;
