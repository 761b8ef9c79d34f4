//! Times of two runs that were made one after the other.
//!
//! They are told and not judged: two halves of one run on one machine, compared in this way, differ with a standard
//! deviation of 10 to 15 % on a software driver, whatever their length.

use std::collections::BTreeMap;

use super::cells::CellId;
use super::store::{Comparison, Samples, Side};
use crate::record::Estimate;
use crate::statistics;

/// A cell's time on both sides: medians with bootstrap intervals that know nothing of what lay between the runs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Unpaired {
    pub base_ns: Estimate,
    pub head_ns: Estimate,
}

impl Unpaired {
    pub fn change(&self) -> f64 {
        self.head_ns.median / self.base_ns.median - 1.0
    }
}

pub fn judge(comparison: &Comparison) -> BTreeMap<CellId, Unpaired> {
    let of = |side: Side, cell: &CellId| {
        let mut lines = comparison.samples.iter();
        lines.find(|line: &&Samples| line.side == side && line.cell == *cell && !line.ns.is_empty())
    };
    let both = |cell: &CellId| {
        let (base, head) = (of(Side::Base, cell)?, of(Side::Head, cell)?);
        Some((
            cell.clone(),
            Unpaired {
                base_ns: statistics::estimate(&base.ns),
                head_ns: statistics::estimate(&head.ns),
            },
        ))
    };
    comparison.header.cells.iter().filter_map(both).collect()
}
