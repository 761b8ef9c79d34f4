//! The instruction gate: compares a cell's median count on both sides.
//!
//! What a process counted before changes what it counts, by up to 3 %, so a cell whose counts differ is counted once more on each side, alone
//! in a fresh process. It has changed if both counts say so, by the threshold and what the two changes differ by.

use std::collections::BTreeMap;

use fathom_record::comparison::{CellId, CellSubject, InstructionCounts};

use super::adapters::AdapterRelation;
use super::store::{Comparison, pair_sides};

/// Share by which the instructions to encode a stage must differ: of 40,000, equal builds differ by up to 1.2 %, as keys of hash
/// tables are random.
const ENCODE_THRESHOLD: f64 = 0.03;

#[derive(Clone, Debug, PartialEq)]
pub struct CountChange {
    /// Medians over the frames.
    pub base: f64,
    pub head: f64,
    /// `head / base`.
    pub ratio: f64,
    pub change: Change,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Change {
    More,
    Fewer,
    Same,
    /// Counts of different adapters.
    NotJudged,
}

impl CountChange {
    /// The counts of the cell alone, with what both say. What the changes differ by adds to the threshold.
    fn confirm(&self, alone: Self, threshold: f64) -> Self {
        let scatter = (alone.ratio / self.ratio - 1.0).abs();
        let is_beyond = |of: &Self| (of.ratio - 1.0).abs() > threshold + scatter;
        let agree = self.change == alone.change && is_beyond(self) && is_beyond(&alone);
        Self { change: if agree { alone.change } else { Change::Same }, ..alone }
    }
}

/// Compares the counts of both sides. A change is one that exceeds the threshold and the spread of
/// either side's frames, each time that the cell was counted; cells that lack a side are left out.
pub fn judge(comparison: &Comparison) -> BTreeMap<CellId, CountChange> {
    let mut cells = count_changes(comparison, false);
    for (cell, alone) in count_changes(comparison, true) {
        if let Some(counted) = cells.get_mut(&cell) {
            *counted = counted.confirm(alone, threshold(comparison, &cell));
        }
    }
    if !AdapterRelation::from_header(&comparison.header).is_judged() {
        cells.values_mut().for_each(|counted| counted.change = Change::NotJudged);
    }
    cells
}

/// Cells whose first counts say that they changed, which no process has counted alone yet.
pub fn open(comparison: &Comparison) -> Vec<CellId> {
    let is_judged = AdapterRelation::from_header(&comparison.header).is_judged();
    let alone = count_changes(comparison, true);
    let changed = count_changes(comparison, false).into_iter();
    let changed = changed.filter(|(_, counted)| is_judged && counted.change != Change::Same);
    changed.map(|(cell, _)| cell).filter(|cell| !alone.contains_key(cell)).collect()
}

/// Share by which a cell's counts must differ.
fn threshold(comparison: &Comparison, cell: &CellId) -> f64 {
    let threshold = comparison.header.settings.instruction_threshold;
    match cell.subject() {
        CellSubject::Encode(_) => threshold.max(ENCODE_THRESHOLD),
        CellSubject::Stage(_) | CellSubject::Create => threshold,
    }
}

/// The counts of cells among others, or of each alone.
fn count_changes(comparison: &Comparison, alone: bool) -> BTreeMap<CellId, CountChange> {
    let lines = comparison.instructions.iter();
    let lines = lines.filter(|line| line.second == alone && !line.counts.is_empty());
    let judged = |(base, head): (&InstructionCounts, &InstructionCounts)| {
        let threshold = threshold(comparison, &base.cell);
        (base.cell.clone(), compare_counts(&base.counts, &head.counts, threshold))
    };
    pair_sides(lines, |line| (line.side, &line.cell)).into_iter().map(judged).collect()
}

fn compare_counts(base_counts: &[u64], head_counts: &[u64], threshold: f64) -> CountChange {
    let median = |counts: &[u64]| {
        let counts: Vec<f64> = counts.iter().map(|count| *count as f64).collect();
        fathom_base::statistics::median(&counts)
    };
    let (base, head) = (median(base_counts), median(head_counts));
    let ratio = head / base;
    let change = if ratio > 1.0 + threshold && head_counts.iter().min() > base_counts.iter().max() {
        Change::More
    } else if ratio < 1.0 - threshold && head_counts.iter().max() < base_counts.iter().min() {
        Change::Fewer
    } else {
        Change::Same
    };
    CountChange { base, head, ratio, change }
}

#[cfg(test)]
mod tests {
    use fathom_record::comparison::Side;

