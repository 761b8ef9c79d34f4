//! How near each stage comes to the adapter's measured limits.

use itertools::Itertools;
use maud::{Markup, html};

use super::parts::{numbers, table, words};
use super::{Fold, Page, PageRun, PageSection};
use crate::ceilings::{Bound, bounds};
use crate::format::{percent, si, three};
use fathom_record::Interval;
use fathom_record::ceilings::{Basis, Ceiling};

pub const SECTION: PageSection = PageSection {
    id: "ceilings",
    title: "How near to the limits",
    question: "Which stages come near to the adapter's limits?",
    fold: Fold::Folded,
    write,
};

/// Without measured limits the page has no such section.
pub fn are_measured(run: &PageRun<'_>) -> bool {
    run.view.runs.iter().any(|run| !run.ceilings.is_empty())
}

fn write(page: &Page<'_>) -> Option<Markup> {
    let runs: Vec<&PageRun<'_>> = page.runs.iter().filter(|run| are_measured(run)).collect();
    if runs.is_empty() {
        return None;
    }
    Some(html! {
        p.lead {
            "Each stage's best share of the hardware limit. A stage at 100 % can only become faster by doing less work. A small "
            "share means that something else limits the stage, such as arithmetic, latency or work that it does not declare."
        }
        @for run in runs {
            @if page.is_overlay() { h3 { (run.label) } }
            (shares(run))
            details { summary { "The limits" } (limits(run)) }
        }
    })
}

fn shares(run: &PageRun<'_>) -> Markup {
    let bounds = bounds(run.view);
    let nearest = || bounds.iter().unique_by(|bound| bound.stage.stage.as_str());
    let timed = run.view.timed().flat_map(|(_, measured)| &measured.stages);
    let names = timed.map(|stage| stage.stage.as_str()).sorted_unstable().dedup();
    let unknown =
        names.filter(|name| !nearest().any(|bound| bound.stage.stage == *name)).join(", ");
    let heads = html! {
        (words(&["Stage"])) (numbers(&["Share of its limit", "(interval)"])) (words(&["Limit", "Work in a frame", "Cell"]))
    };
    let rows = html! { @for bound in nearest() { (row(bound)) } };
    html! {
        (table("Shares of limits", "", &heads, &rows))
        @if !unknown.is_empty() {
            p { "Unknown, because no limit bounds what they declare or the clock does not resolve them: " (unknown) "." }
        }
    }
}

fn row(Bound { cell, stage, share }: &Bound<'_>) -> Markup {
    let basis = if share.basis == Basis::Counted { "counted" } else { "declared" };
    html! {
        tr {
            th scope="row" { (stage.stage) }
            td.number { b { (percent(share.share)) } }
            td.number { (ends(share.interval, |share| three(100.0 * share))) }
            td { (share.limit.name()) }
            td { (si(share.amount as f64)) " " (share.work.name()) ", " (basis) }
            td { (cell.experiment) ": " (cell.cell) }
        }
    }
}

fn ends(interval: Option<Interval>, text: impl Fn(f64) -> String) -> String {
    let of = |Interval { low, high }| format!("({} – {})", text(low), text(high));
    interval.map(of).unwrap_or_default()
}

fn limits(run: &PageRun<'_>) -> Markup {
    // Those of the latest sitting.
    let measured = run.view.runs.iter().rev().find(|run| !run.ceilings.is_empty());
    let ceilings: &[Ceiling] = measured.map_or(&[], |run| &run.ceilings);
    let heads = html! { (words(&["Limit"])) (numbers(&["Rate", "(interval)", "n", "2 N / N"])) };
    let rows = html! {
        @for ceiling @ Ceiling { limit, rate, doubling } in ceilings {
            tr {
                th scope="row" { (limit.name()) }
                td.number { (si(rate.median)) " " (limit.unit()) }
                td.number { (ends(rate.interval, si)) }
                td.number { (rate.n) }
                td.number { (three(*doubling)) @if !ceiling.is_sound() { " unusable" } }
            }
        }
    };
    table("Limits", "", &heads, &rows)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ReportView;
    use crate::ceilings::tests::run as limited;
    use crate::testing::written;
    use fathom_experiments::fixtures;

    #[test]
    fn each_stage_stands_once_with_its_largest_share_and_those_without_one_are_named() {
        assert_eq!(written(write, &fixtures::run()), "");
        let records = limited();
        let text = written(write, &records);
        let view = ReportView::new(&records, None);
        let bounds = bounds(&view);
        assert!(bounds.len() > 100 && bounds.is_sorted_by(|a, b| a.share.share >= b.share.share));
        let nearest = bounds[0];
        assert_eq!(text.matches(&format!("{}</th>", nearest.stage.stage)).count(), 1);
        assert!(text.contains(&format!("<b>{}</b>", percent(nearest.share.share))), "{text}");
        assert!(text.contains("does not resolve them: caustics/trace, "), "{text}");
    }
}
