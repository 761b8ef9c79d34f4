//! The workers of the time gate: a base, a head and, for the control, two more of the base, started afresh for each launch.

use std::collections::BTreeMap;

use rand::RngExt;

use super::launch::{Quiet, Waiting, WorkerFault, WorkerProcess, WorkerStart, allowed_cores};
use super::protocol::{GateConfiguration, Greeting, Reply, WorkerRequest};
use super::quiet::PADDING_BYTES;
use super::rounds::{BrokenLaunch, LaunchWorkers, OpenedLaunch, RoleFault, WorkerRole, random};
use crate::gpu::ClockPlan;
use crate::record::Adapter;
use crate::record::comparison::CellId;

/// The frames of a sample last at least so long together, so that a stage of microseconds is no mere reading of the clock;
/// the shortest counts, as what disturbs a frame only makes it longer.
///
/// Time for more frames than that is better spent on more pairs. On a machine with four times as many busy processes as
/// cores, ratios of single frames of 0.8 ms scattered by 9 % and those of the shortest of four by 7 %, which four times the
/// pairs would have brought to 4.5 %.
const SAMPLE_NS: f64 = 3e5;
/// Most frames of a sample.
const MAX_FRAMES: f64 = 8.0;

/// Processes that serve a [`Bench`].
pub struct Processes<'a> {
    base: WorkerStart,
    head: WorkerStart,
    waiting: Waiting<'a>,
    configurations: BTreeMap<String, GateConfiguration>,
    pub adapter: Adapter,
    clock: Option<ClockPlan>,
    cores: Vec<usize>,
    seed: u64,
    workers: Vec<(WorkerRole, WorkerProcess)>,
    /// Frames of a sample of each cell, from its first one in this launch.
    frames: BTreeMap<CellId, u32>,
}

impl<'a> Processes<'a> {
    /// Asks a first base worker for the adapter, and for its clock where it is hardware: both sides then read the same
    /// clock, and each launch is spared the audit.
    pub fn new(
        base: WorkerStart,
        head: WorkerStart,
        configurations: &[GateConfiguration],
        seed: u64,
        waiting: Waiting<'a>,
    ) -> Result<Self, RoleFault> {
        let (adapter, clock) =
            probe(&base, &waiting).map_err(|fault| RoleFault { role: WorkerRole::Base, fault })?;
        let named =
            |configuration: &GateConfiguration| (configuration.id.clone(), configuration.clone());
        Ok(Self {
            base,
            head,
            waiting,
            configurations: configurations.iter().map(named).collect(),
            adapter,
            clock,
            cores: allowed_cores(),
            seed,
            workers: Vec::new(),
            frames: BTreeMap::new(),
        })
    }

    fn start(&mut self, launch: u32, roles: &[WorkerRole]) -> Result<(), RoleFault> {
        let padding = random(self.seed, launch).random_range(0..PADDING_BYTES);
        for (place, role) in roles.iter().enumerate() {
            let mut start = match role {
                WorkerRole::Head => self.head.clone(),
                WorkerRole::Base | WorkerRole::ControlHead | WorkerRole::ControlBase => {
                    self.base.clone()
                }
            };
            start.name = role.name();
            start.clock = self.clock;
            start.quiet = self.adapter.software.then(|| Quiet {
                core: core(&self.cores, launch as usize + place),
                padding,
                keep_memory: true,
            });
            let started = WorkerProcess::start(&start).and_then(|mut worker| {
                worker.greet()?;
                Ok(worker)
            });
            let worker = started.map_err(of(*role))?;
            self.workers.push((*role, worker));
        }
        Ok(())
    }

    fn greeted(&mut self) -> Result<Vec<Greeting>, RoleFault> {
        let mut greetings = Vec::new();
        for (role, worker) in &mut self.workers {
            let greeting = worker.greeted(&self.waiting).map_err(of(*role))?;
            if greeting.adapter.name != self.adapter.name
                || greeting.adapter.driver_info != self.adapter.driver_info
            {
                let reason = format!(
                    "it runs on {} ({}), the base on {} ({})",
                    greeting.adapter.name,
                    greeting.adapter.driver_info,
                    self.adapter.name,
                    self.adapter.driver_info
                );
                return Err(of(*role)(WorkerFault::fatal(reason)));
            }
            greetings.push(greeting);
        }
        Ok(greetings)
    }

    /// All workers prepare a configuration at the same time. The fault of the first that refuses it.
    fn prepare(
        &mut self,
        configuration: &GateConfiguration,
        control: bool,
    ) -> Result<Option<RoleFault>, RoleFault> {
        let request = WorkerRequest::Prepare { configuration: configuration.clone() };
        let wanted =
            |role: &WorkerRole| matches!(role, WorkerRole::Base | WorkerRole::Head) || control;
        let concerned = self.workers.iter_mut().filter(|(role, _)| wanted(role));
        let mut concerned: Vec<_> = concerned.collect();
        for (role, worker) in &mut concerned {
            worker.send(&request).map_err(of(*role))?;
        }
        let mut refused = None;
        for (role, worker) in concerned {
            let fault = match worker.receive(&self.waiting) {
                Ok(Reply::Prepared { .. }) => continue,
                Ok(other) => worker.unexpected(&other),
                Err(fault) => fault,
            };
            if !fault.goes_on() {
                return Err(of(*role)(fault));
            }
            refused = refused.or(Some(of(*role)(fault)));
        }
        Ok(refused)
    }

