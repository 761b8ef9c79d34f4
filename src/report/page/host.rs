//! What a frame costs the CPU: encoding, submission, making of pipelines.

use itertools::Itertools;
use maud::{Markup, html};

use super::parts::{numbers, table, words};
use super::{Fold, Page, PageRun, PageSection};
use crate::format::{NS_PER_MS, three};
use fathom_base::statistics::Estimate;
use fathom_record::{Cell, HostCosts};

pub const SECTION: PageSection = PageSection {
    id: "host",
    title: "What it costs the CPU",
    question: "How long does the CPU encode and submit a frame?",
    fold: Fold::Folded,
    write,
};

const NS_PER_US: f64 = 1e3;

/// The latest cell of each pipeline that has such figures.
fn costs<'a>(run: &PageRun<'a>) -> Vec<(&'a Cell, &'a HostCosts)> {
    let cells = run.view.sections.iter().flat_map(|section| section.cells());
    let told = cells.filter_map(|cell| Some((cell, cell.measured()?.host.as_ref()?)));
    told.sorted_by_key(|(cell, _)| cell.pipeline.as_str())
        .dedup_by(|a, b| a.0.pipeline == b.0.pipeline)
        .collect()
}

fn write(page: &Page<'_>) -> Option<Markup> {
    let runs = page.runs.iter().map(|run| (run, costs(run))).filter(|(_, costs)| !costs.is_empty());
    let runs: Vec<_> = runs.collect();
    if runs.is_empty() {
        return None;
    }
    Some(html! {
        p.lead {
            "One cell per pipeline. Encoding and submission are CPU time of the thread that does them (on Linux), with the interval at 95 %. "
            "A software driver may do a frame's work within the submission. The driver's cache on disk may know pipelines from earlier runs; "
            "a driver may compile a part of their code in the first frame, which is not in these figures."
        }
        @for (run, costs) in &runs {
            @if page.is_overlay() { h3 { (run.label) } }
            (frames(costs))
            @for (cell, host) in costs { (stages(cell, host)) }
        }
    })
}

fn frames(costs: &[(&Cell, &HostCosts)]) -> Markup {
    let heads = html! {
        (words(&["pipeline", "cell"]))
        (numbers(&["encode (µs)", "submit (µs)", "pipelines", "make, first (ms)", "again (ms)"]))
    };
    let rows = html! {
        @for (cell, host) in costs {
            tr {
                th scope="row" { (cell.pipeline) }
                td { (cell.cell) }
                td.number { (spread(&host.encode)) }
                td.number { (spread(&host.submit)) }
                @match &host.creation {
                    Some(made) => {
                        td.number { (made.pipelines) }
                        td.number { (three(made.first_ns / NS_PER_MS)) }
                        td.number { (three(made.again_ns / NS_PER_MS)) }
                    }
                    None => { td.number { "–" } td.number { "–" } td.number { "–" } }
                }
            }
        }
    };
    table("What a frame of each pipeline costs the CPU", "", &heads, &rows)
}

fn stages(cell: &Cell, host: &HostCosts) -> Markup {
    let heads = html! { (words(&["stage"])) (numbers(&["encode (µs)"])) };
    let rows = html! {
        @for stage in &host.stages {
            tr { th scope="row" { (stage.stage.as_str()) } td.number { (spread(&stage.encode)) } }
        }
    };
    html! {
        details {
            summary { "Stages of " (cell.pipeline) ", each encoded alone" }
            (table("CPU time to encode each stage", "", &heads, &rows))
        }
    }
}

/// `12.3 (11.9–12.8)`, in microseconds.
fn spread(of: &Estimate) -> String {
    let us = |ns: f64| three(ns / NS_PER_US);
    let interval = of.interval.map(|i| format!(" ({}–{})", us(i.low), us(i.high)));
    format!("{}{}", us(of.median), interval.unwrap_or_default())
}
