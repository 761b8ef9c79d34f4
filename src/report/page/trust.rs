//! How far the run can be trusted: its clocks, the cost and precision of its times, and how they moved while it ran.

use super::{Fold, Page, PageSection};
use crate::Report;
use crate::axis::{Scale, ScaleKind};
use crate::charts::points::{Point, PointChart, Series};
use crate::charts::style::{self, Marker};
use crate::document::{self, Block, ColumnKind, Line, Span, Table, Tone};
use crate::facts;
use crate::format::{NS_PER_MS, mebibytes, percent, three};
use crate::noise;
use crate::trust::{self, TimedSample};
use fathom_base::statistics;
use fathom_record::{AuditRow, Clock, Estimate, Interval, PassKind, Rejection, Run};
use itertools::Itertools;

pub const SECTION: PageSection = PageSection {
    id: "trust",
    title: "Trust",
    question: "Which clocks were used, how precise are the times, did the machine drift?",
    fold: Fold::Folded,
    write: |page| document::html_if_any(parts(page)),
};

const CHART_PX: (u32, u32) = (560, 260);
/// Spans of time whose samples are a mark.
const SPANS: usize = 24;

fn parts(page: &Page<'_>) -> Vec<Block> {
    let mut parts = Vec::new();
    for on_page in &page.runs {
        let view = on_page.view;
        let Some(run) = trust::worst(view) else { continue };
        parts.extend(page.heading(on_page));
        let verdict = Line::from(Span::Bold(trust::verdict(run)));
        parts.push(Block::Paragraph(verdict.and(format!(" Clock: {}.", trust::conditions(run)))));
        if view.runs.len() > 1 {
            let machines = view.runs.iter().map(|run| &run.conditions.host).unique().count();
            parts.push(Block::paragraph(format!(
                "The run was measured in {} sessions on {machines} machine(s). The audit and the costs below are those of the session \
                 with the least reliable clocks.",
                view.runs.len()
            )));
        }
        if !run.audit.is_empty() {
            let about =
                "Each clock compared with the host clock, for a kernel of N and of 2 N work:";
            parts.extend([Block::paragraph(about), Block::Table(audit(run))]);
        }
        parts.extend(over_time(&trust::samples_by_time(view)));
        parts.push(Block::list(details(view, run)));
    }
    parts
}

fn audit(run: &Run) -> Table {
    let columns = [
        "Clock",
        "Pass",
        "In its command buffer",
        "Clock (ms)",
        "Host (ms)",
        "Clock / host",
        "2 N / N",
        "Verdict",
        "Why",
    ];
    let row = |row: &AuditRow| {
        let sound = if row.sound { (Tone::Good, "sound") } else { (Tone::Bad, "unusable") };
        [
            row.clock.name().into(),
            row.pass.to_string().into(),
            row.context.to_string().into(),
            three(row.clock_ns / NS_PER_MS).into(),
            three(row.host_ns / NS_PER_MS).into(),
            format!("{:.3}", row.ratio).into(),
            format!("{:.2}", row.doubling).into(),
            Span::Chip(sound.0, sound.1.to_owned()).into(),
            Line::from(row.reason.as_str()),
        ]
    };
    Table::new("Clock audit", columns)
        .with(ColumnKind::Numbers, &columns[3..7])
        .with_rows(run.audit.iter().map(row))
}

/// Only timestamps measure the frame apart from its stages.
fn has_timestamps(view: &Report<'_>) -> bool {
    view.runs.iter().any(|run| run.clocks.values().contains(&Clock::Timestamp))
}

/// How frame times moved: the median and the middle half of all samples of each span of time, as per cent off the median of their cells.
fn over_time(samples: &[TimedSample]) -> Vec<Block> {
    let Some(last) = samples.last() else { return Vec::new() };
    let index = |sample: &&TimedSample| {
        ((sample.at_s / last.at_s.max(f64::MIN_POSITIVE) * SPANS as f64) as usize).min(SPANS - 1)
    };
    let spans = samples.iter().chunk_by(|sample| index(sample));
    let points = spans.into_iter().map(|(_, span)| point(&span.collect_vec())).collect();
    let series = Series {
        name: String::new(),
        remarks: Vec::new(),
        color: style::color(0),
        marker: Marker::nth(0),
        points,
        is_joined: false,
        fit: None,
    };
    let scales = [series.xs().collect_vec(), series.ys().collect_vec()]
        .map(|values| Scale::fit(ScaleKind::Linear, values));
    let [Some(x), Some(y)] = scales else { return Vec::new() };
    let chart = PointChart {
        title: String::new(),
        x_title: "time since the first sample (min)".to_owned(),
        y_title: "off the cell's median (%)".to_owned(),
        x,
        y,
        series: vec![series],
        changes: Vec::new(),
    };
    let svg = chart.svg(CHART_PX, "Frame times in the order in which they were measured");
    let words = format!(
        "Frame times off the medians of their cells: a dot is the median over a span of time, its line the middle half of the samples. \
         {} samples.",
        samples.len()
    );
    vec![Block::Chart(svg), Block::paragraph(words)]
}

