//! How far the run can be trusted: its clocks, the cost and precision of its times, and how they moved while it ran.

use itertools::Itertools;
use maud::{Markup, PreEscaped, html};

use super::parts::{numbers, table, words};
use super::{Fold, Page, PageRun, PageSection};
use crate::ReportView;
use crate::axis::{Scale, ScaleKind};
use crate::charts::points::{Point, PointChart, Series};
use crate::charts::style::{self, Marker};
use crate::format::{NS_PER_MS, mebibytes, percent, three};
use crate::noise::RunVerdict;
use crate::trust::{self, TimedSample};
use fathom_base::statistics;
use fathom_record::{AuditRow, Clock, Estimate, Interval, PassKind, Rejection, Run};

pub const SECTION: PageSection = PageSection {
    id: "trust",
    title: "Trust",
    question: "Which clocks were used, how precise are the times, did the machine drift?",
    fold: Fold::Folded,
    write,
};

const CHART_PX: (u32, u32) = (560, 260);
/// Spans of time whose samples are a mark.
const SPANS: usize = 24;

fn write(page: &Page<'_>) -> Option<Markup> {
    let runs: Vec<(&PageRun<'_>, &Run)> =
        page.runs.iter().filter_map(|run| Some((run, trust::worst(run.view)?))).collect();
    if runs.is_empty() {
        return None;
    }
    Some(html! {
        @for (on_page, run) in runs {
            @if page.is_overlay() { h3 { (on_page.label) } }
            p { b { (trust::verdict(run)) } " " "Clock: " (trust::conditions(run)) "." }
            @if on_page.view.runs.len() > 1 { (sittings(on_page.view)) }
            (audit(run))
            (over_time(&trust::samples_by_time(on_page.view)))
            (facts(on_page.view, run))
        }
    })
}

/// What each sitting of a run that was resumed or merged was timed by.
fn sittings(view: &ReportView<'_>) -> Markup {
    let cells = view.entries().filter_map(|entry| entry.run).counts_by(std::ptr::from_ref::<Run>);
    html! {
        p.faint { "The run was measured in " (view.runs.len()) " sittings. The audit and the costs below are those of the sitting with the least reliable clocks." }
        @let heads = html! {
            (words(&["Started", "Machine"])) (numbers(&["Cells"])) (words(&["Clock", "Can it be trusted?"]))
        };
        @let rows = html! {
            @for run in &view.runs {
                tr {
                    th scope="row" { (run.started_at) }
                    td { (run.conditions.host.as_deref().unwrap_or("–")) }
                    td.number { (cells.get(&std::ptr::from_ref(*run)).copied().unwrap_or(0)) }
                    td { (trust::conditions(run)) }
                    td { (trust::verdict(run)) }
                }
            }
        };
        (table("Sittings", "", &heads, &rows))
    }
}

fn audit(run: &Run) -> Markup {
    html! {
        @if !run.audit.is_empty() {
            p.faint { "Each clock compared with the host clock, for a kernel of N and of 2 N work:" }
            @let heads = html! {
                (words(&["Clock", "Pass", "In its command buffer"]))
                (numbers(&["Clock (ms)", "Host (ms)", "Clock / host", "2 N / N"]))
                (words(&["Verdict", "Why"]))
            };
            (table("Clock audit", "", &heads, &html! { @for row in &run.audit { (audit_row(row)) } }))
        }
    }
}

fn audit_row(row: &AuditRow) -> Markup {
    let (class, verdict) = if row.sound { ("good", "✓ sound") } else { ("bad", "✕ unusable") };
    html! {
        tr {
            td { (row.clock.name()) }
            td { (row.pass) }
            td { (row.context) }
            td.number { (three(row.clock_ns / NS_PER_MS)) }
            td.number { (three(row.host_ns / NS_PER_MS)) }
            td.number { (format!("{:.3}", row.ratio)) }
            td.number { (format!("{:.2}", row.doubling)) }
            td { span.chip.(class) { (verdict) } }
            td { (row.reason) }
        }
    }
}

/// Only timestamps measure the frame apart from its stages.
fn has_timestamps(view: &ReportView<'_>) -> bool {
    view.runs.iter().any(|run| run.clocks.values().contains(&Clock::Timestamp))
}

/// How frame times moved: the median and the middle half of all samples of each span of time, as per cent off the median of their cells.
fn over_time(samples: &[TimedSample]) -> Markup {
    let Some(last) = samples.last() else { return html! {} };
    let index = |sample: &&TimedSample| {
        ((sample.at_s / last.at_s.max(f64::MIN_POSITIVE) * SPANS as f64) as usize).min(SPANS - 1)
    };
    let spans = samples.iter().chunk_by(|sample| index(sample));
    let points = spans.into_iter().map(|(_, span)| point(&span.collect_vec())).collect();
    let series = Series {
        name: String::new(),
        remarks: Vec::new(),
        color: style::color(0),
        marker: Marker::of(0),
        points,
        is_joined: false,
        fit: None,
    };
    let scales = [series.xs().collect_vec(), series.ys().collect_vec()]
        .map(|values| Scale::fit(ScaleKind::Linear, values));
    let [Some(x), Some(y)] = scales else { return html! {} };
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
    html! {
        figure {
            div.scroll { (PreEscaped(svg)) }
            figcaption {
                "Frame times off the medians of their cells: a dot is the median over a span of time, its line the middle half of the samples. "
                (samples.len()) " samples."
            }
        }
    }
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

fn facts(view: &ReportView<'_>, run: &Run) -> Markup {
    let costs = run.submit_cost_ns.iter();
    let costs = costs.map(|(kind, ns)| submission(*kind, *ns)).join(", ");
    html! {
        ul.facts {
            @for fact in trust::facts(view) { li { (fact.about) ": " (fact.words) "." } }
            @if view.timed().next().is_some() { li { (accounting(view)) } }
            @if let Some(drift) = RunVerdict::of(view).and_then(|verdict| verdict.drift) {
                li {
                    "Drift of frame times: " (drift.words()) ", n = " (drift.per_minute.n) " spans of time. Median slope over all pairs of "
                    "spans (Sen 1968) of the median change of the cells that both have; spans of 10 s or more are taken for independent."
                }
            }
            li { (rejected(view)) }
            @if !costs.is_empty() { li { "Cost of a submission as the audit measured it: " (costs) "." } }
            @if let Some(set_up) = set_up(view) { li { (set_up) } }
            @if let Some(bytes) = view.ends.iter().filter_map(|end| end.peak_memory_bytes).max() {
                li { "Peak memory of the process: " (mebibytes(bytes)) "." }
            }
            @if view.ends.last().is_none_or(|end| end.interrupted) { li { "The run ended early. What was measured until then is shown." } }
            @for note in &run.notes { li { "Note: " (note.text) "." } }
        }
    }
}

fn submission(kind: PassKind, ns: f64) -> String {
    format!("{kind} {} ms", three(ns / NS_PER_MS))
}

fn accounting(view: &ReportView<'_>) -> String {
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
fn rejected(view: &ReportView<'_>) -> String {
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

fn set_up(view: &ReportView<'_>) -> Option<String> {
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
    use fathom_record::{Cell, FaultKind, Profile, RejectedFrames};

    #[test]
    fn the_first_sentence_says_whether_the_clocks_can_be_trusted() {
        let mut run = fixtures::header(Profile::Quick);
        assert!(
            trust::verdict(&run)
                .starts_with("The clocks can be trusted: passes of the kind compute")
        );
        run.clocks.insert(PassKind::Compute, Clock::Timestamp);
        assert!(trust::verdict(&run).starts_with("The clock of compute passes cannot be trusted"));
        run.audit.clear();
        assert!(
            trust::verdict(&run).contains("compute and render passes can be trusted is not known")
        );
    }

    #[test]
    fn the_section_holds_audit_charts_and_facts() {
        let text = written(write, &fixtures::run());
        for expected in [
            "✕ unusable",
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
        let text = over_time(&samples).into_string();
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
        let text = written(write, &records);
        assert!(
            text.contains("Frames rejected: 6 (zero duration), 6 (stale timestamps)."),
            "{text}"
        );
    }
}
