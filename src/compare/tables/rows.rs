//! What terminal and Markdown say alike, as text.

use std::collections::BTreeSet;

use crate::compare::exact::{Difference, DifferenceScope, FigureKind};
use crate::compare::instructions::Counted;
use crate::compare::store::StoredComparison;
use crate::compare::time::CellTime;
use crate::compare::unpaired::{RunTime, Unpaired};
use crate::compare::verdict::{CellVerdict, GateState, JudgedCell, Status, Verdicts};
use crate::record::comparison::{ComparedBuild, Fault, Side};
use crate::report::format::{NS_PER_MS, mebibytes, si, three};

/// Columns of a table of cells.
pub const HEADER: [&str; 7] =
    ["cell", "verdict", "time, base", "change", "detectable", "instructions", "else"];

/// One cell of a table of cells.
pub fn cell(cell: &JudgedCell) -> [String; 7] {
    let time = cell.time.as_ref();
    let base = time
        .map(|time| in_ms(time.base_ns))
        .or(cell.unpaired.map(|unpaired| run_time(&unpaired.base)));
    [
        cell.cell.to_string(),
        cell.verdict.text().to_owned(),
        base.unwrap_or_else(none),
        time.map(change).or(cell.unpaired.as_ref().map(unpaired_change)).unwrap_or_else(none),
        time.and_then(|time| time.detectable)
            .map_or_else(none, |least| format!("{:.1} %", 100.0 * least)),
        cell.instructions.as_ref().map_or_else(none, instructions),
        remarks(cell).join("; "),
    ]
}

/// Of a comparison that was interrupted or killed.
pub const INCOMPLETE: &str = "measuring did not come to its end; go on with --resume";
/// What stands where nothing was measured.
pub const NONE: &str = "–";

fn none() -> String {
    NONE.to_owned()
}

/// A share as `+5.1 %`: with a sign, but without one that only hides a zero, and without digits that say nothing.
fn signed(share: f64, digits: usize) -> String {
    let percent = 100.0 * share;
    let digits = if percent.abs() >= 100.0 { 0 } else { digits };
    format!("{:+.digits$} %", rounded(percent, digits))
}

/// Rounded to so many digits; never −0.
fn rounded(value: f64, digits: usize) -> f64 {
    let scale = 10_f64.powi(digits as i32);
    (value * scale).round() / scale + 0.0
}

/// `+5.1 % (4.2 … 6.0)`.
fn change(time: &CellTime) -> String {
    let interval = match time.interval {
        Some((low, high)) => {
            format!("{:.1} … {:.1}", rounded(100.0 * low, 1), rounded(100.0 * high, 1))
        }
        None => "too few launches for an interval".to_owned(),
    };
    format!("{} ({interval})", signed(time.change, 1))
}

fn in_ms(ns: f64) -> String {
    format!("{} ms", three(ns / NS_PER_MS))
}

fn run_time(time: &RunTime) -> String {
    if time.is_resolved() {
        in_ms(time.ns.median)
    } else {
        format!("< {}", in_ms(time.resolution_ns))
    }
}

fn unpaired_change(unpaired: &Unpaired) -> String {
    match unpaired.change() {
        Some(change) => format!("{}, unpaired", signed(change, 1)),
        None => "below the clock's resolution".to_owned(),
    }
}

fn instructions(counted: &Counted) -> String {
    format!("{} {}", si(counted.base), signed(counted.ratio - 1.0, 2))
}

/// Exact differences and faults.
fn remarks(cell: &JudgedCell) -> Vec<String> {
    let differences = cell.differences.iter().map(difference);
    differences.chain(cell.faults.iter().map(fault)).collect()
}

/// `fragments 100 → 120 (+20.0 %)`.
pub fn difference(difference: &Difference) -> String {
    let Difference { figure, base, head, kind, .. } = difference;
    let value = |value: f64| match kind {
        FigureKind::Bytes => mebibytes(value as u64),
        FigureKind::Work | FigureKind::Counter => format!("{value:.0}"),
        FigureKind::Error | FigureKind::Quantity if value.is_finite() => three(value),
        FigureKind::Error | FigureKind::Quantity => "not a number".to_owned(),
    };
    let relative = *base != 0.0 && base.is_finite() && head.is_finite();
    let share = match relative {
        false => String::new(),
        true => format!(" ({})", signed((head - base) / base.abs(), 2)),
    };
    let changed = format!("{figure} {} → {}{share}", value(*base), value(*head));
    match &difference.scope {
        DifferenceScope::Configuration(id) => format!("{id}: {changed}"),
        DifferenceScope::Cell(_) | DifferenceScope::Stage(_) => changed,
    }
}

