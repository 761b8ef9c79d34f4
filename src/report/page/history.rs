//! Figures over commits: what changed where, and a small chart for each series.

use maud::{Markup, html};

use super::table::{table, words};
use super::{Page, PageSection, Tone};
use crate::axis::{Axis, tenth};
use crate::svg;
use fathom_record::Estimate;

pub const SECTION: PageSection = PageSection { id: "history", title: "History", write };

const SIZE_PX: [f64; 2] = [324.0, 150.0];
const LEFT_PX: f64 = 48.0;
const RIGHT_PX: f64 = 318.0;
const TOP_PX: f64 = 8.0;
const BOTTOM_PX: f64 = 126.0;

/// A history in the words of its tables.
#[derive(Clone, Debug, Default)]
pub struct HistoryOnPage {
    /// What was searched and what was found.
    pub headline: String,
    /// Sure changes first, each kind by size.
    pub rows: Vec<ChangeRow>,
    /// Series with changes first.
    pub charts: Vec<HistoryChart>,
    /// Series without a chart.
    pub not_shown: usize,
}

/// A change of a figure.
#[derive(Clone, Debug)]
pub struct ChangeRow {
    /// With its interval.
    pub size: String,
    /// For sorting.
    pub value: f64,
    pub tone: Tone,
    pub sure: bool,
    /// The two commits between which it changed.
    pub commits: String,
    pub days: String,
    /// Runs before and after.
    pub n: [usize; 2],
    /// Cell and figure.
    pub name: String,
    pub place: String,
}

/// A figure over runs.
#[derive(Clone, Debug)]
pub struct HistoryChart {
    /// Cell and figure.
    pub name: String,
    pub place: String,
    pub unit: String,
    /// Runs before the first that is drawn.
    pub earlier: usize,
    /// The fewest runs in which changes are looked for, where there are fewer.
    pub too_short: Option<usize>,
    pub points: Vec<HistoryPoint>,
    pub marks: Vec<HistoryMark>,
}

/// A run's figure.
#[derive(Clone, Debug)]
pub struct HistoryPoint {
    pub commit: String,
    /// Commit, day, value.
    pub told: String,
    /// In the unit that is shown.
    pub value: Estimate,
}

/// A change in a chart.
#[derive(Clone, Debug)]
pub struct HistoryMark {
    /// The first point of the new level.
    pub at: usize,
    pub tone: Tone,
    /// The two commits and the size.
    pub told: String,
}

fn write(page: &Page<'_>) -> Option<Markup> {
    let history = page.history.as_ref()?;
    Some(html! {
        p.lead { (history.headline) }
        @let (sure, possible): (Vec<&ChangeRow>, Vec<&ChangeRow>) = history.rows.iter().partition(|row| row.sure);
        @if !sure.is_empty() { (changes("Changes", &sure)) }
        @if !possible.is_empty() {
            details {
                summary { (possible.len()) " possible changes" }
                (changes("Possible changes", &possible))
            }
        }
        h3 { "Figures over commits" }
        p.lead {
            "A point is the median of a run, a bar its 95 % interval. Runs stand in the order of their commits' dates, equally far apart. "
            "A dashed line is a change, named below the chart. The vertical axis does not begin at 0."
        }
        div.multiples { @for one in &history.charts { (chart(one)) } }
        @if history.not_shown > 0 {
            p.faint { (history.not_shown) " more series are not drawn; fathom history show FILTER --out DIR draws those whose names hold FILTER." }
        }
    })
}

fn changes(name: &str, rows: &[&ChangeRow]) -> Markup {
    let heads = words(&["Figure", "Change", "Between the commits", "Days", "Runs", "Where"]);
    table(name, "sortable changes", &heads, &html! { @for row in rows { (row_markup(row)) } })
}

fn row_markup(row: &ChangeRow) -> Markup {
    html! {
        tr {
            th scope="row" { (row.name) }
            td data-v=(row.value) {
                (row.tone.chip(&row.size))
                @if !row.sure { " " span.faint { "possible" } }
            }
            td { (row.commits) }
            td { (row.days) }
            td { (row.n[0]) " + " (row.n[1]) }
            td.faint.where { (row.place) }
        }
    }
}

fn chart(one: &HistoryChart) -> Markup {
    let about = format!("{} ({}) over {} runs", one.name, one.unit, one.points.len());
    html! {
        figure.multiple {
            figcaption { b { (one.name) } br; span.faint { (one.place) } }
            p.axis-title { "↑ " @if one.unit.is_empty() { "value" } @else { (one.unit) } }
            @match drawing(one) {
                Some(content) => (svg::chart(SIZE_PX, &about, &content)),
                None => { p.faint { "No value can be drawn." } }
            }
            @if one.earlier > 0 { p.faint { (one.earlier) " earlier runs are not drawn." } }
            @if let Some(least) = one.too_short {
                p.faint { "Too short to be searched: " (one.points.len()) " runs, and " (least) " are needed." }
            }
            @if !one.marks.is_empty() {
                ul.fits { @for mark in &one.marks { li { span.(mark.tone.class()) { "┆ " } (mark.told) } } }
            }
        }
    }
}

/// None where no value is finite.
fn drawing(one: &HistoryChart) -> Option<Markup> {
    let values = one.points.iter().flat_map(|point| point.value.ends());
    let y = Axis::tight(values, [BOTTOM_PX, TOP_PX])?;
    let last = one.points.len().saturating_sub(1).max(1) as f64;
    let x = |at: f64| tenth(LEFT_PX + 6.0 + at / last * (RIGHT_PX - LEFT_PX - 12.0));
    Some(html! {
        (svg::y_axis(&y, [LEFT_PX, RIGHT_PX], ""))
        (ends(one))
        @for mark in &one.marks {
            line.change.(mark.tone.class()) x1=(x(mark.at as f64 - 0.5)) x2=(x(mark.at as f64 - 0.5)) y1=(TOP_PX) y2=(BOTTOM_PX) {
                title { (mark.told) }
            }
        }
        @for (at, point) in one.points.iter().enumerate() { (mark(x(at as f64), &y, point)) }
    })
}

fn mark(x: f64, y: &Axis, point: &HistoryPoint) -> Markup {
    let [low, high] = point.value.ends().map(|end| y.px_within(end));
    html! {
        line.whisker.run x1=(x) x2=(x) y1=(low) y2=(high) {}
        circle.mark.ink cx=(x) cy=(y.px_within(point.value.median)) r="2.5" data-tip=(point.told) { title { (point.told) } }
    }
}

/// The first and the last commit.
fn ends(one: &HistoryChart) -> Markup {
    let [first, last] = [one.points.first(), one.points.last()];
    html! {
        g.axis aria-hidden="true" {
            @if let Some(point) = first { text x=(LEFT_PX) y=(BOTTOM_PX + 18.0) { (point.commit) } }
            @if let Some(point) = last.filter(|_| one.points.len() > 1) {
                text x=(RIGHT_PX) y=(BOTTOM_PX + 18.0) text-anchor="end" { (point.commit) }
            }
        }
    }
}
