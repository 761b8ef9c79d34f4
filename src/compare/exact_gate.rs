//! The exact gate: both builds prepare every configuration; gives the cells that both have, their exact figures and their checks.

use sha2::{Digest, Sha256};

use super::protocol::{GateConfiguration, Greeting, Reply, WorkerRequest};
use super::worker_process::{ReplyWait, WorkerFault, WorkerProcess, WorkerStart};
use fathom_base::input;
use fathom_record::comparison::{
    CellId, CheckFigure, Compared, ConfigurationFigures, ExactFigures, Fault, Gate, Side,
};

/// A side with its worker, which is started again after it died.
pub struct ExactGateSide<'a> {
    start: WorkerStart,
    waiting: ReplyWait<'a>,
    worker: Option<WorkerProcess>,
}

impl<'a> ExactGateSide<'a> {
    /// Starts the worker; what it says of itself comes with [`Self::greet`].
    pub fn new(start: WorkerStart, waiting: ReplyWait<'a>) -> Result<Self, WorkerFault> {
        let worker = Some(WorkerProcess::start(&start)?);
        Ok(Self { start, waiting, worker })
    }

    /// The answer to the greeting of a worker that was just started.
    pub fn greet(&mut self) -> Result<Greeting, WorkerFault> {
        let waiting = self.waiting;
        self.worker()?.greet(&waiting)
    }

    /// SHA-256 of the side's program; of a command, of its text and of the files that its worker runs.
    pub fn digest(&self) -> std::io::Result<String> {
        let Some(text) = &self.start.command else {
            return input::open(&self.start.program).and_then(input::sha256);
        };
        let mut sum = Sha256::new_with_prefix(text);
        for file in self.worker.iter().flat_map(WorkerProcess::files) {
            sum.update(input::open(&file).and_then(input::sha256)?);
        }
        Ok(hex::encode(sum.finalize()))
    }

    /// The worker, a fresh one if the last has died.
    fn worker(&mut self) -> Result<&mut WorkerProcess, WorkerFault> {
        let worker = match self.worker.take() {
            Some(worker) => worker,
            None => WorkerProcess::open(&self.start, &self.waiting)?.0,
        };
        Ok(self.worker.insert(worker))
    }

    fn send(&mut self, request: &WorkerRequest) -> Result<(), WorkerFault> {
        let sent = self.worker()?.send(request);
        self.drop_on_fault(sent)
    }

    fn receive(&mut self) -> Result<Reply, WorkerFault> {
        let waiting = self.waiting;
        let reply = self.worker()?.receive(&waiting);
        self.drop_on_fault(reply)
    }

    fn drop_on_fault<T>(&mut self, result: Result<T, WorkerFault>) -> Result<T, WorkerFault> {
        if result.as_ref().is_err_and(|error| !error.is_alive()) {
            self.worker = None;
        }
        result
    }
}

