//! How near stages come to the adapter's limits.

use itertools::Itertools;

use super::Report;
use fathom_record::ceilings::CeilingShare;
use fathom_record::{Cell, StageRecord};

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoundStage<'a> {
    pub cell: &'a Cell,
    pub stage: &'a StageRecord,
    pub share: &'a CeilingShare,
}

/// Limits of the adapter were measured.
pub fn are_measured(view: &Report<'_>) -> bool {
    view.runs.iter().any(|run| !run.ceilings.is_empty())
}

/// Every stage of every cell that has a share of a ceiling, the nearest to its ceiling first.
pub fn bounds<'a>(view: &Report<'a>) -> Vec<BoundStage<'a>> {
    let stages = view
        .timed()
        .flat_map(|(cell, measured)| measured.stages.iter().map(move |stage| (cell, stage)));
    let bound = |(cell, stage): (&'a Cell, &'a StageRecord)| {
        Some(BoundStage { cell, stage, share: stage.ceiling.as_ref()? })
    };
    let by_share = |a: &BoundStage<'_>, b: &BoundStage<'_>| b.share.share.total_cmp(&a.share.share);
    stages.filter_map(bound).sorted_by(by_share).collect()
}

#[cfg(test)]
pub mod tests {
    use fathom_experiments::fixtures;
    use fathom_record::ceilings::{Ceiling, Limit};
    use fathom_record::{Estimate, PassKind, Record};

    fn ceiling(limit: Limit, rate: f64) -> Ceiling {
        Ceiling::new(limit, Estimate { median: rate, ..Estimate::default() }, 2.0)
    }

    /// A run whose adapter has two limits, all of whose stages fetch 1,000 texels and write 4,000 bytes, but one that does no such work.
    pub fn run() -> Vec<Record> {
        let limits =
            vec![ceiling(Limit::Loads2d(PassKind::Compute), 1e9), ceiling(Limit::WriteCached, 8e9)];
        let mut records = fixtures::run();
        for record in &mut records {
            match record {
                Record::Run(run) => run.ceilings = limits.clone(),
                Record::Cell(cell) => {
                    let stages = cell.measured_mut().map(|measured| &mut measured.stages);
                    for stage in stages.into_iter().flatten() {
                        stage.work = Default::default();
                        if stage.stage != "caustics/trace" {
                            (stage.work.texel_fetches, stage.work.bytes_written) = (1_000, 4_000);
                        }
                        stage.ceiling = stage.share_of(&limits);
                    }
                }
                _ => {}
            }
        }
        records
    }
}
