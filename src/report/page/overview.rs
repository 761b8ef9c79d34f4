//! The first screen: what was measured on what, what came out, and how far to trust it.

use maud::{Markup, html};

use super::claims::chip;
use super::{Page, PageRun, PageSection};
use crate::format::{NS_PER_MS, percent, three};
use crate::noise::RunVerdict;
use crate::{facts, trust};
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
            @if let Some(verdict) = RunVerdict::of(run.view) { (noise(&verdict)) }
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

/// Whether the machine was quiet enough, by what that is judged, and what to do.
fn noise(verdict: &RunVerdict) -> Markup {
    let (tone, advice) = (verdict.tone(), verdict.advice());
    html! {
        article.card.verdict.(tone.class()) {
            h3 { (tone.chip(&verdict.noise.to_string())) " " (verdict.headline()) }
            dl.figures {
                @for (about, words) in verdict.figures() { dt { (about) } dd { (words) } }
            }
            @if !advice.is_empty() { p { b { "What to do: " } (advice.join("; ")) "." } }
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
                p { span.chip.open { "shard " (shard.part) } " A part of a run: fathom merge joins the parts." }
            }
            p.faint {
                (adapter.driver) " " (adapter.driver_info) ", " (adapter.backend) "; profile " (run.profile)
                "; started " (run.started_at) "; " (facts::program(run))
            }
            @if let Some(machine) = &run.conditions.machine { p.faint { (facts::machine(machine)) } }
        }
    }
}

fn verdicts(run: &PageRun<'_>) -> Markup {
    let counts = facts::tally(run.view);
    html! {
        article.card {
            h3 { "What holds: " (counts.iter().map(|(_, count)| count).sum::<usize>()) " claims" }
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
            @for fact in trust::facts(run.view) {
                p.fact { b { (fact.about) } ": " (fact.words) "." }
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
