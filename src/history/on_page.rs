//! A history as a section of the page.

use itertools::Itertools;
use maud::{Markup, html};

use super::changes::LEAST_RUNS;
use super::findings::{Change, Findings};
use super::run::FRAME;
use super::stored::{Point, Series, StoredRuns};
use super::tables;
use fathom_experiments::words as terms;
use fathom_report::axis::{Axis, tenth};
use fathom_report::format::NS_PER_MS;
use fathom_report::page::parts::{Tone, table, words};
use fathom_report::svg;

/// Charts of a page. A page of as many charts of as many points stays below 5 MB.
const MOST_CHARTS: usize = 60;
/// Latest runs of a chart.
const MOST_POINTS: usize = 200;

const SIZE_PX: [f64; 2] = [324.0, 150.0];
const LEFT_PX: f64 = 48.0;
const RIGHT_PX: f64 = 318.0;
const TOP_PX: f64 = 8.0;
const BOTTOM_PX: f64 = 126.0;

/// Sure changes first, each kind by size; charts of series with changes first.
pub fn on_page(stored: &StoredRuns, findings: &Findings) -> Markup {
    let changed = findings.changes.iter().map(|change| change.series);
    let shown = changed.chain(0..stored.series.len()).unique().take(MOST_CHARTS);
    let (sure, possible): (Vec<&Change>, Vec<&Change>) =
        findings.changes.iter().partition(|change| change.is_sure());
    let not_shown = stored.series.len().saturating_sub(MOST_CHARTS);
    html! {
        p.lead { (tables::headline(stored, findings)) }
        @if !sure.is_empty() { (changes(stored, "Changes", &sure)) }
        @if !possible.is_empty() {
            details {
                summary { (possible.len()) " possible changes" }
                (changes(stored, "Possible changes", &possible))
            }
        }
        h3 { "Figures over commits" }
        p.lead {
            "A point is the median of a run, a bar its 95 % interval. Runs stand in the order of their commits' dates, equally far apart. "
            "A dashed line is a change, named below the chart. The vertical axis does not begin at 0."
        }
        div.multiples { @for place in shown { (chart(stored, findings, place)) } }
        @if not_shown > 0 {
            p.faint { (not_shown) " more series are not drawn; fathom history show FILTER --out DIR draws those whose names hold FILTER." }
        }
    }
}

fn changes(stored: &StoredRuns, about: &str, changes: &[&Change]) -> Markup {
    let heads = words(&["Figure", "Change", "Between the commits", "Days", "Runs", "Where"]);
    let rows = html! { @for change in changes { (row(stored, change)) } };
    table(about, "sortable changes", &heads, &rows)
}

fn row(stored: &StoredRuns, change: &Change) -> Markup {
    let series = &stored.series[change.series];
    let [before, after] = change.runs.map(|run| &stored.runs[run]);
    html! {
        tr {
            th scope="row" { (name(series)) }
            td data-v=(change.size.estimate().median) {
                (tone(series, change).chip(&tables::size(change, series)))
                @if !change.is_sure() { " " span.faint { "possible" } }
            }
            td { (tables::commits(before, after)) }
            td { (before.day()) " → " (after.day()) }
            td { (change.n[0]) " + " (change.n[1]) }
            td.faint.where { (series.key.place()) }
        }
    }
}

/// Longer times and larger errors are worse; of what is not sure neither is said.
fn tone(series: &Series, change: &Change) -> Tone {
    let worse = if series.key.is_time() {
        change.size.estimate().median > 0.0
    } else {
        series.points[change.at].value.median.abs()
            > series.points[change.at - 1].value.median.abs()
    };
    match (change.is_sure(), worse) {
        (false, _) => Tone::Open,
        (true, true) => Tone::Bad,
        (true, false) => Tone::Good,
    }
}

/// Cell and figure; figures that are no times in words.
fn name(series: &Series) -> String {
    let figure = &series.key.figure;
    let told = if figure.figure == FRAME || series.key.is_time() {
        figure.figure.to_string()
    } else {
        terms::figure(&figure.figure).words
    };
    format!("{} {told}", figure.cell)
}

