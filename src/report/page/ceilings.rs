//! How near each stage comes to the adapter's measured limits.

use itertools::Itertools;
use maud::{Markup, html};

use super::parts::{numbers, table, words};
use super::{Fold, Page, PageRun, PageSection};
use crate::ceilings::{Bound, bounds};
use crate::format::{percent, si, three};
use fathom_record::ceilings::{Basis, Ceiling, CeilingShare};

pub const SECTION: PageSection = PageSection {
    id: "ceilings",
    title: "How near to the limits",
    question: "Which stages come near to the adapter's limits?",
    fold: Fold::Folded,
    write,
};

/// Stages that are shown unfolded.
const OPEN_STAGES: usize = 12;

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
            (of_run(page, run))
        }
    })
}

fn of_run(page: &Page<'_>, run: &PageRun<'_>) -> Markup {
    let nearest: Vec<Bound<'_>> =
        bounds(run.view).into_iter().unique_by(|bound| bound.stage.stage.as_str()).collect();
    let (open, folded) = nearest.split_at(nearest.len().min(OPEN_STAGES));
    html! {
        (shares(page, open))
        @if !folded.is_empty() {
            details { summary { (folded.len()) " more stages" } (shares(page, folded)) }
        }
        details { summary { "The limits" } (limits(run)) }
    }
}

fn shares(page: &Page<'_>, bounds: &[Bound<'_>]) -> Markup {
    let heads = html! {
        (words(&["Stage", "Share of its limit"])) (numbers(&["(interval)"])) (words(&["Limit", "Work in a frame", "Cell"]))
    };
    let rows = html! { @for bound in bounds { (row(page, bound)) } };
    table("Shares of limits", "", &heads, &rows)
}

fn row(page: &Page<'_>, Bound { cell, stage, share }: &Bound<'_>) -> Markup {
    let width = format!("width:{:.1}%", 100.0 * share.share.clamp(0.0, 1.0));
    let color = page.colors.of(&stage.stage).hex();
    html! {
        tr {
            th scope="row" { (stage.stage) }
            td { span.share { span.share-bar style={ (width) ";background:" (color) } {} } " " b { (percent(share.share)) } }
            td.number { (interval(share)) }
            td { (share.limit.name()) }
            td { (si(share.amount as f64)) " " (share.work.name()) ", " (basis(share.basis)) }
            td { (cell.experiment) ": " (cell.cell) }
        }
    }
}

fn interval(share: &CeilingShare) -> String {
    let ends = share.interval.map(|ends| [ends.low, ends.high].map(|end| three(100.0 * end)));
    ends.map_or_else(String::new, |[low, high]| format!("({low} – {high})"))
}

fn basis(basis: Basis) -> &'static str {
    match basis {
        Basis::Counted => "counted",
        Basis::Declared => "declared",
    }
}

fn limits(run: &PageRun<'_>) -> Markup {
    // Those of the latest sitting.
    let measured = run.view.runs.iter().rev().find(|run| !run.ceilings.is_empty());
    let ceilings: &[Ceiling] = measured.map_or(&[], |run| &run.ceilings);
    let heads = html! { (words(&["Limit"])) (numbers(&["Rate", "(interval)", "n", "2 N / N"])) };
    let rows = html! {
        @for ceiling in ceilings {
            @let rate = ceiling.rate;
            tr {
                th scope="row" { (ceiling.limit.name()) }
                td.number { (si(rate.median)) " " (ceiling.limit.unit()) }
                td.number { @if let Some(ends) = rate.interval { "(" (si(ends.low)) " – " (si(ends.high)) ")" } }
                td.number { (rate.n) }
                td.number { (three(ceiling.doubling)) @if !ceiling.is_sound() { " unusable" } }
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
    fn each_stage_stands_once_with_its_largest_share() {
        assert_eq!(written(write, &fixtures::run()), "");
        let records = limited();
        let text = written(write, &records);
        let view = ReportView::new(&records, None);
        let nearest = bounds(&view)[0];
        assert_eq!(text.matches(&format!("{}</th>", nearest.stage.stage)).count(), 1);
        assert!(text.contains(&format!("<b>{}</b>", percent(nearest.share.share))), "{text}");
    }
}
