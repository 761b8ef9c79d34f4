//! Times of two runs that were made one after the other.
//!
//! They are reported, but not judged: two halves of one run on one machine, compared in this way, differ with a standard
//! deviation of 10 to 15 % on a software driver, whatever their length.

use std::collections::BTreeMap;

use super::store::{StoredComparison, of_both};
use fathom_base::statistics;
use fathom_record::Estimate;
use fathom_record::comparison::{CellId, UnpairedSamples};

/// A cell's time on both sides: medians with intervals that know nothing of what lay between the runs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Unpaired {
    pub base: RunTime,
    pub head: RunTime,
}

/// A cell's time in one run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RunTime {
    pub ns: Estimate,
    /// A shorter median cannot be distinguished from 0.
    pub resolution_ns: f64,
}

impl RunTime {
    fn of(samples: &UnpairedSamples) -> Self {
        Self { ns: statistics::estimate(&samples.ns), resolution_ns: samples.resolution_ns }
    }

    pub fn is_resolved(&self) -> bool {
        self.ns.median > self.resolution_ns
    }
}

impl Unpaired {
    /// Of the head against the base; none where a side's time is below the clock's resolution.
    pub fn change(&self) -> Option<f64> {
        let resolved = self.base.is_resolved() && self.head.is_resolved();
        resolved.then(|| self.head.ns.median / self.base.ns.median - 1.0)
    }
}

pub fn judge(comparison: &StoredComparison) -> BTreeMap<CellId, Unpaired> {
    let sampled = comparison.samples.iter().filter(|line| !line.ns.is_empty());
    let judged = |(base, head): (&UnpairedSamples, &UnpairedSamples)| {
        (base.cell.clone(), Unpaired { base: RunTime::of(base), head: RunTime::of(head) })
    };
    of_both(sampled, |line| (line.side, &line.cell)).into_iter().map(judged).collect()
}
