//! A history as a document: what changed where, and on a page a small chart for each series.

use itertools::Itertools;

use super::findings::{Certainty, HistoryChanges, SeriesChange};
use super::run::FRAME;
use super::stored::{FigureSeries, RunValue, StoredRuns};
use super::tables;
use fathom_experiments::words;
use fathom_judge::change_points::MIN_RUNS;
use fathom_report::axis::Scale;
use fathom_report::charts::points::{self, ChangeLine, PointChart};
use fathom_report::charts::style::{self, Marker};
use fathom_report::document::{Block, Field, Span, Table, Tone};

/// Charts of a page. A page of as many charts of as many points stays below 5 MB.
const MAX_CHARTS: usize = 60;
/// Latest runs of a chart.
const MAX_POINTS: usize = 200;
const SIZE_PX: (u32, u32) = (324, 170);

/// What was searched and what was found: sure changes first, each kind by size.
pub fn changes(stored: &StoredRuns, findings: &HistoryChanges) -> Vec<Block> {
    let of = |kind: Certainty| {
        let changes = findings.changes.iter().filter(|change| change.certainty() == kind);
        let rows: Vec<[Field; 8]> = changes.map(|change| row(stored, change)).collect();
        let heads = ["Figure", "Change", "", "Commits", "Days", "Runs", "Where", "Machine"];
        let table = Table::new(kind.to_string(), heads).with_class("sortable changes");
        (rows.len(), (!rows.is_empty()).then(|| Block::Table(table.with_rows(rows))))
    };
    let [(_, sure), (possible, unsure), (drifted, drift)] =
        [Certainty::Sure, Certainty::Possible, Certainty::Drift].map(of);
    let fold =
        |words: String, part: Option<Block>| part.map(|part| Block::Fold(words.into(), vec![part]));
    let parts = [
        Some(Block::paragraph(tables::headline(stored, findings))),
        sure,
        fold(format!("{possible} possible changes"), unsure),
        fold(format!("{drifted} of the machine: the controls share them"), drift),
    ];
    parts.into_iter().flatten().collect()
}

/// With a small chart for each series; those with changes first.
pub fn on_page(stored: &StoredRuns, findings: &HistoryChanges) -> Vec<Block> {
    let changed = findings.changes.iter().map(|change| change.series);
    let shown = changed.chain(0..stored.series.len()).unique().take(MAX_CHARTS);
    let not_shown = stored.series.len().saturating_sub(MAX_CHARTS);
    let mut parts = changes(stored, findings);
    parts.push(Block::Heading("Figures over commits".into()));
    parts.push(Block::paragraph(
        "A point is the median of a run, a bar its 95 % interval. Runs stand in the order of their commits, equally far apart. \
         A dashed line is a change, named below the chart. The vertical axis does not begin at 0.",
    ));
    parts.push(Block::Grid(shown.map(|place| chart(stored, findings, place)).collect()));
    if not_shown > 0 {
        parts.push(Block::paragraph(format!(
            "{not_shown} more series are not drawn; fathom history show FILTER --out DIR draws those whose names hold FILTER."
        )));
    }
    parts
}

fn row(stored: &StoredRuns, change: &SeriesChange) -> [Field; 8] {
    let series = &stored.series[change.series];
    let [before, after] = change.runs.map(|run| &stored.runs[run]);
    let size = Span::Chip(tone(series, change), tables::size(change, series));
    [
        name(series).into(),
        Field { value: Some(change.size.estimate().median), line: size.into() },
        change.certainty().to_string().into(),
        tables::commits(before, after).into(),
        format!("{} → {}", before.day(), after.day()).into(),
        format!("{} + {}", change.n[0], change.n[1]).into(),
        series.key.place().into(),
        tables::machine(change).into(),
    ]
}

/// Longer times and larger errors are worse; of what is not sure neither is said.
fn tone(series: &FigureSeries, change: &SeriesChange) -> Tone {
    let worse = if series.key.is_time() {
        change.size.estimate().median > 0.0
    } else {
        series.points[change.point].value.median.abs()
            > series.points[change.point - 1].value.median.abs()
    };
    match (change.is_sure(), worse) {
        (false, _) => Tone::Open,
        (true, true) => Tone::Bad,
        (true, false) => Tone::Good,
    }
}

