//! `index.html`: one self-contained page of one run or of several, from records alone.
//!
//! Every section is written as HTML and SVG, so that the page can be read without script. The script adds sorting, filters,
//! sliders, exact values under the pointer and from the keyboard. It loads nothing; the page's policy forbids other scripts.

mod ceilings;
mod cells;
pub(crate) mod claims;
mod data;
mod host;
pub(crate) mod overview;
mod pictures;
mod plots;
mod published;
pub(crate) mod scaling;
mod settings;
pub(crate) mod time;
mod trust;

pub(crate) use settings::setting_words;

use std::path::Path;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;
use itertools::Itertools;
use maud::{DOCTYPE, Markup, PreEscaped, html};
use sha2::{Digest, Sha256};

use super::charts::style;
use super::colors::StageColors;
use super::document::{self, Block, Field, Table};
use super::{Artifact, Exporter, Report, RunExporter, RunFormat, SkippedInput, Timing, sizes};
use fathom_base::{private, text};
use fathom_record::Run;

/// Name of the page within a report's folder.
pub const FILE: &str = "index.html";

pub const EXPORTER: RunExporter = Exporter {
    name: "page",
    about: "one HTML page that shows the whole run",
    file: FILE,
    written: Timing::WithEveryReport,
    export: RunFormat::One(export),
};

const STYLES: [&str; 2] = [include_str!("assets/page.css"), include_str!("assets/charts.css")];
/// In the order in which they run.
const SCRIPTS: [&str; 3] = [
    include_str!("assets/core.js"),
    include_str!("assets/pictures.js"),
    include_str!("assets/cells.js"),
];

/// What a page shows: runs in the order in which they were named, and what could not be shown.
pub struct Page<'a> {
    pub runs: Vec<PageRun<'a>>,
    pub comparisons: Vec<ComparisonOnPage>,
    /// What a history says, as it stands in its section.
    pub history: Option<Vec<Block>>,
    pub left_out: Vec<SkippedInput>,
    /// Of every stage of every run.
    pub colors: StageColors,
}

/// What a comparison says, as it stands in its section.
pub struct ComparisonOnPage {
    /// What was compared.
    pub sides: String,
    pub parts: Vec<Block>,
}

/// A run with the name that tells it from the others of the page.
pub struct PageRun<'a> {
    pub label: String,
    pub view: &'a Report<'a>,
}

