//! Both builds prepare every configuration: which cells they have in common, and their exact figures.

use super::cells::{CellId, Configuration};
use super::launch::{Worker, WorkerFault};
use super::protocol::{Exact, Reply, Request};
use super::store::{
    CheckFigure, ConfigurationFigures, ExactFigures, Fault, Gate, Line, Side, StoreError,
};

/// One side's worker, and what it can prepare.
pub struct Surveyed {
    pub side: Side,
    pub worker: Option<Worker>,
}

/// Prepares every configuration on both sides at once and asks for exact figures where `counting`. Gives the lines,
/// and the cells that both sides have.
pub fn survey(
    sides: &mut [Surveyed; 2],
    configurations: &[Configuration],
    counting: bool,
    mut write: impl FnMut(Vec<Line>) -> Result<(), StoreError>,
) -> Result<Vec<Configuration>, StoreError> {
    let mut comparable = Vec::new();
    for configuration in configurations {
        let replies = both(
            sides,
            &Request::Prepare {
                configuration: configuration.into(),
            },
        );
        let (stages, faults) = present(configuration, replies);
        write(faults)?;
        if stages.is_empty() {
            continue;
        }
        let left = Configuration {
            stages,
            ..configuration.clone()
        };
        if counting {
            let replies = both(
                sides,
                &Request::Exact {
                    config: configuration.id.clone(),
                },
            );
            let lines = Side::BOTH.into_iter().zip(replies);
            for (side, reply) in lines {
                write(exact_lines(side, &left, reply))?;
            }
        }
        comparable.push(left);
    }
    Ok(comparable)
}

/// Every check of both sides.
pub fn checks(sides: &mut [Surveyed; 2]) -> Vec<Line> {
    let replies = both(sides, &Request::Checks);
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
fn both(sides: &mut [Surveyed; 2], request: &Request) -> [Result<Reply, WorkerFault>; 2] {
    let sent: Vec<Result<(), WorkerFault>> = sides
        .iter_mut()
        .map(|side| match &mut side.worker {
            Some(worker) => worker.send(request),
            None => Err(WorkerFault::Refused {
                reason: "its worker is gone".to_owned(),
                fatal: true,
            }),
        })
        .collect();
    let mut sent = sent.into_iter();
    let mut reply = |side: &mut Surveyed| {
        let reply = match (sent.next(), &mut side.worker) {
            (Some(Ok(())), Some(worker)) => worker.receive(),
            (Some(Err(error)), _) => Err(error),
            _ => unreachable!("one sending for each side, and none without a worker succeeds"),
        };
        if reply.as_ref().is_err_and(|error| !error.goes_on()) {
            side.worker = None;
        }
        reply
    };
    let [base, head] = sides;
    [reply(base), reply(head)]
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