    use super::*;

    /// The figures of two runs on lavapipe, and of one with 2 % more work.
    #[test]
    fn two_percent_more_is_a_change_and_the_spread_of_runs_is_not() {
        let base = [60_679_568, 60_718_750, 60_729_061];
        let again = [60_677_997, 60_716_862, 60_727_334];
        assert_eq!(compare_counts(&base, &again, 0.005).change, Change::Same);
        let more = base.map(|count| count + count / 50);
        let counted = compare_counts(&base, &more, 0.005);
        assert_eq!(counted.change, Change::More);
        assert!((counted.ratio - 1.02).abs() < 1e-6);
        assert_eq!(compare_counts(&more, &base, 0.005).change, Change::Fewer);
    }

    /// What a comparison of one cell says whose counts are `[base, head]`, among others and alone.
    fn judged(counts: &[[u64; 2]]) -> (Change, usize) {
        let mut comparison = Comparison::default();
        for (second, sides) in [false, true].into_iter().zip(counts) {
            for (side, count) in Side::BOTH.into_iter().zip(sides) {
                let cell = CellId::new("a", "b");
                let counts = vec![*count; 3];
                comparison.instructions.push(InstructionCounts { side, cell, counts, second });
            }
        }
        let open = open(&comparison).len();
        (judge(&comparison).into_values().next().unwrap().change, open)
    }

    #[test]
    fn a_change_that_processes_for_one_cell_do_not_confirm_is_none() {
        assert_eq!(judged(&[[1000, 1000]]), (Change::Same, 0));
        assert_eq!(judged(&[[1000, 1020]]), (Change::More, 1));
        assert_eq!(judged(&[[1000, 1020], [1000, 1020]]), (Change::More, 0));
        assert_eq!(judged(&[[1000, 980], [1000, 980]]), (Change::Fewer, 0));
        assert_eq!(judged(&[[1000, 1020], [1000, 1000]]), (Change::Same, 0));
        assert_eq!(judged(&[[1000, 1020], [1000, 980]]), (Change::Same, 0));
    }

    /// Measured: a program that differs in another stage.
    #[test]
    fn changes_beyond_the_threshold_by_no_more_than_they_differ_are_none() {
        let counts = [[13_999_542, 14_078_669], [13_956_398, 14_027_372]];
        assert_eq!(judged(&counts), (Change::Same, 0));
        let more = counts.map(|[base, head]| [base, head + head / 200]);
        assert_eq!(judged(&more), (Change::More, 0));
        // Among others one side has what the other has not, or both have.
        let modes = [[12_210_000, 12_560_000], [12_210_000, 12_211_000]];
        assert_eq!(judged(&modes), (Change::Same, 0));
        assert_eq!(
            judged(&[[12_560_000, 12_811_000], [12_210_000, 12_454_000]]),
            (Change::More, 0)
        );
    }

    #[test]
    fn frames_that_vary_more_than_the_sides_differ_are_no_change() {
        let wide = [100, 110, 120];
        assert_eq!(compare_counts(&wide, &[112, 113, 114], 0.005).change, Change::Same);
        assert_eq!(compare_counts(&wide, &[121, 122, 123], 0.005).change, Change::More);
    }
}
