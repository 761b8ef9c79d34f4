//! The first screen: what was measured on what, and what came out.

use maud::{Markup, html};

use super::claims::chip;
use super::{Page, PageRun, PageSection};
use crate::experiments::Verdict;

pub const SECTION: PageSection = PageSection { id: "overview", title: "At a glance", write };

fn write(page: &Page<'_>) -> Option<Markup> {
    Some(html! {
        div.cards { @for run in &page.runs { (card(run)) } }
        @if !page.left_out.is_empty() {
            div.warning role="note" {
                p { b { "Not shown" } }
                ul { @for left_out in &page.left_out { li { (left_out.what) ": " (left_out.reason) } } }
            }
        }
    })
}

fn card(run: &PageRun<'_>) -> Markup {
    let rulings = || run.view.sections.iter().flat_map(|section| section.rulings());
    let count = |verdict| rulings().filter(|ruling| ruling.verdict == verdict).count();
    html! {
        article.card {
            h3 { (run.label) }
            @for verdict in [Verdict::Supported, Verdict::Contradicted, Verdict::Inconclusive, Verdict::NotRun] {
                p { (chip(verdict)) " " (count(verdict)) }
            }
        }
    }
}