/// Prepares a configuration on both sides at once. Gives the stages that both have, and a fault for each that one lacks.
pub fn prepare(
    builds: &mut [ExactGateSide<'_>; 2],
    configuration: &GateConfiguration,
) -> (GateConfiguration, Vec<Compared>) {
    let request = WorkerRequest::Prepare { configuration: configuration.clone() };
    let (stages, faults) = present(configuration, both(builds, &request));
    (GateConfiguration { stages, ..configuration.clone() }, faults)
}

/// The exact figures of a configuration that both sides have prepared.
pub fn exact(
    builds: &mut [ExactGateSide<'_>; 2],
    configuration: &GateConfiguration,
) -> Vec<Compared> {
    let replies = both(builds, &WorkerRequest::Exact { config: configuration.id.clone() });
    let sides = Side::BOTH.into_iter().zip(replies);
    sides.flat_map(|(side, reply)| exact_lines(side, configuration, reply)).collect()
}

/// The checks of these stages on both sides, or why a side gave none. Each stage has its own request and so its own time: all checks
/// together may take longer than a worker is waited for.
pub fn checks(builds: &mut [ExactGateSide<'_>; 2], stages: &[String]) -> Vec<Compared> {
    let mut lines = Vec::new();
    for stage in stages {
        let request = WorkerRequest::Checks { stages: vec![stage.clone()] };
        let mut faults = Vec::new();
        for (side, reply) in Side::BOTH.into_iter().zip(both(builds, &request)) {
            match reply {
                Ok(Reply::Checks { checks }) => {
                    lines.extend(
                        checks
                            .into_iter()
                            .map(|check| Compared::Check(CheckFigure { side, check })),
                    );
                }
                other => {
                    let reason = format!("checks of {stage}: {}", reason(&other));
                    faults.push(fault(side, None, false, &reason));
                }
            }
        }
        if !faults.is_empty() {
            return faults;
        }
    }
    lines
}

/// Asks both sides at once: nothing is timed here.
pub(super) fn both(
    builds: &mut [ExactGateSide<'_>; 2],
    request: &WorkerRequest,
) -> [Result<Reply, WorkerFault>; 2] {
    let sent = builds.each_mut().map(|build| (build.send(request), build));
    sent.map(|(sent, build)| sent.and_then(|()| build.receive()))
}

/// The stages that both sides have, and faults for the others.
///
/// A stage that only the base does not know is new in the head. Any other stage that a side lacks is a failure.
fn present(
    configuration: &GateConfiguration,
    replies: [Result<Reply, WorkerFault>; 2],
) -> (Vec<String>, Vec<Compared>) {
    let mut stages = Vec::new();
    let mut faults = Vec::new();
    for stage in &configuration.stages {
        let [base, head] = replies.each_ref().map(|reply| missing_reason(reply, stage));
        let is_new = head.is_none() && base.as_ref().is_some_and(|(_, unknown)| *unknown);
        if base.is_none() && head.is_none() {
            stages.push(stage.clone());
        }
        for (side, lack) in Side::BOTH.into_iter().zip([base, head]) {
            let cell = Some(CellId::new(&configuration.id, stage));
            faults.extend(lack.map(|(reason, _)| fault(side, cell, is_new, &reason)));
        }
    }
    (stages, faults)
}

/// Why a side lacks a stage, and whether its build does not know of it: otherwise something failed.
fn missing_reason(reply: &Result<Reply, WorkerFault>, stage: &str) -> Option<(String, bool)> {
    match reply {
        Ok(Reply::Prepared { stages }) => {
            let present = stages.iter().any(|present| present.name == stage);
            (!present).then(|| ("its pipeline has no such stage".to_owned(), true))
        }
        other => Some((reason(other), other.as_ref().is_err_and(|fault| fault.is_absence()))),
    }
}

fn exact_lines(
    side: Side,
    configuration: &GateConfiguration,
    reply: Result<Reply, WorkerFault>,
) -> Vec<Compared> {
    let Ok(Reply::Exact(exact)) = reply else {
        let reason = reason(&reply);
        let each = configuration.cells();
        return each.map(|cell| fault(side, Some(cell), false, &reason)).collect();
    };
    let whole = Compared::Configuration(ConfigurationFigures {
        side,
        configuration: configuration.id.clone(),
        allocated_bytes: exact.allocated_bytes,
        errors: exact.errors,
        judged: exact.judged,
        quantities: exact.quantities,
        notes: exact.notes,
    });
    let gated = exact.stages.into_iter().filter(|stage| configuration.stages.contains(&stage.name));
    let cells = gated.map(|stage| {
        Compared::Exact(ExactFigures {
            side,
            cell: CellId::new(&configuration.id, &stage.name),
            work: stage.work,
            counters: stage.counters,
        })
    });
    std::iter::once(whole).chain(cells).collect()
}

/// Why a reply is of no use.
pub(super) fn reason(reply: &Result<Reply, WorkerFault>) -> String {
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
    use itertools::Itertools;

    use super::*;
    use crate::protocol::StageKind;
    use fathom_record::PassKind;

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
    fn describe(
        base: Result<Reply, WorkerFault>,
        head: Result<Reply, WorkerFault>,
    ) -> (String, String) {
        let stages = ["a", "b"].map(str::to_owned).to_vec();
        let configuration =
            GateConfiguration { id: "one".to_owned(), stages, ..Default::default() };
        let (stages, lines) = present(&configuration, [base, head]);
        let word = |line: &Compared| match line {
            Compared::Fault(fault) => {
                let (side, cell) = (fault.side.unwrap(), fault.cell.as_ref().unwrap());
                let word = if fault.absent { "new" } else { "failed" };
                format!("{side} {} {word}", cell.stage())
            }
            other => panic!("{other:?}"),
        };
        (stages.join(" "), lines.iter().map(word).join(", "))
    }

    #[test]
    fn only_what_the_base_alone_does_not_know_is_new() {
        let (whole, b) = (|| prepared(&["a", "b"]), || prepared(&["b"]));
        for (base, head, common, faults) in [
            (whole(), whole(), "a b", ""),
            (refused(true), whole(), "", "base a new, base b new"),
            (refused(false), whole(), "", "base a failed, base b failed"),
            (died(), whole(), "", "base a failed, base b failed"),
            (b(), whole(), "b", "base a new"),
            (whole(), refused(true), "", "head a failed, head b failed"),
            (refused(true), b(), "", "base a failed, head a failed, base b new"),
            (
                refused(true),
                died(),
                "",
                "base a failed, head a failed, base b failed, head b failed",
            ),
        ] {
            let case = format!("{base:?}, {head:?}");
            assert_eq!(describe(base, head), (common.to_owned(), faults.to_owned()), "{case}");
        }
    }
}
