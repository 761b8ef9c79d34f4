//! How far the run can be trusted: its clocks, and the cost and precision of its times.

use std::collections::BTreeMap;

use super::{Fold, Page, PageSection};
use crate::Report;
use crate::document::{self, Block, ColumnKind, Line, Span, Table, Tone};
use crate::facts;
use crate::format::{NS_PER_MS, mebibytes, percent, three};
use crate::trust;
use fathom_base::statistics;
use fathom_record::{AuditRow, Clock, Rejection, Run};
use itertools::Itertools;

pub const SECTION: PageSection = PageSection {
    id: "trust",
    title: "Trust",
    question: "Which clocks were used, how precise are the times?",
    fold: Fold::Folded,
    write: |page| document::html_if_any(parts(page)),
};

/// What an interval is of, and what it is not of.
const OF_INTERVALS: &str = "An interval of 95 % is over visits to a cell, at least 10 s apart, and n counts visits: below four there is none. It says what \
    further minutes of this machine would give, in the states that the run met. It says nothing of another day, another machine or \
    another driver.";

fn parts(page: &Page<'_>) -> Vec<Block> {
    let mut parts = Vec::new();
    for on_page in &page.runs {
        let view = on_page.view;
        let Some(run) = trust::worst(view) else { continue };
        parts.extend(page.heading(on_page));
        if view.timed().any(|(_, measured)| !measured.frame.visits.is_empty()) {
            parts.push(Block::paragraph(OF_INTERVALS));
        }
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

fn details(view: &Report<'_>, run: &Run) -> Vec<String> {
    let costs = run.submit_cost_ns.iter();
    let costs = costs.map(|(kind, ns)| format!("{kind} {} ms", three(ns / NS_PER_MS))).join(", ");
    let peak = view.ends.iter().filter_map(|end| end.peak_memory_bytes).max();
    let mut all =
        trust::facts(view).map(|(about, words)| format!("{about}: {words}.")).collect_vec();
    let others = [
        view.timed().next().map(|_| accounting(view)),
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

fn accounting(view: &Report<'_>) -> String {
    // Only timestamps measure the frame apart from its stages.
    if !view.runs.iter().any(|run| run.clocks.values().contains(&Clock::Timestamp)) {
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
    let mut reasons = BTreeMap::<&Rejection, u32>::new();
    rejected.for_each(|of| *reasons.entry(&of.rejection).or_default() += of.frames);
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
    let frames_s: f64 = view.ends.iter().map(|end| end.measured_gpu_s).sum();
    let share = percent(frames_s / (wall_s + set_up_s).max(f64::MIN_POSITIVE));
    let (wall, set_up) = (three(wall_s), three(set_up_s));
    Some(format!(
        "Measuring took {wall} s, set-up {set_up} s{parts}. Frames took {share} of the time."
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::written;
    use fathom_experiments::fixtures;
    use fathom_record::{Cell, FaultKind, RejectedFrames};

    #[test]
    fn the_section_holds_audit_and_facts() {
        let text = written(SECTION.write, &fixtures::run());
        for expected in [
            "✕ </span>unusable",
            "begins late",
            "Frames rejected: none",
            "set-up 21.0 s: pipelines 20.0 s, audit 1.00 s",
        ] {
            assert!(text.contains(expected), "{expected}");
        }
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