/// The samples of a span of time.
fn point(samples: &[&TimedSample]) -> Point {
    let all = |of: fn(&TimedSample) -> f64| samples.iter().map(|sample| of(sample)).collect_vec();
    let minutes = statistics::median(&all(|sample| sample.at_s / 60.0));
    let off = all(|sample| 100.0 * (sample.relative - 1.0));
    let [low, median, high] = [0.25, 0.5, 0.75].map(|share| statistics::quantile(&off, share));
    Point {
        x: minutes,
        y: Estimate { median, interval: Some(Interval { low, high }), n: off.len() },
        tip: format!("{} min: median {median:+.2} %, n = {}", three(minutes), off.len()),
        category: None,
        published: None,
    }
}

fn details(view: &Report<'_>, run: &Run) -> Vec<String> {
    let costs = run.submit_cost_ns.iter();
    let costs = costs.map(|(kind, ns)| submission(*kind, *ns)).join(", ");
    let drift = view.verdict.as_ref().and_then(|verdict| verdict.drift).map(|drift| {
        format!(
            "Drift of frame times: {}, n = {} spans of time. Median slope over all pairs of spans (Sen 1968) of the median change of the \
             cells that both have; spans of 10 s or more are taken for independent.",
            noise::drift(&drift),
            drift.per_minute.n
        )
    });
    let peak = view.ends.iter().filter_map(|end| end.peak_memory_bytes).max();
    let mut all =
        trust::facts(view).map(|(about, words)| format!("{about}: {words}.")).collect_vec();
    let others = [
        view.timed().next().map(|_| accounting(view)),
        drift,
        Some(rejected(view)),
        (!costs.is_empty())
            .then(|| format!("Cost of a submission as the audit measured it: {costs}.")),
        set_up(view),
        peak.map(|bytes| format!("Peak memory of the process: {}.", mebibytes(bytes))),
        facts::ended_early(view),
    ];
    all.extend(others.into_iter().flatten());
    all.extend(run.notes.iter().map(|note| format!("Note: {}.", note.text)));
    all
}

fn submission(kind: PassKind, ns: f64) -> String {
    format!("{kind} {} ms", three(ns / NS_PER_MS))
}

fn accounting(view: &Report<'_>) -> String {
    if !has_timestamps(view) {
        return "Stages + gaps against the frame: each pass was submitted and timed alone and the frame is their sum, so the two \
                cannot differ here."
            .to_owned();
    }
    let errors = view.timed().map(|(_, measured)| measured.frame.accounting_error).collect_vec();
    let worst = errors.iter().copied().fold(0.0, f64::max);
    format!(
        "Stages + gaps against the frame: {} off in the median cell, {} at worst.",
        percent(statistics::median(&errors)),
        percent(worst)
    )
}

/// How many timed frames were not used, by reason.
fn rejected(view: &Report<'_>) -> String {
    let rejected = view.measured().flat_map(|(_, measured)| &measured.rejected);
    let mut reasons: Vec<(&Rejection, u32)> = Vec::new();
    for found in rejected.sorted_by(|a, b| a.rejection.cmp(&b.rejection)) {
        match reasons.last_mut() {
            Some((reason, frames)) if *reason == &found.rejection => *frames += found.frames,
            _ => reasons.push((&found.rejection, found.frames)),
        }
    }
    if reasons.is_empty() {
        return "Frames rejected: none.".to_owned();
    }
    let words = reasons.iter().map(|(reason, frames)| format!("{frames} ({reason})")).join(", ");
    format!("Frames rejected: {words}.")
}

fn set_up(view: &Report<'_>) -> Option<String> {
    let wall_s: f64 = view.ends.iter().map(|end| end.measuring_wall_s).sum();
    let set_up_s: f64 = view.ends.iter().map(|end| end.set_up_s).sum();
    view.ends.last()?;
    let parts = trust::set_up_parts(view).into_iter();
    let parts = parts.map(|(part, s)| format!("{part} {} s", three(s))).join(", ");
    let parts = if parts.is_empty() { parts } else { format!(": {parts}") };
    Some(format!("Measuring took {} s, set-up {} s{parts}.", three(wall_s), three(set_up_s)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::written;
    use fathom_experiments::fixtures;
    use fathom_record::{Cell, FaultKind, RejectedFrames};

    #[test]
    fn the_section_holds_audit_charts_and_facts() {
        let text = written(SECTION.write, &fixtures::run());
        for expected in [
            "✕ </span>unusable",
            "begins late",
            "time since the first sample (min)",
            "Frames rejected: none",
            "set-up 21.0 s: pipelines 20.0 s, audit 1.00 s",
        ] {
            assert!(text.contains(expected), "{expected}");
        }
    }

    #[test]
    fn samples_over_time_are_drawn_by_spans() {
        let sample =
            |i: usize| TimedSample { at_s: i as f64, relative: 1.0 + (i % 7) as f64 / 100.0 };
        let samples: Vec<TimedSample> = (0..10_000).map(sample).collect();
        let text = document::html(&over_time(&samples)).into_string();
        assert!(text.contains("10000 samples") && text.contains("median +3.00 %"), "{text}");
        assert_eq!(text.matches("<title>").count(), SPANS);
    }

    #[test]
    fn rejected_frames_are_added_up_by_reason() {
        let mut records = fixtures::run();
        for measured in fixtures::cells(&mut records).filter_map(Cell::measured_mut).take(3) {
            let of = |fault: FaultKind| RejectedFrames { rejection: fault.into(), frames: 2 };
            measured.rejected = vec![of(FaultKind::Stale), of(FaultKind::Zero)];
        }
        let text = written(SECTION.write, &records);
        assert!(
            text.contains("Frames rejected: 6 (zero duration), 6 (stale timestamps)."),
            "{text}"
        );
    }
}
