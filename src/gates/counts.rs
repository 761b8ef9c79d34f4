//! The gate of instruction counts: a cell's median on both sides, and whether it changed.

use std::collections::BTreeMap;

use fathom_record::comparison::{CellId, InstructionCounts};

use super::adapters::AdapterRelation;
use super::store::{StoredComparison, of_both};

/// A cell's counts on both sides.
#[derive(Clone, Debug, PartialEq)]
pub struct Counted {
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

/// Compares the counts of both sides. A change is one that exceeds the threshold and the spread of
/// either side's frames; cells that lack a side are left out.
pub fn judge(comparison: &StoredComparison) -> BTreeMap<CellId, Counted> {
    let threshold = comparison.header.settings.instruction_threshold;
    let is_judged = AdapterRelation::in_header(&comparison.header).is_judged();
    let counted = comparison.instructions.iter().filter(|line| !line.counts.is_empty());
    let judged = |(base, head): (&InstructionCounts, &InstructionCounts)| {
        let counted = compared(&base.counts, &head.counts, threshold);
        let change = if is_judged { counted.change } else { Change::NotJudged };
        (base.cell.clone(), Counted { change, ..counted })
    };
    of_both(counted, |line| (line.side, &line.cell)).into_iter().map(judged).collect()
}

fn compared(base_counts: &[u64], head_counts: &[u64], threshold: f64) -> Counted {
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
    Counted { base, head, ratio, change }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The figures of two runs on lavapipe, and of one with 2 % more work.
    #[test]
    fn two_percent_more_is_a_change_and_the_spread_of_runs_is_not() {
        let base = [60_679_568, 60_718_750, 60_729_061];
        let again = [60_677_997, 60_716_862, 60_727_334];
        assert_eq!(compared(&base, &again, 0.005).change, Change::Same);
        let more = base.map(|count| count + count / 50);
        let counted = compared(&base, &more, 0.005);
        assert_eq!(counted.change, Change::More);
        assert!((counted.ratio - 1.02).abs() < 1e-6);
        assert_eq!(compared(&more, &base, 0.005).change, Change::Fewer);
    }

    #[test]
    fn frames_that_vary_more_than_the_sides_differ_are_no_change() {
        let wide = [100, 110, 120];
        assert_eq!(compared(&wide, &[112, 113, 114], 0.005).change, Change::Same);
        assert_eq!(compared(&wide, &[121, 122, 123], 0.005).change, Change::More);
    }
}
