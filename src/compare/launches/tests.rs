use std::convert::Infallible;

use itertools::Itertools;

use super::*;
use crate::protocol::RequestKind;

/// Workers whose cells take 1 ms on the base and 2 ms on the head, and which fail as asked.
#[derive(Default)]
struct Simulated {
    /// Every sample, with the number of its launch.
    samples: Vec<(u32, WorkerRole, CellId)>,
    /// Of each sample.
    frames: Vec<u32>,
    /// Every time is divided by so much, if by anything.
    speed: Option<f64>,
    opened: Vec<(u32, Vec<CellId>)>,
    launch: u32,
    /// Launch, role, stage, and what the worker fails with there.
    failing: Option<(u32, WorkerRole, &'static str, WorkerFault)>,
    /// A configuration, and what the head fails with at it.
    unprepared: Option<(&'static str, WorkerFault)>,
    never_starts: bool,
    interrupt_after: Option<usize>,
    /// What interrupts kills the workers too.
    dying_of_interrupt: bool,
    closed: u32,
}

static NEVER: AtomicBool = AtomicBool::new(false);

fn refusal() -> WorkerFault {
    WorkerFault::Refused { reason: "out of order".to_owned(), fatal: false, absent: false }
}

fn ended() -> WorkerFault {
    WorkerFault::Ended { status: "signal 11".to_owned(), stderr: String::new() }
}

fn silent() -> WorkerFault {
    WorkerFault::Silent { request: RequestKind::Sample, seconds: 30, stderr: String::new() }
}

impl LaunchWorkers for Simulated {
    fn open(
        &mut self,
        launch: u32,
        cells: &[CellId],
        _: Option<&CellId>,
    ) -> Result<OpenedLaunch, RoleFault> {
        self.launch = launch;
        self.opened.push((launch, cells.to_vec()));
        let failed = |configuration: Option<&str>, fault| {
            let configuration = configuration.map(str::to_owned);
            RoleFault { role: WorkerRole::Head, configuration, fault }
        };
        if self.never_starts {
            return Err(failed(None, ended()));
        }
        let there = |(id, _): &(&str, _)| cells.iter().any(|cell| cell.configuration() == *id);
        let unprepared = self.unprepared.clone().filter(there);
        match unprepared.map(|(id, fault)| failed(Some(id), fault)) {
            Some(cause) if !cause.fault.is_alive() => Err(cause),
            refused => {
                let refused = Vec::from_iter(refused);
                Ok(OpenedLaunch { refused, ..OpenedLaunch::default() })
            }
        }
    }

    fn sample(
        &mut self,
        role: WorkerRole,
        cell: &CellId,
        frames: u32,
    ) -> Result<SideSample, WorkerFault> {
        if let Some((launch, at, stage, fault)) = &self.failing
            && (self.launch, role, cell.stage()) == (*launch, *at, *stage)
        {
            return Err(fault.clone());
        }
        self.samples.push((self.launch, role, cell.clone()));
        self.frames.push(frames);
        if self.interrupt_after == Some(self.samples.len()) {
            STOP.store(true, Ordering::Relaxed);
            if self.dying_of_interrupt {
                return Err(ended());
            }
        }
        let ns = if role == WorkerRole::Head { 2e6 } else { 1e6 };
        let ns = ns / self.speed.unwrap_or(1.0);
        let machine = (role == WorkerRole::Head).then(MachineState::default);
        Ok(SideSample { ns, machine })
    }

    fn close(&mut self) {
        self.closed += 1;
    }
}

static STOP: AtomicBool = AtomicBool::new(false);

fn schedule() -> GateSchedule {
    let cell = CellId::new;
    GateSchedule {
        cells: vec![cell("one", "a/x"), cell("one", "b/y"), cell("two", "a/x")],
        control: Some(cell("one", "b/y")),
        launches: 3,
        pairs: 4,
        seed: 7,
    }
}

#[derive(Default)]
struct WrittenLines {
    pairs: Vec<Pair>,
    faults: Vec<Fault>,
    launches: Vec<Launch>,
}

impl WrittenLines {
    fn launches(&self) -> Vec<u32> {
        self.launches.iter().map(|launch| launch.launch).collect()
    }

    fn only_fault(&self) -> &Fault {
        self.faults.iter().exactly_one().unwrap()
    }
}

fn written(
    schedule: &GateSchedule,
    workers: &mut Simulated,
    before: &EarlierLaunches,
    interrupted: &AtomicBool,
) -> WrittenLines {
    let mut written = WrittenLines::default();
    let sink = |lines: Vec<Compared>| -> Result<(), Infallible> {
        for line in lines {
            match line {
                Compared::Pair(pair) => written.pairs.push(pair),
                Compared::Fault(fault) => written.faults.push(fault),
                Compared::Launch(launch) => written.launches.push(launch),
                other => panic!("{other:?}"),
            }
        }
        Ok(())
    };
    let Ok(()) = run(schedule, workers, before, interrupted, sink);
    written
}

fn measure(workers: &mut Simulated) -> WrittenLines {
    written(&schedule(), workers, &EarlierLaunches::default(), &NEVER)
}

#[test]
fn every_cell_is_paired_in_every_round_of_every_launch() {
    let mut workers = Simulated::default();
    let found = measure(&mut workers);
    assert_eq!(found.launches(), [0, 1, 2]);
    assert!(found.faults.is_empty());
    assert_eq!(workers.closed, 3);
    let pairs = &found.pairs;
    for launch in 0..3 {
        let cells = &schedule().cells;
        for (cell, control) in cells.iter().map(|cell| (cell, false)).chain([(&cells[1], true)]) {
            let key = (launch, cell, control);
            let own = |pair: &&Pair| (pair.launch, &pair.cell, pair.control) == key;
            let of_cell: Vec<&Pair> = pairs.iter().filter(own).collect();
            let rounds: Vec<u32> = of_cell.iter().map(|pair| pair.round).collect();
            assert_eq!(rounds, [0, 1, 2, 3]);
            let first = of_cell.iter().filter(|pair| pair.first == Side::Base);
            assert_eq!(first.count(), 2, "each side comes first in half of the rounds");
            let head_ns = if control { 1e6 } else { 2e6 };
            assert!(of_cell.iter().all(|pair| (pair.base_ns, pair.head_ns) == (1e6, head_ns)));
        }
    }
}

#[test]
fn the_two_samples_of_a_pair_are_neighbours_and_orders_differ() {
    let mut workers = Simulated::default();
    let found = measure(&mut workers);
    for pair in &found.pairs {
        let key = (pair.launch, pair.control, &pair.cell);
        let own = workers
            .samples
            .iter()
            .filter(|sample| (sample.0, sample.1.is_control(), &sample.2) == key);
        // The round before the first is not kept.
        let first = own.map(|sample| sample.1).nth(2 + 2 * pair.round as usize).unwrap();
        let is_base = matches!(first, WorkerRole::Base | WorkerRole::ControlBase);
        assert_eq!(pair.first, if is_base { Side::Base } else { Side::Head });
    }
    // The unkept round's first sample of each launch.
    let settling = workers.samples.chunks(5 * 8).map(|launch| launch[0].1);
    let is_base = |role| matches!(role, WorkerRole::Base | WorkerRole::ControlBase);
    assert_eq!(settling.map(is_base).collect::<Vec<_>>(), [true, false, true]);
    let mut orders = BTreeSet::new();
    // Four visits a round, two samples a visit; the control's sides are workers of their own.
    for round in workers.samples.chunks(8) {
        for pair in round.chunks(2) {
            assert_eq!(pair[0].2, pair[1].2);
            assert!(pair[0].1 != pair[1].1);
            assert_eq!(pair[0].1.is_control(), pair[1].1.is_control());
        }
        let order = round.chunks(2).map(|pair| pair[0].2.clone());
        orders.insert(order.collect::<Vec<_>>());
    }
    assert_eq!(workers.samples.len(), 3 * 5 * 8, "three launches, four rounds and one unkept");
    assert!(orders.len() > 5, "{}", orders.len());
}

#[test]
fn both_sides_settle_by_one_frame_and_then_take_equally_many() {
    let mut workers = Simulated { speed: Some(20.0), ..Simulated::default() };
    measure(&mut workers);
    for launch in workers.frames.chunks(5 * 8) {
        assert!(launch[..8] == [1; 8] && launch[8..] == [6; 32], "{launch:?}");
    }
}

#[test]
fn the_seed_decides_the_schedule_of_each_launch_for_itself() {
    let mut whole = Simulated::default();
    measure(&mut whole);
    let before = EarlierLaunches { complete: 2, last: Some(1), ..EarlierLaunches::default() };
    let mut resumed = Simulated::default();
    let found = written(&schedule(), &mut resumed, &before, &NEVER);
    assert_eq!(found.launches(), [2]);
    let last = whole.samples.into_iter().filter(|sample| sample.0 == 2);
    assert_eq!(resumed.samples, last.collect::<Vec<_>>());
}

#[test]
fn a_refused_sample_costs_its_cell_and_nothing_else() {
    let failing = Some((1, WorkerRole::Head, "b/y", refusal()));
    let mut workers = Simulated { failing, ..Simulated::default() };
    let found = measure(&mut workers);
    assert_eq!(found.launches(), [0, 1, 2]);
    let fault = found.only_fault();
    assert_eq!(fault.cell, Some(CellId::new("one", "b/y")));
    assert_eq!((fault.side, fault.launch), (Some(Side::Head), Some(1)));
    assert_eq!(fault.reason, "head worker: out of order");
    let of_lost = found.pairs.iter().filter(|pair| pair.cell.stage() == "b/y" && !pair.control);
    assert!(of_lost.clone().all(|pair| pair.launch == 0), "launch 1 has no whole set of it");
    assert_eq!(of_lost.count(), 4);
    assert_eq!(workers.opened[2].1.len(), 2, "it is not tried again");
}

#[test]
fn a_dead_or_hung_worker_costs_the_launch_and_the_cell_that_it_was_at() {
    for (fault, reason) in [
        (ended(), "base worker: it ended with signal 11"),
        (silent(), "base worker: it gave no answer to `sample` within 30 s"),
    ] {
        let failing = Some((1, WorkerRole::Base, "a/x", fault));
        let mut workers = Simulated { failing, ..Simulated::default() };
        let found = measure(&mut workers);
        assert_eq!(found.launches(), [0, 2, 3], "launch 1 does not count and another is run");
        assert!(found.pairs.iter().all(|pair| pair.launch != 1));
        let fault = found.only_fault();
        assert_eq!(fault.reason, reason);
        let lost = fault.cell.clone().unwrap();
        assert_eq!(lost.stage(), "a/x");
        assert!(!workers.opened[2].1.contains(&lost));
        let last = found.pairs.iter().filter(|pair| pair.launch == 3);
        let others: BTreeSet<_> = last.map(|pair| pair.cell.clone()).collect();
        assert_eq!(others.len(), 2);
    }
}

#[test]
fn a_configuration_that_is_refused_or_kills_costs_its_cells() {
    for fault in [refusal(), ended()] {
        let mut workers = Simulated { unprepared: Some(("one", fault)), ..Simulated::default() };
        let found = measure(&mut workers);
        assert_eq!(found.launches().len(), 3);
        let faults = &found.faults;
        assert_eq!(faults.len(), 3, "two cells and the control: {faults:?}");
        assert_eq!(faults.iter().filter(|fault| fault.control).count(), 1);
        assert!(found.pairs.iter().all(|pair| pair.cell.configuration() == "two"));
        assert_eq!(found.pairs.len(), 3 * 4);
    }
}

#[test]
fn a_lost_control_leaves_the_cells() {
    let failing = Some((0, WorkerRole::ControlHead, "b/y", refusal()));
    let mut workers = Simulated { failing, ..Simulated::default() };
    let found = measure(&mut workers);
    let fault = found.only_fault();
    assert!(fault.control);
    assert_eq!(fault.reason, "control worker: out of order");
    assert!(found.pairs.iter().all(|pair| !pair.control));
    assert_eq!(found.pairs.len(), 3 * 3 * 4);
}

#[test]
fn workers_that_never_start_end_the_gate() {
    let mut workers = Simulated { never_starts: true, ..Simulated::default() };
    let found = measure(&mut workers);
    assert_eq!(found.faults.len(), 2);
    assert!(found.faults.iter().all(|fault| fault.cell.is_none()));
    assert!(found.launches().is_empty());
}

#[test]
fn an_interrupted_launch_leaves_nothing() {
    for dying_of_interrupt in [false, true] {
        STOP.store(false, Ordering::Relaxed);
        let mut workers =
            Simulated { interrupt_after: Some(60), dying_of_interrupt, ..Simulated::default() };
        let found = written(&schedule(), &mut workers, &EarlierLaunches::default(), &STOP);
        assert_eq!(found.launches(), [0]);
        assert!(found.pairs.iter().all(|pair| pair.launch == 0));
        assert!(found.faults.is_empty(), "no cell is given up");
        assert_eq!(workers.closed, 2);
    }
}
