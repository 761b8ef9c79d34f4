//! The workers of the time gate: a base, a head and, for the control, two more of one side, started afresh for each launch.
//!
//! The processes of a launch take turns, and pages of a file that several of them run stay in the caches. So each process runs a copy of
//! its own, and copies change places from launch to launch. In 14 comparisons of equal builds (`examples/own_pipeline`, a development
//! build, beside other work) the head seemed slower by 0.58 % in the mean, 11 times of 14, while three processes ran the base's file and
//! the base settled first and by fewer frames; since then by 0.14 %, 9 times of 14.

use std::collections::BTreeMap;

use itertools::Itertools;
use rand::RngExt;
use tempfile::TempDir;

use super::build;
use super::launches::{LaunchWorkers, OpenedLaunch, RoleFault, SideSample, WorkerRole, random};
use super::protocol::{GateConfiguration, Greeting, Reply, WorkerRequest, with_driver};
use super::worker_process::{
    Quiet, ReplyWait, WorkerFault, WorkerProcess, WorkerStart, allowed_cores,
};
use fathom_base::quiet::PADDING_BYTES;
use fathom_gpu::ClockPlan;
use fathom_record::Adapter;
use fathom_record::comparison::{CellId, Side};

/// Most processes of one side in a launch.
const COPIES: usize = 3;

/// What the first worker of a side reports.
#[derive(Clone, Debug)]
pub struct ProbedSide {
    pub adapter: Adapter,
    /// Of a hardware adapter.
    clock: Option<ClockPlan>,
}

/// LaunchProcesses that serve as [`LaunchWorkers`].
pub struct LaunchProcesses<'a> {
    /// Copies of each side, in the order of [`Side::BOTH`].
    builds: [[WorkerStart; COPIES]; 2],
    /// Holds their programs.
    _folder: TempDir,
    pub sides: [ProbedSide; 2],
    waiting: ReplyWait<'a>,
    configurations: BTreeMap<String, GateConfiguration>,
    cores: Vec<usize>,
    seed: u64,
    workers: Vec<(WorkerRole, WorkerProcess)>,
    /// Number of the launch that is run.
    launch: u32,
}

impl<'a> LaunchProcesses<'a> {
    /// Asks a first base worker for the adapter, and for its clock where it is hardware: both sides then read the same
    /// clock, and each launch is spared the audit. A head with an environment of its own is asked too.
    pub fn new(
        builds: [WorkerStart; 2],
        configurations: &[GateConfiguration],
        seed: u64,
        waiting: ReplyWait<'a>,
    ) -> Result<Self, RoleFault> {
        let [base, head] = &builds;
        let of_base = probe(base, &waiting).map_err(role_fault(WorkerRole::Base))?;
        let of_head = if head.environment == base.environment {
            of_base.clone()
        } else {
            probe(head, &waiting).map_err(role_fault(WorkerRole::Head))?
        };
        let named = configurations.iter().map(|own| (own.id.clone(), own.clone()));
        let (folder, builds) = copies(&builds).map_err(|error| {
            role_fault(WorkerRole::Base)(WorkerFault::fatal(format!("{error:#}")))
        })?;
        Ok(Self {
            sides: with_equal_clocks([of_base, of_head]),
            builds,
            _folder: folder,
            waiting,
            configurations: named.collect(),
            cores: allowed_cores(),
            seed,
            workers: Vec::new(),
            launch: 0,
        })
    }

    fn start(&mut self, roles: &[WorkerRole]) -> Result<(), RoleFault> {
        let launch = self.launch;
        let padding = random(self.seed, launch).random_range(0..PADDING_BYTES);
        for (place, role) in roles.iter().enumerate() {
            let of_side = role.side(launch) as usize;
            let side = &self.sides[of_side];
            let start = WorkerStart {
                name: role.to_string(),
                clock: side.clock,
                quiet: side.adapter.software.then(|| Quiet {
                    core: core(&self.cores, launch as usize + place),
                    padding,
                    keep_memory: true,
                }),
                ..self.builds[of_side][copy(launch, *role)].clone()
            };
            self.workers.push((*role, WorkerProcess::start(&start).map_err(role_fault(*role))?));
        }
        Ok(())
    }

