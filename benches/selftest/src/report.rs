//! The findings of a self-test as Markdown.

use std::collections::BTreeMap;
use std::fmt::Write;

use fathom::report::format::{Table, three};
use fathom::text;
use itertools::Itertools;
use strum::IntoEnumIterator;

use crate::findings::{Detection, Findings, Share};
use crate::injections::Size;

/// `38 of 40 (95 %)`.
fn share(share: Share) -> String {
    match share.of {
        0 => "–".to_owned(),
        of => format!("{} of {of} ({} %)", share.count, three(100.0 * share.ratio())),
    }
}

/// A summary: what was asked of the gates, and what came of it.
pub fn markdown(findings: &Findings) -> String {
    let mut text = format!(
        "# Self-test of `fathom compare`\n\n{}, {} cells. {} trials.\n\n",
        text::markdown(&findings.adapter),
        findings.cells,
        findings.trials.len()
    );
    text += "## Equal builds\n\n";
    let mut table = Table::new(["", "result"]);
    let rows = [
        ("time gates with a false alarm", findings.false_alarms),
        ("of them on a loaded machine", findings.false_alarms_loaded),
        ("cells of time gates called slower or faster", findings.no_op_changes()),
        ("exact and instruction gates with a false alarm", findings.counted_alarms),
        ("time gates whose control moved", findings.void),
    ];
    for (name, found) in rows {
        table.row([name.to_owned(), share(found)]);
    }
    text += &table.markdown();
    let _ = writeln!(text, "Cells of those time gates: {}.\n", counts(&findings.no_op_verdicts));

    text += "## Slowdowns of one stage\n\n";
    text += "Measured is what the trials found of the stage in the configuration in which injections are tuned.\n\n";
    let mut table = Table::new([
        "injected",
        "measured",
        "caught",
        "stage named first",
        "verdicts that blame another stage",
    ]);
    for size in Size::iter() {
        if let Some(found) = findings.detection.get(size.label()) {
            table.row(detection(size, found));
        }
    }
    text += &table.markdown();

    if !findings.stages.is_empty() {
        text += "## +5 % time, stage by stage\n\n";
        text += "The truth is what a longer measurement gives for the injection; detectable is the least slowdown that a trial finds in \
                 80 % of cases; both in the configuration in which the injection is tuned. A stage that several \
                 configurations have is caught in any of them.\n\n";
        let header = ["stage", "truth", "measured", "detectable", "caught"];
        let mut table = Table::new(header);
        for (stage, found) in &findings.stages {
            table.row([
                stage.clone(),
                found.truth.map_or("–".to_owned(), percent),
                span(&found.changes),
                span(&found.detectable),
                share(found.caught),
            ]);
        }
        text += &table.markdown();
    }

    if !findings.kinds.is_empty() {
        text += "## Other changes of one stage\n\n";
        let mut table = Table::new(["change", "stage", "caught", "named first", "verdicts"]);
        for (kind, found) in &findings.kinds {
            let yes = |yes| if yes { "yes" } else { "no" };
            table.row([
                kind.as_str(),
                &found.stage,
                yes(found.caught),
                yes(found.named_first),
                &found.verdicts.join("; "),
            ]);
        }
        text += &table.markdown();
    }

    text += "## Intervals that hold the truth\n\n";
    let mut table = Table::new(["truth", "covered"]);
    table.row(["0".to_owned(), share(findings.covered_zero)]);
    table.row([
        "an injection, as a long measurement gives it".to_owned(),
        share(findings.covered_injected),
    ]);
    table.row(["both".to_owned(), share(findings.covered())]);
    text += &table.markdown();
    if let Some(seconds) = findings.time_gate_s {
        let _ =
            writeln!(text, "A time gate of all cells took {} s, in the median.\n", three(seconds));
    }
    text + &trials(findings)
}

fn percent(change: f64) -> String {
    format!("{:+.1} %", 100.0 * change)
}

/// The least and the greatest.
fn span(changes: &[f64]) -> String {
    match changes.iter().minmax().into_option() {
        Some((least, most)) => format!("{:+.1} … {}", 100.0 * least, percent(*most)),
        None => "–".to_owned(),
    }
}

/// `40 same, 1 slower`.
fn counts(verdicts: &BTreeMap<String, usize>) -> String {
    verdicts.iter().map(|(verdict, count)| format!("{count} {verdict}")).join(", ")
}

fn detection(size: Size, found: &Detection) -> [String; 5] {
    let ends: Vec<f64> = found.smallest.into_iter().chain(found.largest).collect();
    [
        size.label().to_owned(),
        span(&ends),
        share(found.caught),
        share(found.named_first),
        share(found.others_blamed),
    ]
}

/// One line for each trial.
fn trials(findings: &Findings) -> String {
    let mut table = Table::new(["trial", "change", "stage", "status", "named first", "cells", "s"]);
    for trial in &findings.trials {
        table.row([
            trial.id.clone(),
            trial.kind.clone(),
            trial.stage.clone().unwrap_or_default(),
            trial.status.clone(),
            trial.named_first.clone().unwrap_or_default(),
            counts(&trial.verdicts),
            trial.wall_s.map(three).unwrap_or_default(),
        ]);
    }
    format!(
        "## Trials\n\n<details><summary>Each trial</summary>\n\n{}</details>\n",
        table.markdown()
    )
}
