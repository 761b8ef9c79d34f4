//! How near each stage comes to the adapter's measured limits.

use itertools::Itertools;

use super::{Fold, Page, PageSection};
use crate::Report;
use crate::ceilings::{BoundStage, are_measured, bounds};
use crate::document::{self, Block, ColumnKind, Line, Span, Table};
use crate::format::{percent, si, three};
use fathom_record::Interval;
use fathom_record::ceilings::{Basis, Ceiling};

pub const SECTION: PageSection = PageSection {
    id: "ceilings",
    title: "How near to the limits",
    question: "Which stages come near to the adapter's limits?",
    fold: Fold::Folded,
    write: |page| document::html_if_any(parts(page)),
};

fn parts(page: &Page<'_>) -> Vec<Block> {
    let lead = "Each stage's best share of the adapter's limit. A stage at 100 % can only become faster by doing less work. A small \
                share means that something else limits the stage, such as arithmetic, latency or work that it does not declare.";
    page.each_run(lead, |run| if are_measured(run.view) { shares(run.view) } else { Vec::new() })
}

fn shares(view: &Report<'_>) -> Vec<Block> {
    let bounds = bounds(view);
    let nearest = || bounds.iter().unique_by(|bound| bound.stage.stage.as_str());
    let timed = view.timed().flat_map(|(_, measured)| &measured.stages);
    let names = timed.map(|stage| stage.stage.as_str()).sorted_unstable().dedup();
    let unknown =
        names.filter(|name| !nearest().any(|bound| bound.stage.stage == *name)).join(", ");
    let columns = ["Stage", "Share of its limit (interval)", "Limit", "Work in a frame", "Cell"];
    let table = Table::new("Shares of limits", columns)
        .with(ColumnKind::Numbers, &columns[1..2])
        .with_rows(nearest().map(row));
    let unknown = (!unknown.is_empty()).then(|| {
        Block::paragraph(format!(
            "Unknown, because no limit bounds what they declare or the clock does not resolve them: {unknown}."
        ))
    });
    let limits = Block::Fold("The limits".into(), vec![Block::Table(limits(view))]);
    std::iter::once(Block::Table(table)).chain(unknown).chain([limits]).collect()
}

fn row(BoundStage { cell, stage, share }: &BoundStage<'_>) -> [Line; 5] {
    let basis = if share.basis == Basis::Counted { "counted" } else { "declared" };
    [
        stage.stage.as_str().into(),
        Line::from(Span::Bold(percent(share.share)))
            .and(ends(share.interval, |share| three(100.0 * share))),
        share.limit_name().into(),
        format!("{} {}, {basis}", si(share.amount as f64), share.work.name()).into(),
        format!("{}: {}", cell.experiment, cell.cell).into(),
    ]
}

fn ends(interval: Option<Interval>, text: impl Fn(f64) -> String) -> String {
    let of = |Interval { low, high }| format!(" ({} – {})", text(low), text(high));
    interval.map(of).unwrap_or_default()
}

/// Those of the latest sitting that measured some.
fn limits(view: &Report<'_>) -> Table {
    let measured = view.runs.iter().rev().find(|run| !run.ceilings.is_empty());
    let columns = ["Limit", "Rate (interval)", "n", "2 N / N"];
    let row = |ceiling: &Ceiling| {
        let Ceiling { limit, rate, doubling, .. } = ceiling;
        [
            ceiling.name(),
            format!("{} {}{}", si(rate.median), limit.unit(), ends(rate.interval, si)),
            rate.n.to_string(),
            format!("{}{}", three(*doubling), if ceiling.is_sound() { "" } else { " unusable" }),
        ]
    };
    Table::new("Limits", columns)
        .with(ColumnKind::Numbers, &columns[1..])
        .with_rows(measured.iter().flat_map(|run| &run.ceilings).map(row))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ceilings::tests::run as limited;
    use crate::testing::written;
    use fathom_experiments::fixtures;

    #[test]
    fn each_stage_stands_once_with_its_largest_share_and_those_without_one_are_named() {
        assert_eq!(written(SECTION.write, &fixtures::run()), "");
        let records = limited();
        let text = written(SECTION.write, &records);
        let view = Report::new(&records, None);
        let bounds = bounds(&view);
        assert!(bounds.len() > 100 && bounds.is_sorted_by(|a, b| a.share.share >= b.share.share));
        let nearest = bounds[0];
        assert_eq!(text.matches(&format!("<td>{}</td>", nearest.stage.stage)).count(), 1);
        assert!(
            text.contains(&format!("<strong>{}</strong>", percent(nearest.share.share))),
            "{text}"
        );
        assert!(text.contains("does not resolve them: caustics/trace, "), "{text}");
    }
}
