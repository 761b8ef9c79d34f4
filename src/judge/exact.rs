//! The exact gate: what is counted and not timed. Declared work, shader invocations, allocated bytes and errors
//! against references are equal on both sides, or the change did something.

use std::collections::{BTreeMap, BTreeSet};

use super::adapters::AdapterRelation;
use super::store::{Comparison, pair_sides};
use fathom_record::ErrorFigure;
use fathom_record::comparison::{CellId, ConfigurationFigures, ExactFigures, Fault, Gate, Side};
use fathom_record::protocol::CheckReading;

/// Share of the base's error by which an error must grow to count: floating-point sums in another order move
/// errors by far less, a lower-quality setting by more.
pub const ERROR_GROWTH: f64 = 0.01;
/// Growth of an error, in its own unit (metres, shares), that is none however small the base's error is.
pub const MIN_ERROR: f64 = 1e-6;
/// The same for a check, as a share of the check's tolerance.
pub const MIN_OF_TOLERANCE: f64 = 0.01;

/// What a difference concerns.
#[derive(Clone, Debug, PartialEq)]
pub enum DifferenceScope {
    Cell(CellId),
    /// A stage in every configuration.
    Stage(String),
    Configuration(String),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FigureKind {
    Work,
    Counter,
    Bytes,
    Error,
    /// Read back, and neither good nor bad.
    Quantity,
}

/// A figure that is not the same on both sides.
#[derive(Clone, Debug, PartialEq)]
pub struct Difference {
    pub scope: DifferenceScope,
    pub kind: FigureKind,
    pub figure: String,
    pub base: f64,
    pub head: f64,
    /// A regression: more work, more bytes, a larger error.
    pub worse: bool,
}

impl Difference {
    /// It is charged to this cell.
    pub fn concerns(&self, cell: &CellId) -> bool {
        match &self.scope {
            DifferenceScope::Cell(own) => own == cell,
            DifferenceScope::Stage(stage) => stage == cell.stage(),
            DifferenceScope::Configuration(_) => false,
        }
    }
}

/// Every figure that differs between the sides, in the order of the lines.
pub fn judge(comparison: &Comparison) -> Vec<Difference> {
    let counting = Side::BOTH.map(|side| counting(comparison, side));
    let mut findings = Vec::new();
    for (base, head) in pair_sides(comparison.exact.iter(), |line| (line.side, &line.cell)) {
        let counted = counting.iter().all(|side| side.contains(base.cell.configuration()));
        findings.extend(cell(base, head, counted));
    }
    for (base, head) in configurations(comparison) {
        configuration(base, head, &comparison.header.cells, &mut findings);
    }
    let checks = pair_sides(comparison.checks.iter(), |line| {
        (line.side, (&line.check.stage, &line.check.what))
    });
    findings.extend(checks.into_iter().filter_map(|(base, head)| check(&base.check, &head.check)));
    if !AdapterRelation::from_header(&comparison.header).is_judged() {
        // What another driver or device invokes more often is no change of this one.
        let counters = findings.iter_mut().filter(|other| other.kind == FigureKind::Counter);
        counters.for_each(|other| other.worse = false);
    }
    findings
}

fn configurations(comparison: &Comparison) -> Vec<(&ConfigurationFigures, &ConfigurationFigures)> {
    pair_sides(comparison.configurations.iter(), |line| (line.side, &line.configuration))
}

/// Configurations in which a side counts invocations.
fn counting(comparison: &Comparison, side: Side) -> BTreeSet<&str> {
    let lines = comparison.exact.iter();
    let counted = lines.filter(|line| line.side == side && !line.counters.is_empty());
    counted.map(|line| line.cell.configuration()).collect()
}

/// Errors and checks that one side gives and the other does not. What the base lacks is new in the head, unless a damaged
/// line may have held it.
pub fn missing(comparison: &Comparison) -> Vec<Fault> {
    let mut faults = Vec::new();
    for (base, head) in configurations(comparison) {
        let given =
            |name: &String| head.errors.contains_key(name) || head.quantities.contains_key(name);
        let lacking = base.errors.keys().filter(|name| !given(name));
        faults.extend(lacking.map(|name| missing_fault(Side::Head, name, &base.configuration)));
    }
    let [base, head] = Side::BOTH.map(|side| {
        let checks = comparison.checks.iter().filter(|line| line.side == side);
        checks.map(|line| (&line.check.stage, &line.check.what)).collect::<BTreeSet<_>>()
    });
    let check = |side, (stage, what): &(&String, &String)| missing_fault(side, what, stage);
    // A side without any check has a fault that says why.
    if !base.is_empty() && !head.is_empty() {
        faults.extend(base.difference(&head).map(|name| check(Side::Head, name)));
        if !comparison.damaged.is_empty() {
            faults.extend(head.difference(&base).map(|name| check(Side::Base, name)));
        }
    }
    faults
}

fn missing_fault(side: Side, figure: &str, of: &str) -> Fault {
    let reason = format!("the {side} does not give {figure} of {of}");
    Fault::new(Gate::Exact, Some(side), None, reason)
}

/// Work, and the counters that both sides count.
fn cell(base: &ExactFigures, head: &ExactFigures, counted: bool) -> Vec<Difference> {
    let works = base.work.fields().into_iter().zip(head.work.fields());
    let works = works.map(|((name, base), (_, head))| (FigureKind::Work, name, base, head));
    let names: BTreeSet<&String> = base.counters.keys().chain(head.counters.keys()).collect();
    let counters = names.into_iter().filter(|_| counted).map(|name| {
        let count = |line: &ExactFigures| line.counters.get(name).copied().unwrap_or(0);
        (FigureKind::Counter, name.as_str(), count(base), count(head))
    });
    let differing = works.chain(counters).filter(|(.., base, head)| base != head);
    let difference = |(kind, figure, base_count, head_count): (_, &str, u64, u64)| Difference {
        scope: DifferenceScope::Cell(base.cell.clone()),
        kind,
        figure: figure.to_owned(),
        base: base_count as f64,
        head: head_count as f64,
        worse: head_count > base_count,
    };
    differing.map(difference).collect()
}

fn configuration(
    base: &ConfigurationFigures,
    head: &ConfigurationFigures,
    cells: &[CellId],
    found: &mut Vec<Difference>,
) {
    let whole = DifferenceScope::Configuration(base.configuration.clone());
    let mut differ = |scope, kind, figure: &str, base: f64, head: f64, worse| {
        found.push(Difference { scope, kind, figure: figure.to_owned(), base, head, worse });
    };
    let (b, h) = (base.allocated_bytes, head.allocated_bytes);
    if b != h {
        let (kind, name) = (FigureKind::Bytes, "allocated_bytes");
        differ(whole.clone(), kind, name, b as f64, h as f64, h > b);
    }
    let figures = base.errors.iter().chain(&base.quantities);
    let pairs = figures.filter_map(|(name, b)| {
        let h = head.errors.get(name).or(head.quantities.get(name))?;
        Some((name.as_str(), *b, *h))
    });
    let judged = |name: &str| head.judged.iter().chain(&base.judged).find(|e| e.name == name);
    let is_error = |name: &str| base.errors.contains_key(name) || head.errors.contains_key(name);
    let (errors, quantities): (Vec<_>, Vec<_>) = pairs.partition(|(name, ..)| is_error(name));
    let grown: BTreeMap<&str, bool> = errors
        .iter()
        .filter(|(_, b, h)| differs(b.abs(), h.abs(), MIN_ERROR))
        .map(|(name, b, h)| (*name, larger(b.abs(), h.abs())))
        .collect();
    for (name, b, h) in errors {
        if let Some(worse) = grown.get(name) {
            let stage = judged(name).map(|error| charged_stage(error, &grown, &judged));
            let scope = scope_of(stage, cells, &base.configuration);
            differ(scope, FigureKind::Error, name, b, h, *worse);
        }
    }
    for (name, b, h) in quantities {
        if differs(b, h, MIN_ERROR) {
            differ(whole.clone(), FigureKind::Quantity, name, b, h, false);
        }
    }
}

/// The stage that an error is charged to: the one whose output it judges, or the stage before it if the same error has moved
/// alike there. `grown` has the errors that have moved, and whether they grew.
fn charged_stage<'e>(
    error: &'e ErrorFigure,
    grown: &BTreeMap<&str, bool>,
    judged: &impl Fn(&str) -> Option<&'e ErrorFigure>,
) -> &'e str {
    let alike =
        |before: &&ErrorFigure| grown.get(before.name.as_str()) == grown.get(error.name.as_str());
    let before = error.before.as_deref().and_then(judged).filter(alike);
    &before.unwrap_or(error).stage
}