/// Who could not do what, and why.
pub fn fault(fault: &Fault) -> String {
    let side = fault.side.map_or("", Side::name);
    let who = format!("{side} {}", fault.gate.name());
    format!("{}: {}", who.trim(), fault.reason)
}

/// `no regression: 48 cells: 40 same, 8 inconclusive`.
pub fn headline(verdicts: &Verdicts<'_>) -> String {
    let all = [
        CellVerdict::Slower,
        CellVerdict::LessAccurate,
        CellVerdict::FasterButLessAccurate,
        CellVerdict::Costlier,
        CellVerdict::Failed,
        CellVerdict::NotMeasured,
        CellVerdict::Inconclusive,
        CellVerdict::NotJudged,
        CellVerdict::Faster,
        CellVerdict::Cheaper,
        CellVerdict::Same,
        CellVerdict::New,
    ];
    let counted = all.iter().filter_map(|verdict| {
        let count = verdicts.count(*verdict);
        (count > 0).then(|| format!("{count} {}", verdict.text()))
    });
    let counted: Vec<String> = counted.collect();
    let cells = match verdicts.cells.len() {
        1 => "1 cell".to_owned(),
        n => format!("{n} cells"),
    };
    format!("{}; {cells}: {}", verdicts.status.text(), counted.join(", "))
}

/// Each regression in a sentence, the gravest first; then what concerns configurations as a whole.
pub fn regressions(verdicts: &Verdicts<'_>) -> Vec<String> {
    let cells = verdicts.regressions().into_iter().map(|cell| {
        let mut because = Vec::new();
        if let Some(time) = &cell.time {
            because.push(format!("time {}", change(time)));
        }
        if let Some(counted) = &cell.instructions {
            because.push(format!("instructions {}", signed(counted.ratio - 1.0, 2)));
        }
        let worse = cell.differences.iter().filter(|difference| difference.worse);
        because.extend(worse.map(difference));
        format!("{}: {}: {}", cell.cell, cell.verdict.text(), because.join("; "))
    });
    let whole = verdicts.configurations.iter();
    let whole = whole.filter(|difference| difference.worse).map(difference);
    cells.chain(whole).collect()
}

/// What was compared, on what, by which gates; and everything else that is to be known.
pub fn notes(verdicts: &Verdicts<'_>) -> Vec<String> {
    let header = &verdicts.comparison.header;
    let settings = &header.settings;
    let mut notes: Vec<String> = verdicts
        .gates
        .iter()
        .map(|(gate, state)| match state {
            GateState::Ran => format!("{} gate: {}", gate.name(), rule(verdicts, gate.name())),
            GateState::Skipped(reason) => format!("{} gate skipped: {reason}", gate.name()),
            GateState::Void(reason) => format!("{} gate void: {reason}", gate.name()),
        })
        .collect();
    for control in &verdicts.controls {
        let second = if control.second { ", second measurement" } else { "" };
        notes.push(format!(
            "control {} with the base on both sides{second}: {}",
            control.cell,
            change(control)
        ));
    }
    notes.extend(inconclusive(verdicts));
    if settings.unpaired {
        notes.push(
            "times are unpaired: the runs were made one after the other, so they are told and not judged"
                .to_owned(),
        );
    }
    let better = verdicts.configurations.iter();
    notes.extend(better.filter(|other| !other.worse).map(difference));
    notes.extend(verdicts.faults.iter().map(fault));
    notes.extend(configuration_notes(verdicts.comparison));
    notes.extend(launch_notes(verdicts.comparison));
    notes.extend(header.notes.iter().cloned());
    let damaged = &verdicts.comparison.damaged;
    notes.extend(damaged.iter().map(|line| format!("left out: {line}")));
    if let Some(end) = &verdicts.comparison.end {
        let cut = if end.interrupted { ", interrupted" } else { "" };
        notes.push(format!("measured in {:.0} s{cut}", end.wall_s));
    } else if !settings.unpaired {
        notes.push(INCOMPLETE.to_owned());
    }
    notes
}