/// A series over its latest runs.
struct Chart<'a> {
    stored: &'a StoredRuns,
    series: &'a Series,
    points: &'a [Point],
    /// In those runs, each with the place of the first point of its new level.
    changes: Vec<(usize, &'a Change)>,
}

fn chart(stored: &StoredRuns, findings: &Findings, place: usize) -> Markup {
    let series = &stored.series[place];
    let (runs, name, unit) = (series.points.len(), name(series), tables::unit(series));
    let earlier = runs.saturating_sub(MOST_POINTS);
    let points = &series.points[earlier..];
    let changes = findings.of_series(place).into_iter().filter(|change| change.at > earlier);
    let changes = changes.map(|change| (change.at - earlier, change)).collect();
    let chart = Chart { stored, series, points, changes };
    let about = format!("{name} ({unit}) over {} runs", points.len());
    html! {
        figure.multiple {
            figcaption { b { (name) } br; span.faint { (series.key.place()) } }
            p.axis-title { "↑ " @if unit.is_empty() { "value" } @else { (unit) } }
            @match chart.drawing() {
                Some(content) => (svg::chart(SIZE_PX, &about, &content)),
                None => { p.faint { "No value can be drawn." } }
            }
            @if earlier > 0 { p.faint { (earlier) " earlier runs are not drawn." } }
            @if runs < LEAST_RUNS {
                p.faint { "Too short to be searched: " (runs) " runs, and " (LEAST_RUNS) " are needed." }
            }
            @if !chart.changes.is_empty() {
                ul.fits { @for (_, change) in &chart.changes { li { span.(tone(series, change).class()) { "┆ " } (chart.told(change)) } } }
            }
        }
    }
}

impl Chart<'_> {
    /// None where no value is finite.
    fn drawing(&self) -> Option<Markup> {
        let factor = if self.series.key.is_time() { 1.0 / NS_PER_MS } else { 1.0 };
        let values = || self.points.iter().map(|point| point.value.scaled(factor));
        let y = Axis::tight(values().flat_map(|value| value.ends()), [BOTTOM_PX, TOP_PX])?;
        let last = self.points.len().saturating_sub(1).max(1) as f64;
        let x = |at: f64| tenth(LEFT_PX + 6.0 + at / last * (RIGHT_PX - LEFT_PX - 12.0));
        Some(html! {
            (svg::y_axis(&y, [LEFT_PX, RIGHT_PX], ""))
            (self.commits())
            @for (at, change) in &self.changes {
                @let x = x(*at as f64 - 0.5);
                line.change.(tone(self.series, change).class()) x1=(x) x2=(x) y1=(TOP_PX) y2=(BOTTOM_PX) {
                    title { (self.told(change)) }
                }
            }
            @for (at, (point, value)) in self.points.iter().zip(values()).enumerate() {
                @let (x, tip) = (x(at as f64), self.tip(point));
                @let [low, high] = value.ends().map(|end| y.px_within(end));
                line.whisker.run x1=(x) x2=(x) y1=(low) y2=(high) {}
                circle.mark.ink cx=(x) cy=(y.px_within(value.median)) r="2.5" data-tip=(tip) { title { (tip) } }
            }
        })
    }

    /// The first and the last.
    fn commits(&self) -> Markup {
        let commit = |point: &Point| self.stored.runs[point.run].short_commit();
        html! {
            g.axis aria-hidden="true" {
                @if let Some(point) = self.points.first() { text x=(LEFT_PX) y=(BOTTOM_PX + 18.0) { (commit(point)) } }
                @if let [_, .., point] = self.points {
                    text x=(RIGHT_PX) y=(BOTTOM_PX + 18.0) text-anchor="end" { (commit(point)) }
                }
            }
        }
    }

    /// Commit, day, value.
    fn tip(&self, point: &Point) -> String {
        let run = &self.stored.runs[point.run];
        format!(
            "{} of {}: {} {}, n = {}",
            run.short_commit(),
            run.day(),
            tables::value(self.series, &point.value),
            tables::unit(self.series),
            point.value.n
        )
    }

    /// The two commits and the size.
    fn told(&self, change: &Change) -> String {
        let [before, after] = change.runs.map(|run| &self.stored.runs[run]);
        format!("{}: {}", tables::commits(before, after), tables::size(change, self.series))
    }
}