/// The stage's cell; the whole configuration where the stage is not known or is no cell.
fn scope_of(stage: Option<&str>, cells: &[CellId], configuration: &str) -> DifferenceScope {
    let is_cell =
        |cell: &&CellId| cell.configuration() == configuration && Some(cell.stage()) == stage;
    match cells.iter().find(is_cell) {
        Some(cell) => DifferenceScope::Cell(cell.clone()),
        None => DifferenceScope::Configuration(configuration.to_owned()),
    }
}

fn check(base: &CheckReading, head: &CheckReading) -> Option<Difference> {
    let broken = base.sound && !head.sound;
    let min_difference = MIN_OF_TOLERANCE * base.tolerance;
    let differs = broken || differs(base.measured, head.measured, min_difference);
    differs.then(|| Difference {
        scope: DifferenceScope::Stage(base.stage.clone()),
        kind: FigureKind::Error,
        figure: format!("{} ({})", base.what, base.unit),
        base: base.measured,
        head: head.measured,
        worse: broken || larger(base.measured, head.measured),
    })
}

/// A difference beyond what the order of floating-point sums makes. What is a number on one side only has moved.
fn differs(base: f64, head: f64, min_difference: f64) -> bool {
    let tolerance = (ERROR_GROWTH * base.abs()).max(min_difference);
    let within = (head - base).abs() <= tolerance;
    !within && (base.is_finite() || head.is_finite())
}

/// An error that is no number is larger than any.
fn larger(base: f64, head: f64) -> bool {
    head > base || (base.is_finite() && !head.is_finite())
}

#[cfg(test)]
mod tests;
