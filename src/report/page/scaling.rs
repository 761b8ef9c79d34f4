//! How times and errors grow: the fitted exponents. The plots that they were fitted in stand with their experiments.

use maud::{Markup, html};

use super::parts::{numbers, table, words};
use super::{Fold, Page, PageRun, PageSection};
use crate::facts::{self, Exponent};
use crate::format::si;

pub const SECTION: PageSection = PageSection {
    id: "scaling",
    title: "How it scales",
    question: "With which exponent does a stage grow, and how certain is that?",
    fold: Fold::Folded,
    write,
};

fn write(page: &Page<'_>) -> Option<Markup> {
    let exponents = page.runs.iter().map(|run| (run, facts::exponents(run.view)));
    let rows = html! {
        @for (run, exponents) in exponents { @for exponent in &exponents { (row(page, run, exponent)) } }
    };
    if rows.0.is_empty() {
        return None;
    }
    let heads = html! {
        (page.run_head()) (words(&["Plot", "What", "Over"])) (numbers(&["Exponent (interval)", "Range", "Cells"]))
    };
    Some(html! {
        p.lead {
            "Exponents b of y ∝ xᵇ, fitted to the cells whose fixed cost is at most a tenth of the time: 1 is linear. The interval is that of "
            "95 % over the rounds of sampling, or the extremes with one cell left out where figures are exact. Of medians: cells were "
            "measured apart, so medians are fitted, and the interval is by resampling each cell."
        }
        (table("Exponents", "sortable", &heads, &rows))
    })
}

fn row(page: &Page<'_>, run: &PageRun<'_>, exponent: &Exponent<'_, '_>) -> Markup {
    let (id, fit) = (exponent.section.id, &exponent.fit);
    html! {
        tr {
            @if page.is_overlay() { td { (run.label) } }
            td { a href={ "#plot-" (id) } { (id) } }
            th scope="row" { (exponent.y_title()) @if !exponent.group.is_empty() { " (" (exponent.group) ")" } }
            td { (exponent.x_title()) }
            td.number data-v=(fit.exponent()) { (exponent.text()) }
            td.number { (si(fit.range.0)) " – " (si(fit.range.1)) }
            td.number { (fit.slope.n) }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{overlaid, written};
    use fathom_experiments::fixtures;

    #[test]
    fn every_exponent_has_a_row_in_each_run() {
        let html = written(write, &fixtures::run());
        let rows = facts::exponents(&crate::testing::view()).len();
        assert!(rows > 10 && html.matches("<tr>").count() == rows + 1, "{html}");
        let mut rows_of_plot = html.split("<tr>").filter(|row| row.contains("#plot-uw-photons"));
        assert!(rows_of_plot.any(|row| row.contains(">caustics/trace<")), "{html}");
        assert_eq!(overlaid(write).matches("<td>two</td>").count(), rows);
        assert_eq!(written(write, &fixtures::all_skipped()), "");
    }
}
