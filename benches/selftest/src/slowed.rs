//! What comparisons show in which every stage was slowed down: a truth for each of them from the others, and gates with one
//! slowdown, composed of these and of gates of equal builds.

use std::collections::BTreeMap;

use fathom::compare::rank;
use fathom::compare::store::StoredComparison;
use fathom::compare::time::{CellTime, TimeVerdict};
use fathom::compare::verdict::{GateState, JudgedCell, Verdicts};
use fathom::record::comparison::{CellId, Gate, GateSettings, Pair};
use fathom::statistics::{ALPHA, Estimate, Interval};
use serde::Serialize;

use crate::findings::{Found, Share};
use crate::injections::Size;
use crate::trials::{Trial, Variant};

/// The usable comparisons of one size, with their trials' names.
pub struct Slowed<'a>(Vec<(&'a str, Verdicts<'a>)>);

/// How often intervals contain the truth that the other comparisons give.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Coverage {
    pub plain: Share,
    /// With intervals that are wider by the truth's own error.
    pub corrected: Share,
}

/// Gates of equal builds in which the pairs of one stage come from a comparison in which it was slowed down.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Composed {
    pub found: Found,
    /// Not caught in a first measurement that leaves the stage open, while no second one was stored.
    pub without_second: usize,
    /// Gates in which each stage was caught.
    pub stages: BTreeMap<String, Share>,
}

impl<'a> Slowed<'a> {
    pub fn of(size: Size, made: &'a [(Trial, StoredComparison)]) -> Self {
        let every = Variant::Every(size);
        let own = made.iter().filter(|(trial, _)| trial.variant == every);
        let judged = own.map(|(trial, stored)| (trial.id.as_str(), Verdicts::of(stored)));
        Self(judged.filter(|(_, verdicts)| ran(verdicts)).collect())
    }

    /// What all comparisons but one show of a cell together: the centre of their launches.
    pub fn truth(&self, cell: &CellId, but: Option<&str>) -> Option<Estimate> {
        let others = self.0.iter().filter(|(trial, _)| Some(*trial) != but);
        let times = others.filter_map(|(_, verdicts)| time(verdicts, cell));
        let launches: Vec<f64> = times.flat_map(|time| time.launches.iter().copied()).collect();
        (!launches.is_empty()).then(|| rank::centre(&launches, ALPHA).map(f64::exp_m1))
    }

    pub fn coverage(&self) -> Coverage {
        let mut coverage = Coverage::default();
        for (trial, verdicts) in &self.0 {
            for change in verdicts
                .cells
                .iter()
                .filter_map(|cell| Some((&cell.cell, cell.time.as_ref()?.change)))
            {
                let (cell, change) = change;
                let (Some(interval), Some(truth)) =
                    (change.interval, self.truth(cell, Some(trial)))
                else {
                    continue;
                };
                coverage.plain.add(holds(interval, truth.median));
                coverage.corrected.add(holds(widened(&change, interval, truth.n), truth.median));
            }
        }
        coverage
    }

    /// Each gate of equal builds with each stage slowed down, as one of the comparisons of the same cells and settings has it.
    pub fn composed(&self, equal: &[&StoredComparison]) -> Composed {
        let mut composed = Composed::default();
        for (number, gate) in equal.iter().enumerate() {
            let fitting = self.0.iter().map(|(_, verdicts)| verdicts.comparison);
            let fitting: Vec<_> = fitting.filter(|slowed| is_alike(slowed, gate)).collect();
            let Some(slowed) = fitting.get(number % fitting.len().max(1)) else { continue };
            let stages = slowed.header.cells.iter().filter(|cell| cell.subject().is_stage());
            for stage in stages.map(CellId::stage).collect::<std::collections::BTreeSet<_>>() {
                composed.add(stage, &with_stage(gate, slowed, stage));
            }
        }
        composed
    }
}

impl Composed {
    fn add(&mut self, stage: &str, gate: &StoredComparison) {
        let verdicts = Verdicts::of(gate);
        let found = Found::of(&verdicts, stage);
        let caught = found.caught.count > 0;
        let is_open = |cell: &JudgedCell| {
            cell.time.as_ref().is_some_and(|time| {
                let undecided =
                    time.verdict == TimeVerdict::Inconclusive && time.detectable.is_some();
                cell.cell.stage() == stage && undecided && !time.second
            })
        };
        self.without_second += usize::from(!caught && verdicts.cells.iter().any(is_open));
        self.stages.entry(stage.to_owned()).or_default().add(caught);
        self.found += found;
    }
}

fn ran(verdicts: &Verdicts<'_>) -> bool {
    verdicts.gates.contains(&(Gate::Time, GateState::Ran))
}

fn time<'v>(verdicts: &'v Verdicts<'_>, cell: &CellId) -> Option<&'v CellTime> {
    verdicts.cells.iter().find(|judged| judged.cell == *cell)?.time.as_ref()
}

pub fn holds(interval: Interval, truth: f64) -> bool {
    interval.low <= truth && truth <= interval.high
}

/// An interval for the difference from a truth of so many launches, if all launches scatter alike.
fn widened(change: &Estimate, interval: Interval, launches: usize) -> Interval {
    let wider = (1.0 + change.n as f64 / launches as f64).sqrt();
    let end = |end: f64| change.median + wider * (end - change.median);
    Interval { low: end(interval.low), high: end(interval.high) }
}

fn is_alike(a: &StoredComparison, b: &StoredComparison) -> bool {
    let settings = |of: &StoredComparison| GateSettings { seed: 0, ..of.header.settings.clone() };
    settings(a) == settings(b)
        && a.header.cells == b.header.cells
        && a.header.adapter == b.header.adapter
}

/// A gate in which the pairs of a stage are another's, those of the second measurement too.
fn with_stage(gate: &StoredComparison, other: &StoredComparison, stage: &str) -> StoredComparison {
    let own = |pair: &Pair| !pair.control && pair.cell.stage() == stage;
    let mut composed = gate.clone();
    composed.pairs.retain(|pair| !own(pair));
    composed.pairs.extend(other.pairs.iter().filter(|pair| own(pair)).cloned());
    composed
}
