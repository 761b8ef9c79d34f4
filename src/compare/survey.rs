//! Both builds prepare every configuration: which cells they have in common, and their exact figures.

use super::cells::{CellId, Configuration};
use super::launch::{Start, Worker, WorkerFault};
use super::protocol::{Exact, Greeting, Reply, Request};
use super::store::{CheckFigure, ConfigurationFigures, ExactFigures, Fault, Gate, Line, Side};

/// One side: how to start its worker, and the worker while it lives.
pub struct Party {
    pub side: Side,
    start: Start,
    worker: Option<Worker>,
}

impl Party {
    /// Starts the worker of a side; what it says of itself comes with [`Self::greeted`].
    pub fn new(side: Side, start: Start) -> Result<Self, WorkerFault> {
        let mut party = Self {
            side,
            start,
            worker: None,
        };
        party.worker = Some(party.started()?);
        Ok(party)
    }

    fn started(&self) -> Result<Worker, WorkerFault> {
        let mut worker = Worker::start(&self.start)?;
        worker.greet()?;
        Ok(worker)
    }

    pub fn greeted(&mut self) -> Result<Greeting, WorkerFault> {
        match &mut self.worker {
            Some(worker) => worker.greeted(),
            None => Err(gone()),
        }
    }

    /// The worker, a fresh one if the last has died.
    fn send(&mut self, request: &Request) -> Result<(), WorkerFault> {
        if self.worker.is_none() {
            let mut worker = self.started()?;
            worker.greeted()?;
            self.worker = Some(worker);
        }
        let sent = self.worker.as_mut().ok_or_else(gone)?.send(request);
        self.kept(sent)
    }

    fn receive(&mut self) -> Result<Reply, WorkerFault> {
        let reply = self.worker.as_mut().ok_or_else(gone)?.receive();
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
    WorkerFault::Refused {
        reason: "its worker is gone".to_owned(),
        fatal: true,
    }
}

/// Prepares a configuration on both sides at once. Gives what of it both have, and the faults of what one lacks.
pub fn prepare(
    parties: &mut [Party; 2],
    configuration: &Configuration,
) -> (Configuration, Vec<Line>) {
    let replies = both(
        parties,
        &Request::Prepare {
            configuration: configuration.into(),
        },
    );
    let (stages, faults) = present(configuration, replies);
    let common = Configuration {
        stages,
        ..configuration.clone()
    };
    (common, faults)
}

/// The exact figures of a configuration that both sides have prepared.
pub fn exact(parties: &mut [Party; 2], configuration: &Configuration) -> Vec<Line> {
    let replies = both(
        parties,
        &Request::Exact {
            config: configuration.id.clone(),
        },
    );
    let sides = Side::BOTH.into_iter().zip(replies);
    sides
        .flat_map(|(side, reply)| exact_lines(side, configuration, reply))
        .collect()
}

/// Every check of both sides.
pub fn checks(parties: &mut [Party; 2]) -> Vec<Line> {
    let replies = both(parties, &Request::Checks);
    let mut lines = Vec::new();
    for (side, reply) in Side::BOTH.into_iter().zip(replies) {
        match reply {
            Ok(Reply::Checks { checks }) => lines.extend(checks.into_iter().map(|check| {
                Line::Check(CheckFigure {
                    side,
                    stage: check.stage,
                    what: check.what,
                    unit: check.unit,
                    measured: check.measured,
                    tolerance: check.tolerance,
                    sound: check.sound,
                })
            })),
            other => lines.push(fault(
                side,
                None,
                false,
                &format!("checks: {}", reason(other)),
            )),
        }
    }
    lines
}

/// Asks both sides at once: nothing is timed here.
fn both(parties: &mut [Party; 2], request: &Request) -> [Result<Reply, WorkerFault>; 2] {
    let [base, head] = parties;
    let sent = [base.send(request), head.send(request)];
    let [of_base, of_head] = sent;
    [
        of_base.and_then(|()| base.receive()),
        of_head.and_then(|()| head.receive()),
    ]
}

/// The stages that both sides have, and faults for the others.
fn present(
    configuration: &Configuration,
    replies: [Result<Reply, WorkerFault>; 2],
) -> (Vec<String>, Vec<Line>) {
    let mut stages = configuration.stages.clone();
    let mut faults = Vec::new();
    for (side, reply) in Side::BOTH.into_iter().zip(replies) {
        let lacking = |stage: &String| match &reply {
            Ok(Reply::Prepared { stages: has, .. }) => {
                let there = has.iter().any(|present| present.name == *stage);
                (!there).then(|| "its pipeline has no such stage".to_owned())
            }
            Ok(other) => Some(format!("an answer of the wrong kind: {other:?}")),
            Err(error) => Some(error.to_string()),
        };
        // What a base refuses by itself is new in the head; a worker that died or hung is a failure.
        let answered = match &reply {
            Ok(Reply::Prepared { .. }) => true,
            Err(WorkerFault::Refused { fatal, .. }) => !fatal,
            _ => false,
        };
        let absent = side == Side::Base && answered;
        stages.retain(|stage| match lacking(stage) {
            None => true,
            Some(reason) => {
                let cell = CellId::new(&configuration.id, stage);
                faults.push(fault(side, Some(cell), absent, &reason));
                false
            }
        });
    }
    (stages, faults)
}

fn exact_lines(
    side: Side,
    configuration: &Configuration,
    reply: Result<Reply, WorkerFault>,
) -> Vec<Line> {
    let exact = match reply {
        Ok(Reply::Exact(exact)) => *exact,
        other => {
            let reason = reason(other);
            let each = configuration.cells();
            return each
                .map(|cell| fault(side, Some(cell), false, &reason))
                .collect();
        }
    };
    let Exact {
        stages,
        allocated_bytes,
        errors,
        quantities,
        notes,
    } = exact;
    let mut lines = vec![Line::Configuration(ConfigurationFigures {
        side,
        configuration: configuration.id.clone(),
        allocated_bytes,
        errors,
        quantities,
        notes,
    })];
    lines.extend(
        stages
            .into_iter()
            .filter(|stage| configuration.stages.contains(&stage.name))
            .map(|stage| {
                Line::Exact(ExactFigures {
                    side,
                    cell: CellId::new(&configuration.id, &stage.name),
                    work: stage.work,
                    counters: stage.counters,
                })
            }),
    );
    lines
}

fn reason(reply: Result<Reply, WorkerFault>) -> String {
    match reply {
        Ok(other) => format!("an answer of the wrong kind: {other:?}"),
        Err(error) => error.to_string(),
    }
}

fn fault(side: Side, cell: Option<CellId>, absent: bool, reason: &str) -> Line {
    Line::Fault(Fault {
        gate: Gate::Exact,
        side: Some(side),
        cell,
        launch: None,
        control: false,
        absent,
        reason: reason.to_owned(),
    })
}
