//! The time gate's schedule: which worker samples which cell when, and what is kept when a worker fails.
//!
//! A *launch* is a fresh pair of workers, and two more for the control. In each of its rounds every cell is sampled once by each side, one right after the
//! other; the order of cells is drawn anew each round, and which side comes first is drawn so that each comes first in
//! half of the rounds. The control is sampled by two workers of its own, both of the base.
//!
//! Cells that this first measurement leaves open are measured once more, by as many launches of more rounds: what scatters
//! between launches is for the greatest part what scatters between pairs. The second measurement stands for itself.
//!
//! A launch counts when it has gone through all its rounds; one in which a worker died is
//! thrown away and run anew without the cell that killed it.

use std::collections::BTreeSet;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_pcg::Pcg64;

use super::launch::WorkerFault;
use crate::record::comparison::{CellId, Compared, Fault, Gate, Launch, Pair, Side};

/// The second measurement has up to so many times the rounds of the first, as far as it takes no longer than that. With 64
/// pairs instead of 16 the figures of launches of `scene/gbuffer` scattered by 1.1 to 2.0 % instead of 2.6 to 3.8 % (llvmpipe).
const MORE_PAIRS: u32 = 4;
/// Launches that may fail for no cell's sake before the gate is given up.
const MAX_BROKEN_LAUNCHES: u32 = 2;

/// A worker of a launch.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum WorkerRole {
    Base,
    Head,
    /// The base once more, as the head of the control.
    ControlHead,
    /// And once more, as the base of the control. The base itself, which samples every cell, would differ from a control that
    /// samples one by up to 3 %.
    ControlBase,
}

impl WorkerRole {
    pub fn name(self) -> &'static str {
        match self {
            Self::Base => "base",
            Self::Head => "head",
            Self::ControlHead => "control",
            Self::ControlBase => "control's base",
        }
    }

    /// The build it runs.
    pub fn side(self) -> Side {
        match self {
            Self::Base | Self::ControlHead | Self::ControlBase => Side::Base,
            Self::Head => Side::Head,
        }
    }
}

/// Why a worker could not be used, and by which of them.
#[derive(Clone, Debug, PartialEq)]
pub struct RoleFault {
    pub role: WorkerRole,
    pub fault: WorkerFault,
}

/// A launch ready for its rounds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OpenedLaunch {
    /// Configurations that a side refused.
    pub refused: Vec<(String, RoleFault)>,
    /// Under which conditions the workers run.
    pub notes: Vec<String>,
}

/// A launch that did not get ready.
#[derive(Clone, Debug, PartialEq)]
pub struct BrokenLaunch {
    /// The configuration whose preparation ended a worker, if that was it.
    pub configuration: Option<String>,
    pub cause: RoleFault,
}

/// The workers of one launch at a time.
pub trait LaunchWorkers {
    /// Starts fresh workers and prepares the configurations of `cells`, and that of `control` for its workers.
    fn open(
        &mut self,
        launch: u32,
        cells: &[CellId],
        control: Option<&CellId>,
    ) -> Result<OpenedLaunch, BrokenLaunch>;
    /// One sample in ns, while the other workers rest.
    fn sample(&mut self, role: WorkerRole, cell: &CellId) -> Result<f64, WorkerFault>;
    /// Ends the workers.
    fn close(&mut self);
}

/// What the gate measures.
#[derive(Clone, Debug)]
pub struct Schedule {
    pub cells: Vec<CellId>,
    /// Measured once more with the base on both sides.
    pub control: Option<CellId>,
    pub launches: u32,
    /// Rounds of each launch.
    pub pairs: u32,
    pub seed: u64,
    /// It is the second measurement.
    pub second: bool,
}

impl Schedule {
    /// The second measurement, of the cells that this one left open.
    pub fn again(&self, open: Vec<CellId>) -> Self {
        let room = self.pairs as usize * self.cells.len() / open.len().max(1);
        let most = (MORE_PAIRS * self.pairs) as usize;
        Self {
            pairs: room.clamp(self.pairs as usize, most) as u32,
            cells: open,
            second: true,
            ..self.clone()
        }
    }
}

