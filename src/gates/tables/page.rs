//! A comparison on the HTML page, alone or beside runs.

use maud::{Markup, html};

use super::rows;
use crate::noise;
use crate::verdict::{CellVerdict, JudgedCell, Status, Verdicts};
use fathom_record::{Estimate, Interval};
use fathom_report::charts::strip;
use fathom_report::format::trim_zeros;
use fathom_report::page::parts::{table, words};
use fathom_report::page::{ComparisonOnPage, Page, Tone};

/// Columns of [`rows::cell`] that the page shows as text: all but cell and verdict.
const FIGURES: usize = 2;
/// Changes are shown up to this share, or to the largest of the comparison.
const LEAST_SHOWN: f64 = 0.1;

pub fn export(verdicts: &Verdicts<'_>) -> String {
    let mut page = Page::new(Vec::new());
    page.comparisons.push(on_page(verdicts));
    page.html()
}

/// What the page shows of a comparison, regressions first.
pub fn on_page(verdicts: &Verdicts<'_>) -> ComparisonOnPage {
    let [sides, adapter] = rows::sides(verdicts);
    let mut cells: Vec<&JudgedCell> = verdicts.cells.iter().collect();
    cells.sort_by_key(|cell| cell.verdict);
    let tone = match verdicts.status {
        Status::NoRegression => Tone::Good,
        Status::Regression => Tone::Bad,
        Status::CouldNotMeasure | Status::Inconclusive | Status::TimesNotJudged => Tone::Open,
    };
    let (threshold, reach) = (verdicts.comparison.header.settings.threshold, reach(&cells));
    let markup = html! {
        h3 { (sides) }
        @if let Some(noise) = noise::told(verdicts) { p { (noise) } }
        p { (tone.chip(&rows::headline(verdicts))) }
        p.faint { (adapter) }
        p.lead {
            "Change of the head's time against the base's, with its interval. Within the shaded part, "
            (percent(-threshold)) " to " (percent(threshold)) ", a change counts as none."
        }
        @let heads = html! { (words(&["Cell", "Verdict", "Change"])) (words(&rows::HEADER[FIGURES..])) };
        @let rows = html! { @for cell in cells { (row(cell, threshold, reach)) } };
        (table("Compared cells", "sortable", &heads, &rows))
        details { summary { "Notes" } ul { @for note in rows::notes(verdicts) { li { (note) } } } }
    };
    ComparisonOnPage { sides, markup }
}

fn row(cell: &JudgedCell, threshold: f64, reach: f64) -> Markup {
    html! {
        tr {
            th scope="row" { (cell.cell.to_string()) }
            td { (tone(cell.verdict).chip(&cell.verdict.to_string())) }
            @match &cell.time {
                Some(time) => { td data-v=(time.change.median) { (picture(&time.change, threshold, reach)) } }
                None => { td.faint { "no time" } }
            }
            @for figure in &rows::cell(cell)[FIGURES..] { td { (figure) } }
        }
    }
}

fn tone(verdict: CellVerdict) -> Tone {
    use CellVerdict::*;
    match verdict {
        Slower | LessAccurate | FasterButLessAccurate | Costlier => Tone::Bad,
        Failed | NotMeasured | Inconclusive => Tone::Open,
        NotJudged | New => Tone::Neutral,
        Faster | Cheaper | Same => Tone::Good,
    }
}

/// The largest change that the comparison's axes show.
fn reach(cells: &[&JudgedCell]) -> f64 {
    let times = cells.iter().filter_map(|cell| cell.time.as_ref());
    let ends = times.flat_map(|time| {
        let [low, high] = time.change.ends();
        [time.change.median.abs(), low.abs(), high.abs()]
    });
    ends.filter(|end| end.is_finite()).fold(LEAST_SHOWN, f64::max)
}

/// A change of time on an axis that all cells share.
fn picture(change: &Estimate, threshold: f64, reach: f64) -> Markup {
    let median = percent(change.median);
    let tip = match change.interval {
        Some(Interval { low, high }) => {
            format!("{median} ({} … {})", percent(low), percent(high))
        }
        None => format!("{median}, too few launches for an interval"),
    };
    strip([-reach, reach], Interval { low: -threshold, high: threshold }, change, None, &tip)
}

/// `+5.1 %`, `0 %`.
fn percent(share: f64) -> String {
    let text = format!("{:.1}", 100.0 * share);
    let text = trim_zeros(&text);
    let sign = if share > 0.0 && text != "0" { "+" } else { "" };
    format!("{sign}{} %", if text == "-0" { "0" } else { text })
}