    fn greet(&mut self) -> Result<Vec<Greeting>, RoleFault> {
        let mut greetings = Vec::new();
        for (role, worker) in &mut self.workers {
            let greeting = worker.greet(&self.waiting).map_err(role_fault(*role))?;
            let side = role.side(self.launch);
            let known = &self.sides[side as usize].adapter;
            let (own, known) = (with_driver(&greeting.adapter), with_driver(known));
            if own != known {
                let reason = format!("it runs on {own}, the first {side} on {known}");
                return Err(role_fault(*role)(WorkerFault::fatal(reason)));
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
        let failed = |role, fault| {
            let configuration = Some(configuration.id.clone());
            RoleFault { role, configuration, fault }
        };
        let workers = self.workers.iter_mut();
        let mut concerned = workers.filter(|(role, _)| control || !role.is_control()).collect_vec();
        for (role, worker) in &mut concerned {
            worker.send(&request).map_err(|fault| failed(*role, fault))?;
        }
        let mut refused = None;
        for (role, worker) in concerned {
            let fault = match worker.receive(&self.waiting) {
                Ok(Reply::Prepared { .. }) => continue,
                Ok(other) => worker.unexpected(&other),
                Err(fault) => fault,
            };
            if !fault.is_alive() {
                return Err(failed(*role, fault));
            }
            refused = refused.or(Some(failed(*role, fault)));
        }
        Ok(refused)
    }

    /// The only core that a launch is measured on, where workers can be kept on one.
    fn core(&self, launch: u32) -> Option<usize> {
        let software = self.sides.iter().all(|side| side.adapter.software);
        core(&self.cores, launch as usize).filter(|_| software)
    }

    /// Conditions of a quiet measurement that this launch could not have.
    fn notes(&self, greetings: &[Greeting]) -> Vec<String> {
        let software = greetings.iter().filter(|greeting| greeting.adapter.software).collect_vec();
        let randomized = software.iter().any(|greeting| greeting.randomized != Some(false));
        let unpinned = !software.is_empty() && self.cores.is_empty();
        let notes = [
            (randomized, "addresses are randomized: the system does not allow otherwise"),
            (unpinned, "on any core: pinning is done on Linux only"),
        ];
        notes.into_iter().filter(|(is_so, _)| *is_so).map(|(_, note)| note.to_owned()).collect()
    }
}

impl LaunchWorkers for LaunchProcesses<'_> {
    fn open(
        &mut self,
        launch: u32,
        cells: &[CellId],
        control: Option<&CellId>,
    ) -> Result<OpenedLaunch, RoleFault> {
        self.launch = launch;
        self.start(&order(launch, control.is_some()))?;
        let greetings = self.greet()?;
        let core = self.core(launch);
        let mut opened = OpenedLaunch { refused: Vec::new(), core, notes: self.notes(&greetings) };
        let wanted = cells.iter().chain(control).map(CellId::configuration).sorted().dedup();
        for id in wanted {
            let Some(configuration) = self.configurations.get(id).cloned() else {
                continue;
            };
            let of_control = control.is_some_and(|cell| cell.configuration() == id);
            opened.refused.extend(self.prepare(&configuration, of_control)?);
        }
        if let Some(core) = core {
            self.workers.iter().for_each(|(_, worker)| worker.pin(core));
        }
        Ok(opened)
    }

    fn sample(
        &mut self,
        role: WorkerRole,
        cell: &CellId,
        frames: u32,
    ) -> Result<SideSample, WorkerFault> {
        let of_role = self.workers.iter_mut().find(|(known, _)| *known == role);
        let Some((_, worker)) = of_role else {
            return Err(WorkerFault::fatal("it was not started".to_owned()));
        };
        let (ns, machine) = worker.sample(cell, frames, &self.waiting)?;
        Ok(SideSample { ns: ns.into_iter().fold(f64::INFINITY, f64::min), machine })
    }

    fn close(&mut self) {
        // Killed: a driver's orderly end takes longer and is not waited for.
        self.workers.clear();
    }
}

fn role_fault(role: WorkerRole) -> impl FnOnce(WorkerFault) -> RoleFault {
    move |fault| RoleFault { role, configuration: None, fault }
}

/// Which copy of its side's program a worker runs.
fn copy(launch: u32, role: WorkerRole) -> usize {
    let place = match role {
        WorkerRole::Base | WorkerRole::Head => 0,
        WorkerRole::ControlBase => 1,
        WorkerRole::ControlHead => 2,
    };
    (launch as usize + place) % COPIES
}

/// Copies of both sides' programs in one folder, with names of one length, which moves the stack. A command is left as it is.
fn copies(builds: &[WorkerStart; 2]) -> anyhow::Result<(TempDir, [[WorkerStart; COPIES]; 2])> {
    let folder = tempfile::Builder::new().prefix("fathom-launches-").tempdir()?;
    let mut copies = builds.each_ref().map(|start| [(); COPIES].map(|()| start.clone()));
    for number in 0..COPIES {
        for (side, copies) in Side::BOTH.into_iter().zip(&mut copies) {
            let start = &mut copies[number];
            if start.command.is_none() {
                let program = folder.path().join(format!("{side}-{number}"));
                build::store_program(&start.program, &program)?;
                start.program = program;
            }
        }
    }
    Ok((folder, copies))
}

/// The starting order, and with it the core that a worker starts on, alternates every second launch, while the core that is
/// measured on changes every launch. Of equal programs started always in the same order, the second was up to 2 % faster in
/// stages bound by memory.
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

/// The cores one after the other.
fn core(cores: &[usize], index: usize) -> Option<usize> {
    (!cores.is_empty()).then(|| cores[index % cores.len()])
}

/// Sides whose audits have chosen different clocks are both timed by the fenced host clock.
fn with_equal_clocks(mut sides: [ProbedSide; 2]) -> [ProbedSide; 2] {
    if let [Some(base), Some(head)] = sides.each_ref().map(|side| side.clock)
        && !base.has_same_clocks(&head)
    {
        for side in &mut sides {
            side.clock = side.clock.map(|plan| ClockPlan::fenced(plan.submit_cost));
        }
    }
    sides
}

fn probe(start: &WorkerStart, waiting: &ReplyWait<'_>) -> Result<ProbedSide, WorkerFault> {
    let (mut worker, Greeting { adapter, .. }) = WorkerProcess::open(start, waiting)?;
    let clock = if adapter.software {
        None
    } else {
        match worker.ask(&WorkerRequest::Clock, waiting) {
            Ok(Reply::Clock { clock }) => Some(clock),
            Ok(other) => return Err(worker.unexpected(&other)),
            // It times by a clock of its own.
            Err(WorkerFault::Unsupported(_)) => None,
            Err(fault) => return Err(fault),
        }
    };
    worker.quit();
    Ok(ProbedSide { adapter, clock })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sides_are_timed_by_clocks_that_both_have() {
        use fathom_gpu::SubmitCost;
        use fathom_record::Clock;
        let plan = |compute, compute_ns| {
            let cost = SubmitCost { compute_ns, ..SubmitCost::default() };
            Some(ClockPlan { compute, ..ClockPlan::fenced(cost) })
        };
        let timed = |plans: [Option<ClockPlan>; 2]| {
            let side = |clock| ProbedSide { adapter: Adapter::default(), clock };
            with_equal_clocks(plans.map(side)).map(|side| side.clock)
        };
        let [stamps, also] = [1.0, 2.0].map(|ns| plan(Clock::Timestamp, ns));
        let fenced = plan(Clock::FencedHost, 3.0);
        assert_eq!(timed([stamps, also]), [stamps, also]);
        assert_eq!(timed([stamps, fenced]), [plan(Clock::FencedHost, 1.0), fenced]);
        assert_eq!(timed([stamps, None]), [stamps, None]);
    }

    #[test]
    fn each_side_starts_first_on_each_core_equally_often() {
        let cores = [4, 7];
        let mut first = BTreeMap::new();
        for launch in 0..20 {
            let roles = order(launch, true);
            let controls = [WorkerRole::ControlHead, WorkerRole::ControlBase];
            assert!(controls.iter().all(|role| roles[2..].contains(role)));
            assert_eq!(order(launch, false), roles[..2]);
            let place = (roles[0], core(&cores, launch as usize));
            *first.entry(place).or_insert(0) += 1;
        }
        assert_eq!(first.into_values().collect::<Vec<_>>(), [5; 4]);
    }

    #[test]
    fn each_process_runs_a_copy_of_its_own_and_each_copy_in_turn() {
        let folder = tempfile::tempdir().unwrap();
        let starts = ["one", "other"].map(|text| {
            let program = folder.path().join(text);
            std::fs::write(&program, text).unwrap();
            WorkerStart::new(&program)
        });
        let (kept, copies) = copies(&starts).unwrap();
        let texts = copies.each_ref().map(|side| {
            side.each_ref().map(|start| std::fs::read_to_string(&start.program).unwrap())
        });
        assert_eq!(texts, [["one"; COPIES], ["other"; COPIES]].map(|side| side.map(str::to_owned)));
        let mut runs = BTreeMap::new();
        for launch in 0..12 {
            let place = |role: WorkerRole| (role.side(launch), copy(launch, role));
            let places = order(launch, true).into_iter().map(|role| (place(role), role));
            let apart: std::collections::BTreeSet<_> = places.clone().map(|run| run.0).collect();
            assert_eq!(apart.len(), 4);
            places.for_each(|run| *runs.entry(run).or_insert(0) += 1);
        }
        // Six of the workers' processes, and twice as many of the controls', of which each launch has one side's.
        assert_eq!(runs.into_values().counts(), [(4, 6), (2, 12)].into());
        let command = [(); 2].map(|()| WorkerStart::from_command("true"));
        assert_eq!(super::copies(&command).unwrap().1[0][1].program, command[0].program);
        let path = kept.path().to_owned();
        drop(kept);
        assert!(!path.exists());
    }
}