/// What an earlier run of the same comparison has left.
#[derive(Clone, Debug, Default)]
pub struct Before {
    /// Launches of this measurement that count.
    pub complete: u32,
    /// The highest number of a launch that anything is told of.
    pub last: Option<u32>,
    /// Cells that were given up.
    pub lost: BTreeSet<CellId>,
    /// The control was given up.
    pub control_lost: bool,
}

/// Runs the launches that lack. `sink` takes the lines of each launch together, as soon as it has ended.
pub fn run<E>(
    schedule: &Schedule,
    bench: &mut dyn LaunchWorkers,
    before: &Before,
    interrupted: &AtomicBool,
    sink: &mut dyn FnMut(Vec<Compared>) -> Result<(), E>,
) -> Result<(), E> {
    let mut gate = Gatekeeper {
        schedule,
        cells: schedule.cells.clone(),
        control: schedule.control.clone().filter(|_| !before.control_lost),
        interrupted,
    };
    gate.cells.retain(|cell| !before.lost.contains(cell));
    let mut complete = before.complete;
    let mut broken = 0;
    let mut launch = before.last.map_or(0, |last| last + 1);
    while complete < schedule.launches && !gate.cells.is_empty() {
        if interrupted.load(Ordering::Relaxed) {
            return Ok(());
        }
        let outcome = gate.launch(bench, launch);
        bench.close();
        match outcome {
            LaunchOutcome::Complete(lines) => {
                sink(lines)?;
                complete += 1;
            }
            LaunchOutcome::Interrupted => return Ok(()),
            LaunchOutcome::Spoilt(faults) => {
                let unattributed = faults.iter().any(|fault| fault.cell.is_none());
                sink(faults.into_iter().map(Compared::Fault).collect())?;
                broken += u32::from(unattributed);
                if broken >= MAX_BROKEN_LAUNCHES {
                    return Ok(());
                }
            }
        }
        launch += 1;
    }
    Ok(())
}

/// Runs launches and keeps count of the cells that are left.
struct Gatekeeper<'a> {
    schedule: &'a Schedule,
    cells: Vec<CellId>,
    control: Option<CellId>,
    interrupted: &'a AtomicBool,
}

enum LaunchOutcome {
    /// Its pairs, its faults, and the line that makes it count.
    Complete(Vec<Compared>),
    /// It does not count, for these reasons.
    Spoilt(Vec<Fault>),
    Interrupted,
}

/// One thing to be sampled in a round.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Visit {
    cell: CellId,
    control: bool,
    /// By round: the base comes first.
    base_first: Vec<bool>,
}

