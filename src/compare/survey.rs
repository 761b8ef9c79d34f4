//! Both builds prepare every configuration: which cells they have in common, and their exact figures.

use super::launch::{Waiting, WorkerFault, WorkerProcess, WorkerStart};
use super::protocol::GateConfiguration;
use super::protocol::{Exact, Greeting, Reply, WorkerRequest};
use crate::record::comparison::{
    CellId, CheckFigure, Compared, ConfigurationFigures, ExactFigures, Fault, Gate, Side,
};

/// One side: how to start its worker, and the worker while it lives.
pub struct SurveyedBuild<'a> {
    pub side: Side,
    start: WorkerStart,
    waiting: Waiting<'a>,
    worker: Option<WorkerProcess>,
}

impl<'a> SurveyedBuild<'a> {
    /// Starts the worker of a side; what it says of itself comes with [`Self::greeted`].
    pub fn new(side: Side, start: WorkerStart, waiting: Waiting<'a>) -> Result<Self, WorkerFault> {
        let mut party = Self { side, start, waiting, worker: None };
        party.worker = Some(party.started()?);
        Ok(party)
    }

    fn started(&self) -> Result<WorkerProcess, WorkerFault> {
        let mut worker = WorkerProcess::start(&self.start)?;
        worker.greet()?;
        Ok(worker)
    }

    pub fn greeted(&mut self) -> Result<Greeting, WorkerFault> {
        self.worker.as_mut().ok_or_else(gone)?.greeted(&self.waiting)
    }

    /// The worker, a fresh one if the last has died.
    fn send(&mut self, request: &WorkerRequest) -> Result<(), WorkerFault> {
        if self.worker.is_none() {
            let mut worker = self.started()?;
            worker.greeted(&self.waiting)?;
            self.worker = Some(worker);
        }
        let sent = self.worker.as_mut().ok_or_else(gone)?.send(request);
        self.kept(sent)
    }

    fn receive(&mut self) -> Result<Reply, WorkerFault> {
        let worker = self.worker.as_mut().ok_or_else(gone)?;
        let reply = worker.receive(&self.waiting);
        self.kept(reply)
    }

    fn kept<T>(&mut self, result: Result<T, WorkerFault>) -> Result<T, WorkerFault> {
        if result.as_ref().is_err_and(|error| !error.goes_on()) {
            self.worker = None;
        }
        result
    }
}

fn gone() -> WorkerFault {
    WorkerFault::fatal("its worker is gone".to_owned())
}

