//! The first screen: what was measured on what, what came out, and how far to trust it.

use maud::{Markup, html};

use super::claims::chip;
use super::{Page, PageRun, PageSection};
use crate::format::{NS_PER_MS, percent, three};
use crate::{facts, trust};
use fathom_experiments::Verdict;
use fathom_record::Run;

pub const SECTION: PageSection = PageSection { id: "overview", title: "At a glance", write };

/// Stages that a run's card names.
const SLOWEST: usize = 5;

fn write(page: &Page<'_>) -> Option<Markup> {
    if page.runs.is_empty() && page.left_out.is_empty() {
        return None;
    }
    Some(html! {
        @for run in &page.runs { (of_run(page, run)) }
        @if !page.left_out.is_empty() { (left_out(page)) }
    })
}

fn of_run(page: &Page<'_>, run: &PageRun<'_>) -> Markup {
    let findings = facts::findings(run.view);
    html! {
        @if page.is_overlay() { h3 { (run.label) } }
        div.cards {
            @if let Some(header) = run.view.run() { (device(header)) }
            (verdicts(run))
            (slowest(page, run))
            (how_far(run))
        }
        @if !findings.is_empty() {
            ul.findings { @for finding in &findings { li { (finding) } } }
        }
    }
}

fn device(run: &Run) -> Markup {
    let adapter = &run.adapter;
    html! {
        article.card {
            h3 { (adapter.name) }
            @if adapter.software {
                p { span.chip.open { "software driver" } }
                p.faint { "Ratios, slopes and shares stand. Absolute times and frame rates count only on hardware." }
            }
            @if let Some(shard) = &run.shard {
                p { span.chip.open { "shard " (shard.part()) } " A part of a run: fathom merge joins the parts." }
            }
            p.faint {
                (adapter.driver) " " (adapter.driver_info) ", " (adapter.backend) "; profile " (run.profile.name())
                "; started " (run.started_at) "; fathom " (run.fathom_version)
            }
        }
    }
}

fn verdicts(run: &PageRun<'_>) -> Markup {
    let tally = facts::tally(run.view);
    let counts = [
        (Verdict::Supported, tally.supported),
        (Verdict::Contradicted, tally.contradicted),
        (Verdict::Inconclusive, tally.inconclusive),
        (Verdict::NotRun, tally.not_run),
    ];
    html! {
        article.card {
            h3 { "What holds: " (tally.all()) " claims" }
            @for (verdict, count) in counts {
                p.tally { a href="#claims" { (chip(verdict)) } " " b { (count) } }
            }
        }
    }
}

fn slowest(page: &Page<'_>, run: &PageRun<'_>) -> Markup {
    let slowest = facts::slowest_stages(run.view, SLOWEST);
    html! {
        article.card {
            h3 { "Slowest stages" }
            @if slowest.is_empty() { p.faint { "No stage was timed." } }
            ol.stages {
                @for slow in &slowest {
                    @let stage = slow.stage.stage;
                    li {
                        span.swatch style={ "background:" (page.colors.of(&stage.stage).hex()) } {}
                        (stage.stage) " " b { (three(stage.time.median / NS_PER_MS)) " ms" }
                        span.faint { ", " (percent(slow.stage.share.median)) " of the stages of " (slow.frame.cell.pipeline) " (" (slow.frame.conditions()) ")" }
                    }
                }
            }
        }
    }
}

fn how_far(run: &PageRun<'_>) -> Markup {
    html! {
        article.card {
            h3 { "How far to trust it" }
            @if let Some(header) = trust::worst(run.view) {
                p { (trust::verdict(header)) " " a href="#trust" { "Trust" } }
            }
            @for note in facts::incomplete(run.view) {
                p { span.chip.open { "incomplete" } " " (note.text) }
            }
            @if let Some(few) = facts::few_samples(run.view) {
                p {
                    (percent(few.cells as f64 / few.timed as f64)) " of " (few.timed)
                    " timed cells have fewer than the " (few.needed) " samples that a verdict needs; the fewest are " (few.fewest) "."
                }
            }
            @if let Some(precision) = facts::precision(run.view) {
                p {
                    "Half a 95 % interval of the frame time is " (percent(precision.median)) " in the median cell, "
                    (percent(precision.worst)) " at worst."
                }
            }
            @if let Some((cell, cost)) = facts::worst_timing_cost(run.view) {
                p {
                    "Timing by stage costs " (percent(facts::timing_cost(run.view).median - 1.0)) " over all cells; at worst "
                    (percent(cost.median - 1.0)) " (" (cell.experiment) ", n = " (cost.n) ")."
                }
            }
        }
    }
}

fn left_out(page: &Page<'_>) -> Markup {
    html! {
        div.warning role="note" {
            p { b { "Not shown" } }
            ul { @for left_out in &page.left_out { li { (left_out.what) ": " (left_out.reason) } } }
        }
    }
}
