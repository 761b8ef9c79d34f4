//! Comparisons of two builds, drivers or environments: what `fathom compare` concluded, from the same records.

use maud::{Markup, html};

use super::table::{table, words};
use super::{Page, PageSection};
use crate::axis::{Axis, ScaleKind, tenth};
use crate::format::trim_zeros;

pub const SECTION: PageSection = PageSection { id: "compared", title: "Comparison", write };

const WIDTH_PX: f64 = 200.0;
const HEIGHT_PX: f64 = 26.0;
/// Changes are shown up to this share, or to the largest of the comparison.
const LEAST_SHOWN: f64 = 0.1;

/// How a reader takes a word: by a colour and a mark beside it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tone {
    Bad,
    Open,
    Neutral,
    Good,
}

impl Tone {
    pub(super) fn class(self) -> &'static str {
        match self {
            Tone::Bad => "bad",
            Tone::Open => "open",
            Tone::Neutral => "none",
            Tone::Good => "good",
        }
    }

    fn mark(self) -> &'static str {
        match self {
            Tone::Bad => "✕",
            Tone::Open => "?",
            Tone::Neutral => "–",
            Tone::Good => "✓",
        }
    }

    pub(super) fn chip(self, word: &str) -> Markup {
        html! { span.chip.(self.class()) { span aria-hidden="true" { (self.mark()) " " } (word) } }
    }
}

/// A comparison of two builds in the words of its tables.
#[derive(Clone, Debug)]
pub struct ComparisonOnPage {
    /// Its result and the counts of verdicts.
    pub headline: String,
    pub tone: Tone,
    pub sides: String,
    pub adapter: String,
    /// Changes of time up to this share count as none.
    pub threshold: f64,
    /// Names of the columns of `ComparisonRow::figures`.
    pub columns: Vec<&'static str>,
    /// Regressions first.
    pub rows: Vec<ComparisonRow>,
    pub notes: Vec<String>,
}

#[derive(Clone, Debug)]
pub struct ComparisonRow {
    pub cell: String,
    pub verdict: String,
    pub tone: Tone,
    pub change: Option<ChangeOnPage>,
    pub figures: Vec<String>,
}

/// Relative change of a time: 0.05 is 5 % slower.
#[derive(Clone, Copy, Debug)]
pub struct ChangeOnPage {
    pub share: f64,
    pub interval: Option<(f64, f64)>,
}

fn write(page: &Page<'_>) -> Option<Markup> {
    if page.comparisons.is_empty() {
        return None;
    }
    Some(html! { @for comparison in &page.comparisons { (one(comparison)) } })
}

fn one(comparison: &ComparisonOnPage) -> Markup {
    html! {
        h3 { (comparison.sides) }
        p { (comparison.tone.chip(&comparison.headline)) }
        p.faint { (comparison.adapter) }
        p.lead {
            "Change of the head's time against the base's, with its interval. Within the shaded part, "
            (percent(-comparison.threshold)) " to " (percent(comparison.threshold)) ", a change counts as none."
        }
        @let heads = html! { (words(&["Cell", "Verdict", "Change"])) (words(&comparison.columns)) };
        @let rows = html! { @for row in &comparison.rows { (row_markup(comparison, row)) } };
        (table("Compared cells", "sortable", &heads, &rows))
        details { summary { "Notes" } ul { @for note in &comparison.notes { li { (note) } } } }
    }
}

fn row_markup(comparison: &ComparisonOnPage, row: &ComparisonRow) -> Markup {
    html! {
        tr {
            th scope="row" { (row.cell) }
            td { (row.tone.chip(&row.verdict)) }
            @match row.change {
                Some(change) => { td data-v=(change.share) { (picture(comparison, change)) } }
                None => { td.faint { "no time" } }
            }
            @for figure in &row.figures { td { (figure) } }
        }
    }
}

/// The largest change that the comparison's axes show.
fn reach(comparison: &ComparisonOnPage) -> f64 {
    let changes = comparison.rows.iter().filter_map(|row| row.change);
    let ends = changes.flat_map(|change| {
        let (low, high) = change.interval.unwrap_or((change.share, change.share));
        [change.share.abs(), low.abs(), high.abs()]
    });
    ends.filter(|end| end.is_finite()).fold(LEAST_SHOWN, f64::max)
}

fn picture(comparison: &ComparisonOnPage, change: ChangeOnPage) -> Markup {
    let reach = reach(comparison);
    let axis = Axis::spanning(ScaleKind::Linear, [-reach, reach], [6.0, WIDTH_PX - 6.0]);
    let Some(axis) = axis else { return html! {} };
    let middle = HEIGHT_PX / 2.0;
    let [start, end, zero, at] = [-comparison.threshold, comparison.threshold, 0.0, change.share]
        .map(|value| axis.px_within(value));
    let tip = match change.interval {
        Some((low, high)) => {
            format!("{} ({} … {})", percent(change.share), percent(low), percent(high))
        }
        None => format!("{}, too few launches for an interval", percent(change.share)),
    };
    html! {
        svg.claim-axis role="img" aria-label=(tip) width=(WIDTH_PX) height=(HEIGHT_PX) {
            title { (tip) }
            rect.band x=(start) y="3" width=(tenth(end - start)) height=(HEIGHT_PX - 6.0) {}
            line.rule x1=(zero) x2=(zero) y1="0" y2=(HEIGHT_PX) {}
            @if let Some((low, high)) = change.interval {
                line.interval x1=(axis.px_within(low)) x2=(axis.px_within(high)) y1=(middle) y2=(middle) {}
            }
            circle.value cx=(at) cy=(middle) r="4" {}
        }
    }
}

/// `+5.1 %`, `0 %`.
fn percent(share: f64) -> String {
    let text = format!("{:.1}", 100.0 * share);
    let text = trim_zeros(&text);
    let sign = if share > 0.0 && text != "0" { "+" } else { "" };
    format!("{sign}{} %", if text == "-0" { "0" } else { text })
}