    /// The conditions that this launch runs under, those first that could not be had.
    fn notes(&self, launch: u32, greetings: &[Greeting]) -> Vec<String> {
        let mut notes = Vec::new();
        if !self.adapter.software {
            return notes;
        }
        if greetings.iter().any(|greeting| greeting.randomized != Some(false)) {
            notes.push("addresses are randomized: the system does not allow otherwise".to_owned());
        }
        match core(&self.cores, launch as usize) {
            Some(core) => notes.push(format!("on core {core}")),
            None => notes.push("on any core: pinning is done on Linux only".to_owned()),
        }
        notes
    }
}

impl LaunchWorkers for Processes<'_> {
    fn open(
        &mut self,
        launch: u32,
        cells: &[CellId],
        control: Option<&CellId>,
    ) -> Result<OpenedLaunch, BrokenLaunch> {
        let broken = |cause| BrokenLaunch { configuration: None, cause };
        self.start(launch, &order(launch, control.is_some())).map_err(broken)?;
        let greetings = self.greeted().map_err(broken)?;
        let mut opened =
            OpenedLaunch { refused: Vec::new(), notes: self.notes(launch, &greetings) };
        let mut wanted: Vec<&str> =
            cells.iter().chain(control).map(CellId::configuration).collect();
        wanted.sort_unstable();
        wanted.dedup();
        for id in wanted {
            let Some(configuration) = self.configurations.get(id).cloned() else {
                continue;
            };
            let of_control = control.is_some_and(|cell| cell.configuration() == id);
            match self.prepare(&configuration, of_control) {
                Ok(None) => {}
                Ok(Some(cause)) => opened.refused.push((id.to_owned(), cause)),
                Err(cause) => {
                    return Err(BrokenLaunch { configuration: Some(id.to_owned()), cause });
                }
            }
        }
        if self.adapter.software
            && let Some(core) = core(&self.cores, launch as usize)
        {
            self.workers.iter().for_each(|(_, worker)| worker.pin(core));
        }
        Ok(opened)
    }

    fn sample(&mut self, role: WorkerRole, cell: &CellId) -> Result<f64, WorkerFault> {
        let of_party = self.workers.iter_mut().find(|(known, _)| *known == role);
        let Some((_, worker)) = of_party else {
            return Err(WorkerFault::fatal("it was not started".to_owned()));
        };
        let frames = self.frames.get(cell).copied();
        let request = WorkerRequest::Sample {
            config: cell.configuration().to_owned(),
            stage: cell.stage().to_owned(),
            frames: frames.unwrap_or(1),
        };
        let ns = match worker.ask(&request, &self.waiting)? {
            Reply::Sample { ns } if sound(&ns, frames.unwrap_or(1)) => ns,
            other => return Err(worker.unexpected(&other)),
        };
        let shortest_ns = ns.into_iter().fold(f64::INFINITY, f64::min);
        if frames.is_none() {
            let frames = (SAMPLE_NS / shortest_ns).ceil().clamp(1.0, MAX_FRAMES);
            self.frames.insert(cell.clone(), frames as u32);
        }
        Ok(shortest_ns)
    }

    fn close(&mut self) {
        // Killed: a driver's orderly end takes longer and is not waited for.
        self.workers.clear();
        self.frames.clear();
    }
}

fn of(role: WorkerRole) -> impl FnOnce(WorkerFault) -> RoleFault {
    move |fault| RoleFault { role, fault }
}

fn sound(ns: &[f64], frames: u32) -> bool {
    let positive = |ns: &f64| ns.is_finite() && *ns > 0.0;
    ns.len() == frames as usize && ns.iter().all(positive)
}

/// Who is started first, and with that on which core, changes every second launch while the core that is measured on changes
/// every launch. Of equal programs started always in the same order, the second was up to 2 % faster in stages bound by
/// memory.
fn order(launch: u32, control: bool) -> Vec<WorkerRole> {
    let mut order = vec![WorkerRole::Base, WorkerRole::Head];
    if control {
        order.extend([WorkerRole::ControlBase, WorkerRole::ControlHead]);
    }
    if launch / 2 % 2 == 1 {
        order.chunks_mut(2).for_each(<[WorkerRole]>::reverse);
    }
    order
}

/// The cores in turn.
fn core(cores: &[usize], turn: usize) -> Option<usize> {
    (!cores.is_empty()).then(|| cores[turn % cores.len()])
}

fn probe(
    base: &WorkerStart,
    waiting: &Waiting<'_>,
) -> Result<(Adapter, Option<ClockPlan>), WorkerFault> {
    let mut worker = WorkerProcess::start(base)?;
    worker.greet()?;
    let adapter = worker.greeted(waiting)?.adapter;
    let clock = match adapter.software {
        true => None,
        false => match worker.ask(&WorkerRequest::Clock, waiting)? {
            Reply::Clock { clock } => Some(clock),
            other => return Err(worker.unexpected(&other)),
        },
    };
    worker.quit();
    Ok((adapter, clock))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_side_starts_first_on_each_core_equally_often() {
        let cores = [4, 7];
        let mut first = BTreeMap::new();
        for launch in 0..20 {
            let roles = order(launch, true);
            assert!(
                roles[2..].contains(&WorkerRole::ControlHead)
                    && roles[2..].contains(&WorkerRole::ControlBase)
            );
            assert_eq!(order(launch, false), roles[..2]);
            let place = (roles[0], core(&cores, launch as usize));
            *first.entry(place).or_insert(0) += 1;
        }
        assert_eq!(first.into_values().collect::<Vec<_>>(), [5; 4]);
    }
}
