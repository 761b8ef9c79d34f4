//! The first screen: a card for each question of a reader, with the answer and a link to its section.

use itertools::Itertools;
use maud::{Markup, html};

use super::claims::chip;
use super::{Fold, Page, PageRun, PageSection};
use crate::ceilings::{Bound, bounds};
use crate::format::{NS_PER_MS, percent, three};
use crate::noise::RunVerdict;
use crate::{facts, trust};
use fathom_record::Run;

pub const SECTION: PageSection = PageSection {
    id: "overview",
    title: "At a glance",
    question: "What came out, and can it be trusted?",
    fold: Fold::Open,
    write,
};

/// Lines of a card that has one for each stage, axis or pipeline.
const MOST_LINES: usize = 5;

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
    html! {
        @if page.is_overlay() { h3 { (run.label) } }
        @if let Some(header) = run.view.run() { (device(header)) }
        @for open in facts::still_open(run.view) { p { span.chip.open { "open" } " " (open) } }
        @for note in facts::incomplete(run.view) {
            p { span.chip.open { "incomplete" } " " (note.text) }
        }
        div.cards {
            (how_far(run))
            (verdicts(run))
            (slowest(page, run))
            (growth(run))
            (limits(page, run))
        }
    }
}

/// A question that links to the section with the whole answer.
fn card(section: &str, question: &str, answer: &Markup) -> Markup {
    html! { article.card { h3 { a href={ "#" (section) } { (question) } } (answer) } }
}

fn device(run: &Run) -> Markup {
    let adapter = &run.adapter;
    html! {
        p.device {
            @if adapter.software {
                span.chip.open { "software driver" }
                " Read ratios, exponents and shares: absolute times count only on hardware. "
            }
            @if let Some(shard) = &run.shard {
                span.chip.open { "shard " (shard) } " A part of a run: fathom merge joins the parts. "
            }
            span.faint {
                (adapter.driver) " " (adapter.driver_info) ", " (adapter.backend) "; profile " (run.profile)
                "; started " (run.started_at) "; " (facts::program(run))
            }
        }
        @if let Some(machine) = &run.conditions.machine { p.faint { (facts::machine(machine)) } }
    }
}

/// Whether the machine was quiet enough, by what that is judged, and what to do; then the clocks.
fn how_far(run: &PageRun<'_>) -> Markup {
    let answer = html! {
        @if let Some(verdict) = RunVerdict::of(run.view) {
            @let advice = verdict.advice();
            p { (verdict.tone().chip(&verdict.headline())) }
            dl.figures {
                @for (about, words) in verdict.figures() { div { dt { (about) } dd { (words) } } }
            }
            @if !advice.is_empty() { p { b { "What to do: " } (advice.join("; ")) "." } }
        }
        @if let Some(header) = trust::worst(run.view) { p { (trust::verdict(header)) } }
    };
    card("trust", "Can it be trusted?", &answer)
}

fn verdicts(run: &PageRun<'_>) -> Markup {
    let answer = html! {
        @for (whose, counts) in facts::tallies(run.view) {
            p.faint { (whose) }
            p { @for (verdict, count) in counts { span.tally { (chip(verdict)) " " b { (count) } } " " } }
        }
        @if let Some(finding) = facts::claims_finding(run.view) { p { (finding) } }
    };
    card("claims", "Which claims hold?", &answer)
}

/// The slowest stage of each pipeline.
fn slowest(page: &Page<'_>, run: &PageRun<'_>) -> Markup {
    let mut slowest = facts::slowest_stages(run.view).peekable();
    let answer = html! {
        @if slowest.peek().is_none() { p.faint { "No stage was timed." } }
        @else { p.faint { "The slowest stage of each pipeline:" } }
        ul.lines {
            @for slow in slowest {
                @let stage = slow.stage.stage;
                li {
                    (slow.frame.cell.pipeline) ": "
                    span.swatch style={ "background:" (page.colors.of(&stage.stage).hex()) } {}
                    (stage.stage) " " b { (percent(slow.stage.share.median)) }
                    span.faint { ", " (three(stage.time.median / NS_PER_MS)) " ms" }
                }
            }
        }
    };
    card("time", "Where does the time go?", &answer)
}

fn growth(run: &PageRun<'_>) -> Markup {
    let mut exponents = facts::growth(run.view).peekable();
    let answer = html! {
        @if exponents.peek().is_none() { p.faint { "No exponent was fitted." } }
        @else { p.faint { "Exponents over the widest ranges:" } }
        ul.lines {
            @for exponent in exponents.unique_by(|one| one.y_title()).take(MOST_LINES) {
                li {
                    (exponent.y_title()) " " b { (exponent.text()) }
                    span.faint { " with " (exponent.x_title()) ", over " (facts::times_over(exponent.fit.range)) }
                }
            }
        }
    };
    card("scaling", "How does it scale?", &answer)
}

fn limits(page: &Page<'_>, run: &PageRun<'_>) -> Markup {
    let bounds = bounds(run.view);
    let nearest = bounds.iter().unique_by(|bound| &bound.stage.stage).take(MOST_LINES);
    let answer = html! {
        @if bounds.is_empty() { p.faint { "None of this version's limits was measured." } }
        @else { p.faint { "Best shares of the adapter's limits:" } }
        ul.lines {
            @for Bound { stage, share, .. } in nearest {
                li {
                    span.swatch style={ "background:" (page.colors.of(&stage.stage).hex()) } {}
                    (stage.stage) " " b { (percent(share.share)) } span.faint { " of " (share.limit.name()) }
                }
            }
        }
    };
    let section = if super::ceilings::are_measured(run) { "ceilings" } else { "trust" };
    card(section, "How near to the limits?", &answer)
}

fn left_out(page: &Page<'_>) -> Markup {
    html! {
        div.warning role="note" {
            p { b { "Not shown" } }
            ul { @for left_out in &page.left_out { li { (left_out.what) ": " (left_out.reason) } } }
        }
    }
}