/// Runs with labels that tell them apart: by adapter, else by driver, by version of fathom, or by folder.
pub fn labelled<'a>(views: &'a [(&Path, Report<'a>)]) -> Vec<PageRun<'a>> {
    let of = |part: fn(&Run) -> String| -> Vec<String> {
        views.iter().map(|(_, view)| view.run().map_or_else(String::new, part)).collect()
    };
    let adapters = of(|run| run.adapter.title());
    let drivers = of(|run| format!("{}, {}", run.adapter.title(), run.adapter.driver_info));
    let versions = of(|run| format!("{}, fathom {}", run.adapter.title(), run.fathom_version));
    let folders = views.iter().map(|(folder, _)| private::path(folder)).collect();
    let choices = [adapters, drivers, versions];
    let labels = choices.into_iter().find(|labels| labels.iter().all_unique()).unwrap_or(folders);
    let labelled = labels.into_iter().zip(views);
    labelled.map(|(label, (_, view))| PageRun { label, view }).collect()
}

/// A part of the page.
pub(crate) struct PageSection {
    /// Its anchor.
    id: &'static str,
    title: &'static str,
    /// What a reader learns from it.
    question: &'static str,
    fold: Fold,
    /// None where the records hold nothing for it.
    write: fn(&Page<'_>) -> Option<Markup>,
}

/// Whether a section shows its content before a reader asks for it.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Fold {
    /// Always.
    Open,
    /// When it is opened, and in print.
    Folded,
    /// Only when it is opened: it is long.
    Listed,
}

const HISTORY: PageSection = PageSection {
    id: "history",
    title: "History",
    question: "Between which commits did a figure change?",
    fold: Fold::Open,
    write: |page| page.history.as_deref().map(document::html),
};

const COMPARED: PageSection = PageSection {
    id: "compared",
    title: "Comparison",
    question: "What did the comparison of two builds, drivers or environments conclude?",
    fold: Fold::Open,
    write: |page| {
        let all =
            html! { @for comparison in &page.comparisons { (document::html(&comparison.parts)) } };
        (!page.comparisons.is_empty()).then_some(all)
    },
};

const SIZES: PageSection = PageSection {
    id: "sizes",
    title: "Sizes",
    question: "What does each size cost, and from which size does a stage dominate?",
    fold: Fold::Open,
    write: |page| {
        let of_run = |run: &PageRun<'_>| {
            let draw = pictures::drawing(run.view);
            page.heading(run).into_iter().chain(sizes::parts(run.view, &draw)).collect_vec()
        };
        let runs = page.runs.iter().map(of_run).filter(|parts| parts.len() > 1);
        document::html_if_any(runs.flatten().collect())
    },
};

/// In the order in which a reader asks.
const SECTIONS: [PageSection; 14] = [
    SIZES,
    overview::SECTION,
    HISTORY,
    COMPARED,
    claims::SECTION,
    time::SECTION,
    host::SECTION,
    scaling::SECTION,
    ceilings::SECTION,
    pictures::SECTION,
    published::SECTION,
    trust::SECTION,
    plots::SECTION,
    cells::SECTION,
];

impl PageSection {
    fn markup(&self, content: &Markup) -> Markup {
        let title = html! { h2 #{ (self.id) "-title" } { (self.title) } };
        html! {
            section #(self.id) aria-labelledby={ (self.id) "-title" } {
                @if self.fold == Fold::Open {
                    (title) (content)
                } @else {
                    details.section data-print=(self.fold == Fold::Folded) {
                        summary { (title) " " span.question { (self.question) } }
                        (content)
                    }
                }
            }
        }
    }
}

impl<'a> Page<'a> {
    /// A page of these runs, each with its label.
    pub fn new(runs: Vec<PageRun<'a>>) -> Page<'a> {
        let measured = runs.iter().flat_map(|run| run.view.measured());
        let stages = measured.flat_map(|(_, measured)| &measured.stages);
        let colors = StageColors::new(stages.map(|stage| stage.stage.as_str()));
        let left_out = runs.iter().flat_map(|run| run.view.left_out.clone()).collect();
        Page { runs, comparisons: Vec::new(), history: None, left_out, colors }
    }

    /// Several runs are compared: marks and rows name theirs.
    pub fn is_overlay(&self) -> bool {
        self.runs.len() > 1
    }

    /// A table whose rows name their run first, where there are several.
    fn table(&self, about: &str, columns: &[&str]) -> Table {
        let run = self.is_overlay().then_some("Run");
        Table::new(about, run.into_iter().chain(columns.iter().copied()))
    }

    /// The fields of a row of such a table.
    fn run_fields(
        &self,
        run: &PageRun<'_>,
        fields: impl IntoIterator<Item = Field>,
    ) -> impl Iterator<Item = Field> {
        let label = self.is_overlay().then(|| Field::from(run.label.as_str()));
        label.into_iter().chain(fields)
    }

    /// Some words, and below them what there is of each run.
    fn each_run(&self, lead: &str, of_run: impl Fn(&PageRun<'_>) -> Vec<Block>) -> Vec<Block> {
        let runs = self.runs.iter().map(|run| (run, of_run(run)));
        let runs = runs.filter(|(_, parts)| !parts.is_empty());
        let parts = runs.flat_map(|(run, parts)| self.heading(run).into_iter().chain(parts));
        let parts = parts.collect_vec();
        let lead = (!parts.is_empty()).then(|| Block::paragraph(lead));
        lead.into_iter().chain(parts).collect()
    }

    /// Above the part of a run, where there are several.
    fn heading(&self, run: &PageRun<'_>) -> Option<Block> {
        self.is_overlay().then(|| Block::Heading(run.label.as_str().into()))
    }

    pub fn file(&self) -> Artifact {
        Artifact::new(FILE, self.html())
    }

    pub fn html(&self) -> String {
        let sections: Vec<(&PageSection, Markup)> =
            SECTIONS.iter().filter_map(|section| Some((section, (section.write)(self)?))).collect();
        let script = SCRIPTS.concat();
        let markup = html! {
            (DOCTYPE)
            html lang="en" {
                head {
                    meta charset="utf-8";
                    meta http-equiv="Content-Security-Policy" content=(policy(&script));
                    meta name="viewport" content="width=device-width, initial-scale=1";
                    meta name="color-scheme" content="light dark";
                    title { (self.title()) }
                    style { (PreEscaped(STYLES.concat())) (PreEscaped(style::sheet())) }
                }
                body {
                    a.skip href="#main" { "Skip to the content" }
                    header {
                        h1 { (self.title()) }
                        nav aria-label="Sections" {
                            @for (section, _) in &sections {
                                a href={ "#" (section.id) } { (section.title) }
                            }
                        }
                    }
                    main #main {
                        @for (section, content) in sections {
                            (section.markup(&content))
                        }
                    }
                    div #tip role="status" aria-live="polite" hidden {}
                    script #data type="text/plain" { (PreEscaped(data::packed(self))) }
                    script { (PreEscaped(&script)) }
                }
            }
        };
        // Characters that would reorder or hide what is read.
        text::block(markup.into_string()) + "\n"
    }

    fn title(&self) -> String {
        let labels: Vec<&str> = self.runs.iter().map(|run| run.label.as_str()).collect();
        match labels.as_slice() {
            [] => match self.comparisons.as_slice() {
                [] if self.history.is_some() => "fathom: history".to_owned(),
                [] => "fathom: nothing to show".to_owned(),
                [first, ..] => format!("fathom: {}", first.sides),
            },
            [one] => format!("fathom on {one}"),
            several => format!("fathom: {}", several.join(" and ")),
        }
    }
}

/// Only this page's own script may run, and nothing may be loaded.
fn policy(script: &str) -> String {
    let hash = BASE64.encode(Sha256::digest(script));
    format!(
        "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'sha256-{hash}'; base-uri 'none'; form-action 'none'"
    )
}

/// The page of one run.
fn export(view: &Report<'_>) -> String {
    let label = view.run().map_or_else(|| "no run".to_owned(), |run| run.adapter.title());
    let runs = if view.runs.is_empty() { Vec::new() } else { vec![PageRun { label, view }] };
    Page { left_out: view.left_out.clone(), ..Page::new(runs) }.html()
}
