//! A history in the words and numbers of a page's section.

use itertools::Itertools;

use super::changes::LEAST_RUNS;
use super::findings::{Change, Findings};
use super::run::FRAME;
use super::stored::{Series, StoredRuns};
use super::tables;
use fathom_experiments::words;
use fathom_report::format::NS_PER_MS;
use fathom_report::page::{
    ChangeRow, HistoryChart, HistoryMark, HistoryOnPage, HistoryPoint, Tone,
};

/// Charts of a page. A page of as many charts of as many points stays below 5 MB.
const MOST_CHARTS: usize = 60;
/// Latest runs of a chart.
const MOST_POINTS: usize = 200;

pub fn on_page(stored: &StoredRuns, findings: &Findings) -> HistoryOnPage {
    let changed = findings.changes.iter().map(|change| change.series);
    let shown = changed.chain(0..stored.series.len()).unique().take(MOST_CHARTS);
    HistoryOnPage {
        headline: tables::headline(stored, findings),
        rows: findings.changes.iter().map(|change| row(stored, change)).collect(),
        charts: shown.map(|place| chart(stored, findings, place)).collect(),
        not_shown: stored.series.len().saturating_sub(MOST_CHARTS),
    }
}

fn row(stored: &StoredRuns, change: &Change) -> ChangeRow {
    let series = &stored.series[change.series];
    let [before, after] = change.runs.map(|run| &stored.runs[run]);
    ChangeRow {
        size: tables::size(change, series),
        value: change.size.estimate().median,
        tone: tone(series, change),
        sure: change.is_sure(),
        commits: tables::commits(before, after),
        days: format!("{} → {}", before.day(), after.day()),
        n: change.n,
        name: name(series),
        place: series.key.place(),
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
        words::figure(&figure.figure).words
    };
    format!("{} {told}", figure.cell)
}

fn chart(stored: &StoredRuns, findings: &Findings, place: usize) -> HistoryChart {
    let series = &stored.series[place];
    let first = series.points.len().saturating_sub(MOST_POINTS);
    let factor = if series.key.is_time() { 1.0 / NS_PER_MS } else { 1.0 };
    let points = series.points[first..].iter().map(|point| {
        let run = &stored.runs[point.run];
        HistoryPoint {
            commit: run.short_commit(),
            told: format!(
                "{} of {}: {} {}, n = {}",
                run.short_commit(),
                run.day(),
                tables::value(series, &point.value),
                tables::unit(series),
                point.value.n
            ),
            value: point.value.scaled(factor),
        }
    });
    let changes = findings.of_series(place).into_iter().filter(|change| change.at > first);
    let marks = changes.map(|change| {
        let [before, after] = change.runs.map(|run| &stored.runs[run]);
        HistoryMark {
            at: change.at - first,
            tone: tone(series, change),
            told: format!("{}: {}", tables::commits(before, after), tables::size(change, series)),
        }
    });
    HistoryChart {
        name: name(series),
        place: series.key.place(),
        unit: tables::unit(series),
        earlier: first,
        too_short: (series.points.len() < LEAST_RUNS).then_some(LEAST_RUNS),
        marks: marks.collect(),
        points: points.collect(),
    }
}
