//! How times and errors grow: the fitted exponents. The plots that they were fitted in stand with their experiments.

use super::{Fold, Page, PageSection};
use crate::charts::names;
use crate::document::{self, Block, ColumnKind, Field, Line};
use crate::facts;
use crate::format::si;

pub const SECTION: PageSection = PageSection {
    id: "scaling",
    title: "How it scales",
    question: "With which exponent does a stage grow, and how certain is that?",
    fold: Fold::Folded,
    write: |page| document::html_if_any(parts(page)),
};

pub fn parts(page: &Page<'_>) -> Vec<Block> {
    let columns = ["Plot", "What", "Over", "Exponent (interval)", "Range", "Cells"];
    let mut table = page.table("Exponents", &columns);
    table = table.with(ColumnKind::Numbers, &columns[3..]).with_class("sortable");
    for run in &page.runs {
        table = table.with_rows(facts::exponents(run.view).into_iter().map(|exponent| {
            let group =
                Some(format!(" ({})", exponent.group)).filter(|_| !exponent.group.is_empty());
            let (fit, x_title) = (&exponent.fit, exponent.plot.x_title.clone());
            let fields = [
                exponent.section.span().into(),
                Line::from(names::measure(exponent.y)).and(group.unwrap_or_default()).into(),
                x_title.unwrap_or_else(|| exponent.x.label().words).into(),
                Field { line: facts::exponent(fit).into(), value: Some(fit.exponent()) },
                format!("{} – {}", si(fit.range.0), si(fit.range.1)).into(),
                fit.slope.n.to_string().into(),
            ];
            page.run_fields(run, fields)
        }));
    }
    if table.rows.is_empty() {
        return Vec::new();
    }
    let about = "Exponents b of y ∝ xᵇ, fitted to the cells whose fixed cost is at most a tenth of the time: 1 is linear. The interval is that of \
                 95 % over visits, or the extremes with one cell left out where figures are exact.";
    vec![Block::paragraph(about), Block::Table(table)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{overlaid, written};
    use fathom_experiments::fixtures;

    #[test]
    fn every_exponent_has_a_row_in_each_run() {
        let html = written(SECTION.write, &fixtures::run());
        let rows = facts::exponents(&crate::testing::view()).len();
        assert!(rows > 10 && html.matches("<tr>").count() == rows + 1, "{html}");
        let mut rows_of_plot = html.split("<tr>").filter(|row| row.contains("#plot-uw-photons"));
        assert!(rows_of_plot.any(|row| row.contains(">caustics/trace<")), "{html}");
        assert_eq!(overlaid(SECTION.write).matches("<td>two</td>").count(), rows);
        assert_eq!(written(SECTION.write, &fixtures::all_skipped()), "");
    }
}