/// What inconclusive cells mean for the status.
fn inconclusive(verdicts: &Verdicts<'_>) -> Option<String> {
    let all = verdicts.count(CellVerdict::Inconclusive);
    let threshold = verdicts.comparison.header.settings.threshold;
    let cells = verdicts.cells.iter();
    let open = cells.filter(|cell| cell.may_be_slower(threshold)).count();
    (all > 0).then(|| {
        format!(
            "of {all} inconclusive, {open} may be slower by more than {:.1} %, as their intervals reach above it; only these make the status inconclusive",
            100.0 * threshold
        )
    })
}

/// What could not be computed of configurations, once where both sides say the same.
fn configuration_notes(comparison: &StoredComparison) -> Vec<String> {
    let mut told: Vec<(String, Option<Side>)> = Vec::new();
    for line in &comparison.configurations {
        for note in &line.notes {
            let text = format!("{}: {note}", line.configuration);
            match told.iter_mut().find(|(known, _)| *known == text) {
                Some((_, side)) if *side != Some(line.side) => *side = None,
                Some(_) => {}
                None => told.push((text, Some(line.side))),
            }
        }
    }
    let text = |(text, side): (String, Option<Side>)| match side {
        Some(side) => format!("{}: {text}", side.name()),
        None => text,
    };
    told.into_iter().map(text).collect()
}

/// Conditions of the time gate, each once; not which core a launch had.
fn launch_notes(comparison: &StoredComparison) -> Vec<String> {
    let mut told: Vec<String> = Vec::new();
    let notes = comparison.launches.iter().flat_map(|launch| &launch.notes);
    for note in notes.filter(|note| !note.starts_with("on core ")) {
        let text = format!("time gate: {note}");
        if !told.contains(&text) {
            told.push(text);
        }
    }
    told
}

fn rule(verdicts: &Verdicts<'_>, gate: &str) -> String {
    let settings = &verdicts.comparison.header.settings;
    match gate {
        "time" if settings.unpaired => "medians of each run".to_owned(),
        "time" => format!(
            "{} launches of {} pairs{}; a change counts beyond {:.1} %, at a family-wise error of {:.0} %",
            verdicts.comparison.launches_of(false),
            settings.pairs,
            second(verdicts.comparison).unwrap_or_default(),
            100.0 * settings.threshold,
            100.0 * settings.alpha
        ),
        "instructions" => format!(
            "under callgrind; a change counts beyond {:.2} %",
            100.0 * settings.instruction_threshold
        ),
        _ => "work, counters and bytes as they are; errors beyond 1 % of the base's".to_owned(),
    }
}

/// What the second measurement of the time gate was, if there was one.
fn second(comparison: &StoredComparison) -> Option<String> {
    let of_second = comparison.pairs.iter().filter(|pair| pair.second);
    let pairs = of_second.clone().map(|pair| pair.round + 1).max()?;
    let cells: BTreeSet<_> =
        of_second.filter(|pair| !pair.control).map(|pair| &pair.cell).collect();
    let launches = comparison.launches_of(true);
    let count = cells.len();
    let noun = if count == 1 { "cell" } else { "cells" };
    Some(format!(", {launches} more of {pairs} pairs for {count} {noun} that these left open"))
}

/// `origin/main (0.1.0)`.
pub fn build(build: &ComparedBuild) -> String {
    format!("{} ({})", build.label, build.version)
}

/// `base … → head …`, and the adapter.
pub fn sides(verdicts: &Verdicts<'_>) -> [String; 2] {
    let header = &verdicts.comparison.header;
    let adapter = &header.adapter;
    [
        format!("{} → {}", build(&header.base), build(&header.head)),
        format!("{}, {}", adapter.name, adapter.driver_info),
    ]
}

/// A mark that is seen at a glance.
pub fn mark(status: Status) -> &'static str {
    match status {
        Status::NoRegression => "✅",
        Status::Regression => "❌",
        Status::CouldNotMeasure => "⚠️",
        Status::Inconclusive => "❔",
    }
}