impl Gatekeeper<'_> {
    fn launch(&mut self, bench: &mut dyn LaunchWorkers, launch: u32) -> LaunchOutcome {
        let start = Instant::now();
        let mut faults = Vec::new();
        let opened = match bench.open(launch, &self.cells, self.control.as_ref()) {
            Ok(opened) => opened,
            Err(_) if self.is_interrupted() => return LaunchOutcome::Interrupted,
            Err(broken) => return LaunchOutcome::Spoilt(self.broken(launch, broken)),
        };
        for (configuration, cause) in opened.refused {
            faults.extend(self.lose_configuration(launch, &configuration, &cause));
        }
        let mut random = random(self.schedule.seed, launch);
        let mut visits = self.visits(&mut random);
        let mut pairs = Vec::new();
        // The round before the first settles what a stage alone in a frame needs, and is not kept.
        for round in std::iter::once(None).chain((0..self.schedule.pairs).map(Some)) {
            visits.shuffle(&mut random);
            let mut at = 0;
            while at < visits.len() {
                if self.is_interrupted() {
                    return LaunchOutcome::Interrupted;
                }
                match pair(bench, launch, round, &visits[at]) {
                    Ok(pair) => {
                        let second = self.schedule.second;
                        pairs.extend(round.map(|_| Pair { second, ..pair }));
                        at += 1;
                    }
                    // Whatever interrupted this process may have ended its workers as well.
                    Err(_) if self.is_interrupted() => return LaunchOutcome::Interrupted,
                    Err(cause) => {
                        let visit = visits.remove(at);
                        faults.push(self.lose(launch, &visit, &cause));
                        if !cause.fault.goes_on() {
                            return LaunchOutcome::Spoilt(faults);
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
            launch,
            wall_s: start.elapsed().as_secs_f64(),
            second: self.schedule.second,
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
        cells
            .chain(control)
            .map(|(cell, control)| {
                let mut base_first: Vec<bool> =
                    (0..self.schedule.pairs).map(|n| n % 2 == 0).collect();
                base_first.shuffle(random);
                Visit { cell: cell.clone(), control, base_first }
            })
            .collect()
    }

    /// The fault that ends this cell's part in the gate.
    fn lose(&mut self, launch: u32, visit: &Visit, cause: &RoleFault) -> Fault {
        if visit.control {
            return self.lose_control(launch, cause);
        }
        self.cells.retain(|cell| *cell != visit.cell);
        fault(launch, Some(&visit.cell), cause)
    }

    fn lose_control(&mut self, launch: u32, cause: &RoleFault) -> Fault {
        let cell = self.control.take();
        Fault { control: true, ..fault(launch, cell.as_ref(), cause) }
    }

    /// The faults that end a configuration's part: of all its cells, or of the control alone if only that could not be made.
    fn lose_configuration(
        &mut self,
        launch: u32,
        configuration: &str,
        cause: &RoleFault,
    ) -> Vec<Fault> {
        if matches!(cause.role, WorkerRole::ControlHead | WorkerRole::ControlBase) {
            return vec![self.lose_control(launch, cause)];
        }
        let concerned = |cell: &CellId| cell.configuration() == configuration;
        let (lost, left) =
            std::mem::take(&mut self.cells).into_iter().partition(|cell| concerned(cell));
        self.cells = left;
        let lost: Vec<CellId> = lost;
        let mut faults: Vec<Fault> =
            lost.iter().map(|cell| fault(launch, Some(cell), cause)).collect();
        if self.control.as_ref().is_some_and(concerned) {
            faults.push(self.lose_control(launch, cause));
        }
        faults
    }

    fn broken(&mut self, launch: u32, broken: BrokenLaunch) -> Vec<Fault> {
        match &broken.configuration {
            Some(configuration) => self.lose_configuration(launch, configuration, &broken.cause),
            None => vec![fault(launch, None, &broken.cause)],
        }
    }
}

fn fault(launch: u32, cell: Option<&CellId>, cause: &RoleFault) -> Fault {
    let reason = format!("{} worker: {}", cause.role.name(), cause.fault);
    let fault = Fault::new(Gate::Time, Some(cause.role.side()), cell.cloned(), reason);
    Fault { launch: Some(launch), ..fault }
}

/// The random numbers of a launch: each launch of a seed has a stretch of them to itself.
pub(super) fn random(seed: u64, launch: u32) -> Pcg64 {
    let mut random = Pcg64::seed_from_u64(seed);
    random.advance(u128::from(launch) << 64);
    random
}

/// Samples both sides of a cell.
fn pair(
    bench: &mut dyn LaunchWorkers,
    launch: u32,
    round: Option<u32>,
    visit: &Visit,
) -> Result<Pair, RoleFault> {
    let (base, head) = if visit.control {
        (WorkerRole::ControlBase, WorkerRole::ControlHead)
    } else {
        (WorkerRole::Base, WorkerRole::Head)
    };
    let mut sample = |role| {
        let sampled = bench.sample(role, &visit.cell);
        sampled.map_err(|fault| RoleFault { role, fault })
    };
    let base_first = round.is_none_or(|round| visit.base_first[round as usize]);
    let (base_ns, head_ns) = if base_first {
        let base_ns = sample(base)?;
        (base_ns, sample(head)?)
    } else {
        let head_ns = sample(head)?;
        (sample(base)?, head_ns)
    };
    Ok(Pair {
        launch,
        round: round.unwrap_or(0),
        cell: visit.cell.clone(),
        control: visit.control,
        second: false,
        first: if base_first { Side::Base } else { Side::Head },
        base_ns,
        head_ns,
    })
}

#[cfg(test)]
mod tests;
