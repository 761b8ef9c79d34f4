//! A history as text and as JSON.

use serde_json::{Value, json};

use super::controls::MachineShift;
use super::findings::{Certainty, FALSE_SHARE, HistoryChanges, SeriesChange, Size};
use super::run::NANOSECONDS;
use super::stored::{FigureSeries, StoredRun, StoredRuns};
use fathom_base::text;
use fathom_judge::change_points::{LEVEL, MIN_RUNS};
use fathom_record::Estimate;
use fathom_report::document::{self, Block, Table};
use fathom_report::format::{interval, three, trim_zeros};

/// Unit in records of errors that have none.
const WITHOUT_UNIT: &str = "1";

/// A line for each run.
pub fn runs(runs: &[StoredRun]) -> String {
    let head = ["RUN", "COMMIT", "DAY", "BRANCH", "MACHINE", "CELLS", "FIGURES", "ADAPTER"];
    let rows = runs.iter().map(|run| {
        [
            run.short_digest(),
            run.short_commit(),
            run.day(),
            run.branch.clone(),
            run.machine.clone(),
            run.cells.to_string(),
            run.figures.to_string(),
            format!("{}, {}", run.adapter, run.driver),
        ]
    });
    let table = document::terminal(&[Block::Table(Table::new("Runs", head).with_rows(rows))]);
    format!("{}\n\n{}", table.trim(), by_date(runs)).trim_end().to_owned()
}

/// What dates decide, where the repository here does not have all commits; else empty.
fn by_date(runs: &[StoredRun]) -> String {
    match runs.iter().filter(|run| run.place.is_none()).count() {
        0 => String::new(),
        count => format!(
            "Not in the order of commits: {count} runs stand by date, as git here does not have their commits. Run this in a whole clone."
        ),
    }
}

/// What was searched and what was found, in some sentences.
pub fn headline(stored: &StoredRuns, findings: &HistoryChanges) -> String {
    let HistoryChanges { changes, searched, too_short } = findings;
    let runs = stored.runs.len();
    let [sure, possible, drift] =
        [Certainty::Sure, Certainty::Possible, Certainty::Drift].map(|kind| findings.count(kind));
    let mut headline = format!("{runs} runs, {searched} series searched");
    if *too_short > 0 {
        headline += &format!(", {too_short} too short (fewer than {MIN_RUNS} runs)");
    }
    let [share, level] = [FALSE_SHARE, LEVEL].map(|share| 100.0 * share);
    if sure > 0 {
        headline += &format!(". Sure changes: {sure}, of which at most about {share} % are false");
    }
    if possible > 0 {
        headline +=
            &format!(". Possible changes: {possible}; up to {level} % of stable series have one");
    }
    if drift > 0 {
        headline += &format!(". Machine drift, which the controls share: {drift}");
    }
    headline += if changes.is_empty() { ". No change." } else { "." };
    format!("{headline} {}", by_date(&stored.runs)).trim_end().to_owned()
}

/// The two commits between which a figure changed.
pub fn commits(before: &StoredRun, after: &StoredRun) -> String {
    if before.commit == after.commit {
        return format!("within {}", before.short_commit());
    }
    format!("{} → {}", before.short_commit(), after.short_commit())
}

/// `+5.1 % (+4.2 … +6.0)`, or a difference with its unit.
pub fn size(change: &SeriesChange, series: &FigureSeries) -> String {
    let (unit, factor) = match change.size {
        Size::Share(_) => (" %".to_owned(), 100.0),
        Size::Difference(_) => (format!(" {}", unit(series)), 1.0),
    };
    let Estimate { median, interval, .. } = change.size.estimate().scaled(factor);
    let signed = |value: f64| {
        let number =
            if factor > 1.0 && value.abs() < 100.0 { format!("{value:.1}") } else { three(value) };
        if value > 0.0 {
            format!("+{}", trim_zeros(&number))
        } else {
            trim_zeros(&number).to_owned()
        }
    };
    let unit = unit.trim_end();
    match interval {
        Some(i) => format!("{}{unit} ({} … {})", signed(median), signed(i.low), signed(i.high)),
        None => format!("{}{unit} (no interval)", signed(median)),
    }
}

/// What the machine did at a change; empty where it did nothing.
pub fn machine(change: &SeriesChange) -> String {
    let shift = |machine: &Estimate| format!("{:+.1} %", 100.0 * machine.median.exp_m1());
    match &change.machine {
        MachineShift::Unknown | MachineShift::Still => String::new(),
        MachineShift::Partly { machine, .. } => format!("without {} of drift", shift(machine)),
        MachineShift::Whole(machine) => format!("the controls: {}", shift(machine)),
    }
}

/// A value in the unit that people read.
pub fn value(series: &FigureSeries, value: &Estimate) -> String {
    interval(&value.scaled(series.key.display_scale()))
}

/// Unit of a series for people; empty where there is none.
pub fn unit(series: &FigureSeries) -> String {
    match &*series.key.figure.unit {
        NANOSECONDS => "ms".to_owned(),
        WITHOUT_UNIT => String::new(),
        unit => text::line(unit),
    }
}

/// The changes for machines.
pub fn changes_json(stored: &StoredRuns, findings: &HistoryChanges) -> Value {
    let changes: Vec<Value> =
        findings.changes.iter().map(|change| change_json(stored, change)).collect();
    json!({
        "runs": stored.runs.len(), "series": findings.searched, "too_short": findings.too_short,
        "least_runs": MIN_RUNS, "level": LEVEL, "false_share": FALSE_SHARE, "changes": changes,
    })
}

fn change_json(stored: &StoredRuns, change: &SeriesChange) -> Value {
    let series = &stored.series[change.series];
    let [before, after] = change.runs.map(|run| run_json(&stored.runs[run]));
    let [adapter, driver, profile, cell, configuration, figure, unit, clock] =
        series.key.figure.names();
    let estimate = change.size.estimate();
    let machine = match change.machine {
        MachineShift::Unknown | MachineShift::Still => None,
        MachineShift::Partly { machine, .. } | MachineShift::Whole(machine) => {
            Some(machine.median.exp_m1())
        }
    };
    let kind = match change.size {
        Size::Share(_) => "share",
        Size::Difference(_) => "difference",
    };
    json!({
        "branch": series.key.branch, "machine": &*series.key.machine, "adapter": adapter, "driver": driver,
        "profile": profile, "cell": cell, "configuration": configuration, "figure": figure,
        "unit": unit, "clock": clock, "before": before, "after": after,
        "change": { "kind": kind, "value": estimate.median, "low": estimate.interval.map(|i| i.low), "high": estimate.interval.map(|i| i.high) },
        "runs_before": change.n[0], "runs_after": change.n[1], "p": change.p, "false_share": change.false_share,
        "sure": change.is_sure(), "machine": machine, "machine_drift": change.certainty() == Certainty::Drift,
    })
}

fn run_json(run: &StoredRun) -> Value {
    json!({ "run": run.digest, "commit": run.commit, "committed_at": run.committed_at, "started_at": run.started_at })
}