/// Prepares a configuration on both sides at once. Gives what of it both have, and the faults of what one lacks.
pub fn prepare(
    parties: &mut [SurveyedBuild<'_>; 2],
    configuration: &GateConfiguration,
) -> (GateConfiguration, Vec<Compared>) {
    let replies = both(parties, &WorkerRequest::Prepare { configuration: configuration.clone() });
    let (stages, faults) = present(configuration, replies);
    let common = GateConfiguration { stages, ..configuration.clone() };
    (common, faults)
}

/// The exact figures of a configuration that both sides have prepared.
pub fn exact(
    parties: &mut [SurveyedBuild<'_>; 2],
    configuration: &GateConfiguration,
) -> Vec<Compared> {
    let replies = both(parties, &WorkerRequest::Exact { config: configuration.id.clone() });
    let sides = Side::BOTH.into_iter().zip(replies);
    sides.flat_map(|(side, reply)| exact_lines(side, configuration, reply)).collect()
}

/// The checks of these stages on both sides.
pub fn checks(parties: &mut [SurveyedBuild<'_>; 2], stages: Vec<String>) -> Vec<Compared> {
    let replies = both(parties, &WorkerRequest::Checks { stages });
    let mut lines = Vec::new();
    for (side, reply) in Side::BOTH.into_iter().zip(replies) {
        match reply {
            Ok(Reply::Checks { checks }) => lines.extend(checks.into_iter().map(|check| {
                Compared::Check(CheckFigure {
                    side,
                    stage: check.stage,
                    what: check.what,
                    unit: check.unit,
                    measured: check.measured,
                    tolerance: check.tolerance,
                    sound: check.sound,
                })
            })),
            other => lines.push(fault(side, None, false, &format!("checks: {}", reason(other)))),
        }
    }
    lines
}

/// Asks both sides at once: nothing is timed here.
fn both(
    parties: &mut [SurveyedBuild<'_>; 2],
    request: &WorkerRequest,
) -> [Result<Reply, WorkerFault>; 2] {
    let [base, head] = parties;
    let sent = [base.send(request), head.send(request)];
    let [of_base, of_head] = sent;
    [of_base.and_then(|()| base.receive()), of_head.and_then(|()| head.receive())]
}

/// Why a side lacks a stage.
struct Lack {
    reason: String,
    /// Its build does not know of it; otherwise something failed.
    unknown: bool,
}

/// The stages that both sides have, and faults for the others.
///
/// What only the base does not know is new in the head. All else that a side lacks is a failure.
fn present(
    configuration: &GateConfiguration,
    replies: [Result<Reply, WorkerFault>; 2],
) -> (Vec<String>, Vec<Compared>) {
    let mut stages = Vec::new();
    let mut faults = Vec::new();
    for stage in &configuration.stages {
        let [base, head] = replies.each_ref().map(|reply| lack(reply, stage));
        let is_new = head.is_none() && base.as_ref().is_some_and(|lack| lack.unknown);
        if base.is_none() && head.is_none() {
            stages.push(stage.clone());
        }
        for (side, lack) in Side::BOTH.into_iter().zip([base, head]) {
            let cell = Some(CellId::new(&configuration.id, stage));
            faults.extend(lack.map(|lack| fault(side, cell, is_new, &lack.reason)));
        }
    }
    (stages, faults)
}

fn lack(reply: &Result<Reply, WorkerFault>, stage: &str) -> Option<Lack> {
    let (reason, unknown) = match reply {
        Ok(Reply::Prepared { stages, .. }) => {
            if stages.iter().any(|present| present.name == stage) {
                return None;
            }
            ("its pipeline has no such stage".to_owned(), true)
        }
        Ok(other) => (format!("an answer of the wrong kind: {other:?}"), false),
        Err(error) => (error.to_string(), error.is_absence()),
    };
    Some(Lack { reason, unknown })
}

fn exact_lines(
    side: Side,
    configuration: &GateConfiguration,
    reply: Result<Reply, WorkerFault>,
) -> Vec<Compared> {
    let exact = match reply {
        Ok(Reply::Exact(exact)) => *exact,
        other => {
            let reason = reason(other);
            let each = configuration.cells();
            return each.map(|cell| fault(side, Some(cell), false, &reason)).collect();
        }
    };
    let Exact { stages, allocated_bytes, errors, judged, quantities, notes } = exact;
    let mut lines = vec![Compared::Configuration(ConfigurationFigures {
        side,
        configuration: configuration.id.clone(),
        allocated_bytes,
        errors,
        judged,
        quantities,
        notes,
    })];
    lines.extend(
        stages.into_iter().filter(|stage| configuration.stages.contains(&stage.name)).map(
            |stage| {
                Compared::Exact(ExactFigures {
                    side,
                    cell: CellId::new(&configuration.id, &stage.name),
                    work: stage.work,
                    counters: stage.counters,
                })
            },
        ),
    );
    lines
}

fn reason(reply: Result<Reply, WorkerFault>) -> String {
    match reply {
        Ok(other) => format!("an answer of the wrong kind: {other:?}"),
        Err(error) => error.to_string(),
    }
}

fn fault(side: Side, cell: Option<CellId>, absent: bool, reason: &str) -> Compared {
    Compared::Fault(Fault { absent, ..Fault::new(Gate::Exact, Some(side), cell, reason) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compare::protocol::StageKind;
    use crate::record::PassKind;

    fn prepared(stages: &[&str]) -> Result<Reply, WorkerFault> {
        let kind = |name: &&str| StageKind { name: (*name).to_owned(), kind: PassKind::Compute };
        Ok(Reply::Prepared { stages: stages.iter().map(kind).collect() })
    }

    fn refused(absent: bool) -> Result<Reply, WorkerFault> {
        Err(WorkerFault::Refused { reason: "no".to_owned(), fatal: false, absent })
    }

    fn died() -> Result<Reply, WorkerFault> {
        Err(WorkerFault::Ended { status: "signal: 11".to_owned(), stderr: String::new() })
    }

    /// The common stages of a configuration of `a` and `b`, and who lacks which as what: `new` or `failed`.
    fn told(
        base: Result<Reply, WorkerFault>,
        head: Result<Reply, WorkerFault>,
    ) -> (Vec<String>, Vec<String>) {
        let stages = ["a", "b"].map(str::to_owned).to_vec();
        let configuration =
            GateConfiguration { id: "one".to_owned(), stages, ..Default::default() };
        let (stages, lines) = present(&configuration, [base, head]);
        let word = |line: &Compared| match line {
            Compared::Fault(fault) => {
                let (side, cell) = (fault.side.unwrap().name(), fault.cell.as_ref().unwrap());
                let word = if fault.absent { "new" } else { "failed" };
                format!("{side} {} {word}", cell.stage())
            }
            other => panic!("{other:?}"),
        };
        (stages, lines.iter().map(word).collect())
    }

    #[test]
    fn only_what_the_base_does_not_know_is_new() {
        let whole = || prepared(&["a", "b"]);
        assert_eq!(told(refused(true), whole()).1, ["base a new", "base b new"]);
        let (common, faults) = told(refused(false), whole());
        assert_eq!(faults, ["base a failed", "base b failed"]);
        assert!(common.is_empty());
        assert_eq!(told(died(), whole()).1, ["base a failed", "base b failed"]);
        let (common, faults) = told(prepared(&["b"]), whole());
        assert_eq!((common, faults), (vec!["b".to_owned()], vec!["base a new".to_owned()]));
        assert_eq!(told(whole(), refused(true)).1, ["head a failed", "head b failed"]);
    }

    #[test]
    fn a_head_that_fails_is_told_where_the_base_knows_nothing() {
        let expected = ["base a failed", "head a failed", "base b failed", "head b failed"];
        assert_eq!(told(refused(true), died()).1, expected);
        let (_, faults) = told(refused(true), prepared(&["b"]));
        assert_eq!(faults, ["base a failed", "head a failed", "base b new"]);
    }
}