/// Cell and figure; figures that are no times in words.
fn name(series: &FigureSeries) -> String {
    let figure = &series.key.figure;
    let told = if *figure.figure == *FRAME || series.key.is_time() {
        figure.figure.to_string()
    } else {
        words::figure(&figure.figure).words
    };
    format!("{} {told}", figure.cell)
}

struct ChangeMark {
    /// The first point of the new level.
    point: usize,
    tone: Tone,
    /// The two commits and the size.
    text: String,
}

fn chart(stored: &StoredRuns, findings: &HistoryChanges, place: usize) -> Vec<Block> {
    let series = &stored.series[place];
    let earlier = series.points.len().saturating_sub(MAX_POINTS);
    let points = &series.points[earlier..];
    let changes = findings.in_series(place).into_iter().filter(|change| change.point > earlier);
    let marks = changes.map(|change| {
        let [before, after] = change.runs.map(|run| &stored.runs[run]);
        let text = format!("{}: {}", tables::commits(before, after), tables::size(change, series));
        ChangeMark { point: change.point - earlier, tone: tone(series, change), text }
    });
    let marks: Vec<ChangeMark> = marks.collect();
    let (name, unit) = (name(series), tables::unit(series));
    let about = format!("{name} ({unit}) over {} runs", points.len());
    let drawn = match drawing(stored, series, points, &marks) {
        Some(chart) => Block::Chart(chart.svg(SIZE_PX, &about)),
        None => Block::paragraph("No value can be drawn."),
    };
    let heads = [Span::Bold(name), Span::Faint(series.key.place())].map(Block::paragraph);
    let mut parts: Vec<Block> = heads.into_iter().chain([drawn]).collect();
    if earlier > 0 {
        parts.push(Block::paragraph(format!("{earlier} earlier runs are not drawn.")));
    }
    if series.points.len() < MIN_RUNS {
        parts.push(Block::paragraph(format!(
            "Too short to be searched: {} runs, and {MIN_RUNS} are needed.",
            points.len()
        )));
    }
    let line = |mark: ChangeMark| Span::Chip(mark.tone, mark.text);
    parts.push(Block::list(marks.into_iter().map(line)));
    parts
}

/// None where no value is finite.
fn drawing(
    stored: &StoredRuns,
    series: &FigureSeries,
    points: &[RunValue],
    marks: &[ChangeMark],
) -> Option<PointChart> {
    let factor = series.key.display_scale();
    let drawn = (0..).zip(points).map(|(at, point)| points::Point {
        x: f64::from(at),
        y: point.value.scaled(factor),
        tip: describe_point(stored, series, point),
        category: None,
        published: None,
    });
    let drawn: Vec<points::Point> = drawn.collect();
    let commit = |point: &RunValue| stored.runs[point.run].short_commit();
    let end = points.len().checked_sub(1)?;
    let names = [0, end].into_iter().dedup().map(|at| (at as f64, commit(&points[at])));
    let unit = tables::unit(series);
    let lines = marks.iter().map(|mark| ChangeLine {
        x: mark.point as f64 - 0.5,
        color: style::tone_color(mark.tone),
        tip: mark.text.clone(),
    });
    Some(PointChart {
        title: String::new(),
        x_title: String::new(),
        y_title: if unit.is_empty() { "value".to_owned() } else { unit },
        x: Scale::named([-0.5, end as f64 + 0.5], names),
        y: Scale::tight(drawn.iter().flat_map(|point| point.y.ends()))?,
        changes: lines.collect(),
        series: vec![points::Series {
            name: String::new(),
            remarks: Vec::new(),
            color: style::color(0),
            marker: Marker::nth(0),
            points: drawn,
            is_joined: false,
            fit: None,
        }],
    })
}

/// Commit, day, value.
fn describe_point(stored: &StoredRuns, series: &FigureSeries, point: &RunValue) -> String {
    let run = &stored.runs[point.run];
    format!(
        "{} of {}: {} {}, n = {}",
        run.short_commit(),
        run.day(),
        tables::value(series, &point.value),
        tables::unit(series),
        point.value.n
    )
}
