//! How near stages come to the adapter's limits.

use std::collections::BTreeMap;

use itertools::Itertools;

use super::ReportView;
use fathom_record::ceilings::{Bounded, Ceiling, CeilingShare, binding};
use fathom_record::{Cell, Clock, Run, StageRecord};

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

/// A stage's place under the roofs. Williams, Waterman & Patterson, *Roofline: An Insightful Visual Performance Model for Multicore
/// Architectures*, CACM 52 (2009).
#[derive(Clone, Debug, PartialEq)]
pub struct RoofPoint<'a> {
    pub stage: &'a str,
    /// What is counted along both axes.
    pub items: Bounded,
    /// Items for each byte that must be read or written.
    pub per_byte: f64,
    pub per_second: f64,
}

/// What a pipeline's stages attained, each in the cell in which it took longest.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Roofline<'a> {
    pub points: Vec<RoofPoint<'a>>,
    /// Stages that have no place: they declare no items, or no bytes.
    pub without: Vec<&'a str>,
    /// Bytes per second: of the fastest working set, and of the largest.
    pub memory: Vec<&'a Ceiling>,
    /// Items per second, of the kinds that points count.
    pub roofs: Vec<(Bounded, &'a Ceiling)>,
}

/// A roofline for each pipeline that has a point, by the pipeline's name.
pub fn rooflines<'a>(view: &ReportView<'a>) -> BTreeMap<&'a str, Roofline<'a>> {
    let Some(run) = view.runs.iter().rev().copied().find(|run| !run.ceilings.is_empty()) else {
        return BTreeMap::new();
    };
    let longest = longest(view);
    let pipelines = longest.into_iter().map(|((pipeline, _), stage)| (pipeline, stage));
    let pipelines = pipelines.into_group_map();
    let rooflines = pipelines.into_iter().map(|(name, stages)| (name, roofline(run, &stages)));
    rooflines.filter(|(_, roofline)| !roofline.points.is_empty()).collect()
}

/// The longest record of each stage that the clock can tell from none, by pipeline and stage.
fn longest<'a>(view: &ReportView<'a>) -> BTreeMap<(&'a str, &'a str), &'a StageRecord> {
    let stages = view.timed().flat_map(|(cell, measured)| {
        measured
            .stages
            .iter()
            .map(move |stage| ((cell.pipeline.as_str(), stage.stage.as_str()), stage))
    });
    let resolved = stages.filter(|(_, stage)| stage.clock != Clock::Host && stage.is_resolved());
    let first_longest = |a: &'a StageRecord, _: &(&str, &str), b: &'a StageRecord| {
        if b.time.median > a.time.median { b } else { a }
    };
    resolved.into_grouping_map().reduce(first_longest).into_iter().collect()
}

fn roofline<'a>(run: &'a Run, stages: &[&'a StageRecord]) -> Roofline<'a> {
    let mut roofline = Roofline::default();
    for stage in stages {
        match point(&run.ceilings, stage) {
            Some(point) => roofline.points.push(point),
            None => roofline.without.push(&stage.stage),
        }
    }
    let largest = binding(&run.ceilings, Bounded::Bytes, u64::MAX);
    let fastest = binding(&run.ceilings, Bounded::Bytes, 0);
    roofline.memory = fastest.into_iter().chain(largest).dedup().collect();
    let kinds = roofline.points.iter().map(|point| point.items).sorted().dedup();
    let roof = |kind| Some((kind, binding(&run.ceilings, kind, 0)?));
    roofline.roofs = kinds.filter_map(roof).collect();
    roofline
}

/// Counts the items whose ceiling allows the longest least time.
fn point<'a>(ceilings: &[Ceiling], stage: &'a StageRecord) -> Option<RoofPoint<'a>> {
    let (bytes, _) = stage.least_work_of(Bounded::Bytes)?;
    let kinds = [Bounded::Texels, Bounded::Fragments, Bounded::Primitives];
    let amounts = kinds.into_iter().filter_map(|kind| {
        let (amount, _) = stage.least_work_of(kind)?;
        let least_s = amount as f64 / binding(ceilings, kind, amount)?.rate.median;
        Some((kind, amount as f64, least_s))
    });
    let (items, amount, _) = amounts.max_by(|a, b| a.2.total_cmp(&b.2))?;
    Some(RoofPoint {
        stage: &stage.stage,
        items,
        per_byte: amount / bytes as f64,
        per_second: amount / (stage.time.median * 1e-9),
    })
}

#[cfg(test)]
pub mod tests {
    use super::*;
    use fathom_experiments::fixtures;
    use fathom_record::ceilings::{Basis, Limit, TexelFormat};
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

    #[test]
    fn points_lie_at_what_was_counted() {
        let records = run();
        let view = ReportView::new(&records, None);
        let rooflines = rooflines(&view);
        let underwater = &rooflines["underwater"];
        let point = underwater.points.iter().find(|p| p.stage == "caustics/trace").unwrap();
        assert_eq!((point.items, point.per_byte), (Bounded::Texels, 0.25));
        let rates: Vec<f64> = underwater.memory.iter().map(|roof| roof.rate.median).collect();
        assert_eq!(rates, [8e9, 2e9]);
        assert_eq!(underwater.roofs.len(), 1);
        assert!(underwater.without.is_empty());
    }
}
