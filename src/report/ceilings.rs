//! How near stages come to the adapter's limits.

use itertools::Itertools;

use super::ReportView;
use fathom_record::ceilings::CeilingShare;
use fathom_record::{Cell, StageRecord};

/// A stage of a cell and the ceiling that binds it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bound<'a> {
    pub cell: &'a Cell,
    pub stage: &'a StageRecord,
    pub share: &'a CeilingShare,
}

/// Every stage of every cell that has a share of a ceiling, the nearest to its ceiling first.
pub fn bounds<'a>(view: &ReportView<'a>) -> Vec<Bound<'a>> {
    let stages = view
        .timed()
        .flat_map(|(cell, measured)| measured.stages.iter().map(move |stage| (cell, stage)));
    let bound = |(cell, stage): (&'a Cell, &'a StageRecord)| {
        Some(Bound { cell, stage, share: stage.ceiling.as_ref()? })
    };
    let by_share = |a: &Bound<'_>, b: &Bound<'_>| b.share.share.total_cmp(&a.share.share);
    stages.filter_map(bound).sorted_by(by_share).collect()
}

#[cfg(test)]
pub mod tests {
    use super::*;
    use fathom_experiments::fixtures;
    use fathom_record::ceilings::{Basis, Bounded, Ceiling, Limit, TexelFormat};
    use fathom_record::{Estimate, Record};

    fn ceiling(limit: Limit, rate: f64) -> Ceiling {
        Ceiling { limit, rate: Estimate { median: rate, ..Estimate::default() }, doubling: 2.0 }
    }

    /// A run whose adapter has two limits, all of whose stages fetch 1,000 texels and write 4,000 bytes.
    pub fn run() -> Vec<Record> {
        let limits = vec![
            ceiling(Limit::Load2d { format: TexelFormat::R32Float }, 1e9),
            ceiling(Limit::Copy { working_set_bytes: 1 << 16 }, 8e9),
            ceiling(Limit::Copy { working_set_bytes: 1 << 28 }, 2e9),
        ];
        let mut records = fixtures::run();
        for record in &mut records {
            match record {
                Record::Run(run) => run.ceilings = limits.clone(),
                Record::Cell(cell) => {
                    let stages = cell.measured_mut().map(|measured| &mut measured.stages);
                    for stage in stages.into_iter().flatten() {
                        stage.work = Default::default();
                        (stage.work.texel_fetches, stage.work.bytes_written) = (1_000, 4_000);
                        stage.ceiling = stage.share_of(&limits);
                    }
                }
                _ => {}
            }
        }
        records
    }

    #[test]
    fn stages_are_listed_from_the_nearest_to_its_ceiling() {
        let records = run();
        let view = ReportView::new(&records, None);
        let bounds = bounds(&view);
        assert!(bounds.len() > 100);
        assert!(bounds.is_sorted_by(|a, b| a.share.share >= b.share.share));
        let first = bounds[0];
        assert_eq!((first.share.work, first.share.basis), (Bounded::Texels, Basis::Declared));
        let expected = 1_000.0 / 1e9 / (first.stage.time.median * 1e-9);
        assert!((first.share.share - expected).abs() < 1e-12);
    }
}
