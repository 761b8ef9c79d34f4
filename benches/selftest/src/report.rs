//! The findings of a self-test as Markdown.

use std::collections::BTreeMap;
use std::fmt::Write;

use fathom::report::format::{Table, three};
use fathom::text;
use itertools::Itertools;
use strum::IntoEnumIterator;

use crate::findings::{Findings, Found, Share};
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
    for (name, found) in [
        ("time gates with a false alarm", findings.false_alarms),
        ("of them on a loaded machine", findings.false_alarms_loaded),
        ("cells of time gates called slower or faster", findings.no_op_changes()),
        ("exact and instruction gates with a false alarm", findings.counted_alarms),
        ("time gates whose control moved", findings.void),
    ] {
        table.row([name, &share(found)]);
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
            let ends: Vec<f64> = found.smallest.into_iter().chain(found.largest).collect();
            table.row([size.label().to_owned(), span(&ends)].iter().chain(&shares(found.found)));
        }
    }
    let composed = &findings.composed;
    if composed.found.caught.of > 0 {
        let label = format!("{}, composed", Size::Slow5.label());
        table.row([label, String::new()].iter().chain(&shares(composed.found)));
    }
    text += &table.markdown();

    let _ = writeln!(
        text,
        "A composed gate is one of equal builds in which the pairs of one stage are those of a gate with every stage slowed down. In {} \
         of them the stage was left open and no second measurement of it was stored; they count as not caught.\n",
        composed.without_second
    );

    let mut table = Table::new(["stage", "truth", "measured", "detectable", "caught", "composed"]);
    for (stage, found) in &findings.stages {
        table.row([
            stage.clone(),
            found.truth.map_or("–".to_owned(), percent),
            span(&found.changes),
            span(&found.detectable),
            share(found.caught),
            share(composed.stages.get(stage).copied().unwrap_or_default()),
        ]);
    }
    let above = "## +5 % time, stage by stage\n\n\
        The truth is what all gates with every stage slowed down give; detectable is the least slowdown that a trial finds in \
        80 % of cases; both in the configuration in which the injection is tuned. A stage that several \
        configurations have is caught in any of them.\n\n";
    table.add_to(&mut text, above);

    let mut table = Table::new(["change", "stage", "caught", "named first", "verdicts"]);
    for (kind, found) in &findings.kinds {
        let yes = |yes| if yes { "yes" } else { "no" };
        let [caught, first] =
            [found.found.caught, found.found.named_first].map(|it| yes(it.count > 0));
        table.row([kind.as_str(), &found.stage, caught, first, &found.verdicts.join("; ")]);
    }
    table.add_to(&mut text, "## Other changes of one stage\n\n");

    text += &coverage(findings);
    if let Some(seconds) = findings.time_gate_s {
        let _ =
            writeln!(text, "A time gate of all cells took {} s, in the median.\n", three(seconds));
    }
    text + &trials(findings)
}

fn shares(found: Found) -> [String; 3] {
    [found.caught, found.named_first, found.others_blamed].map(share)
}

fn coverage(findings: &Findings) -> String {
    let mut table = Table::new(["truth", "covered", "interval of the share"]);
    let slowed = findings.covered_slowed;
    for (truth, covered) in [
        ("0", findings.covered_zero),
        ("every stage injected: the other such gates", slowed.plain),
        ("the same, with intervals that are wider by the truth's error", slowed.corrected),
        ("one stage injected: the gates with every stage injected", findings.covered_injected),
    ] {
        let [low, high] =
            [covered.interval().low, covered.interval().high].map(|end| three(100.0 * end));
        table.row([truth, &share(covered), &format!("{low} … {high} %")]);
    }
    let sensitive = findings.sensitive_to_context.iter().join(", ");
    let sensitive = if sensitive.is_empty() { "none" } else { &sensitive };
    format!(
        "## Intervals that hold the truth\n\n{}Sensitive to context (the interval where one stage is injected lies apart from that where all \
         are): {sensitive}.\n\n",
        table.markdown()
    )
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
