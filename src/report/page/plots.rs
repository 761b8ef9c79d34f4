//! Each experiment with its plot: what was done, after what publication, what its claims came to, and what to know of its cells.

use indexmap::{IndexMap, IndexSet};
use maud::{Markup, PreEscaped, html};

use super::claims::{chip, ruled};
use super::{Fold, Page, PageRun, PageSection};
use crate::document::with_code;
use crate::{Section, charts};
use fathom_base::text;
use fathom_experiments::Experiment;
use fathom_record::NoteKind;

pub const SECTION: PageSection = PageSection {
    id: "plots",
    title: "Experiments",
    question: "What was each experiment, with its plot and its notes?",
    fold: Fold::Listed,
    write,
};

/// An experiment of a run.
type Part<'p> = (&'p PageRun<'p>, &'p Section<'p>);

fn write(page: &Page<'_>) -> Option<Markup> {
    let sections = page.runs.iter().flat_map(|run| &run.view.sections);
    let ids: IndexSet<&str> = sections.map(|section| section.id).collect();
    if ids.is_empty() {
        return None;
    }
    Some(html! {
        p.lead { "What was done in each experiment, after which publication, with its plot. Intervals in plots are of 95 %; those of claims are wider." }
        @for id in ids { (experiment(page, id)) }
    })
}

/// Its part in each run that has it.
fn parts<'p>(page: &'p Page<'p>, id: &str) -> Vec<Part<'p>> {
    let of_run = |run: &'p PageRun<'p>| Some((run, run.view.sections.iter().find(|s| s.id == id)?));
    page.runs.iter().filter_map(of_run).collect()
}

fn experiment(page: &Page<'_>, id: &str) -> Markup {
    let parts = parts(page, id);
    let title = parts.first().map_or(id, |(_, section)| section.title());
    let definition = parts.iter().find_map(|(_, section)| section.experiment.as_ref());
    html! {
        details.plot #{ "plot-" (id) } {
            summary {
                b { (id) } ": " (title)
                @for (_, section) in &parts { (tally(section)) }
            }
            @if let Some(definition) = definition { (about(definition)) }
            @for part in &parts {
                @if page.is_overlay() { h3 { (part.0.label) } }
                (outcome(page, part))
            }
        }
    }
}

/// How many claims have each verdict.
fn tally(section: &Section<'_>) -> Markup {
    let verdicts = section.rulings().iter().map(|ruling| ruling.verdict);
    let mut counts: Vec<_> = verdicts.collect();
    counts.sort_unstable();
    html! {
        @for same in counts.chunk_by(|a, b| a == b) { " " (chip(same[0])) " × " (same.len()) }
    }
}

fn about(experiment: &Experiment) -> Markup {
    html! {
        p.faint { "Source: " (experiment.source) }
        @for paragraph in experiment.about.split("\n\n").filter(|text| !text.is_empty()) {
            p { (with_code(paragraph)) }
        }
    }
}

fn outcome(page: &Page<'_>, part: &Part<'_>) -> Markup {
    let (_, section) = part;
    html! {
        @if let Some(problem) = &section.problem { p.warning { "No claims and plots: " (problem) } }
        (claims(section))
        (plot(page, part))
        @for (title, reason) in &section.figure().missing {
            p.faint { "The plot “" (title) "” is left out: " (reason) "." }
        }
        (notes(section))
    }
}

fn claims(section: &Section<'_>) -> Markup {
    html! {
        @if !section.rulings().is_empty() {
            ul.claims { @for ruling in section.rulings() { li { (ruled(ruling)) " " (with_code(&ruling.text)) } } }
        }
    }
}

/// The plot, and the file that holds it.
fn plot(page: &Page<'_>, (_, section): &Part<'_>) -> Markup {
    html! {
        @if let Some(svg) = &section.figure().svg {
            div.scroll tabindex="0" role="region" aria-label={ "Plot of " (section.id) } { (PreEscaped(svg)) }
            @if !page.is_overlay() {
                p { a href=(text::link(&charts::file_name(section))) { "The plot as a file" } }
            }
        }
    }
}

/// Each kind of note is told once, with the cells that have it folded away.
fn notes(section: &Section<'_>) -> Markup {
    let mut kinds = IndexMap::<NoteKind, Vec<(&str, &str)>>::new();
    for (cell, measured) in section.measured() {
        for note in &measured.notes {
            kinds.entry(note.kind).or_default().push((&cell.cell, &note.text));
        }
    }
    html! {
        @for (kind, of_cells) in kinds {
            details.notes {
                summary { (counted(of_cells.len())) ": " (meaning(kind)) }
                ul { @for (cell, note) in of_cells { li { (cell) ": " (with_code(note)) } } }
            }
        }
        (rejected(section))
        @for stand_in in stand_ins(section) { p.faint { (stand_in) } }
    }
}

fn counted(notes: usize) -> String {
    format!("{notes} {}", if notes == 1 { "note" } else { "notes" })
}

/// What notes of a kind have in common.
fn meaning(kind: NoteKind) -> &'static str {
    match kind {
        NoteKind::Adapter => "the adapter lacks a feature, or the environment changes how it works",
        NoteKind::Order => "the order in which cells and frames were measured",
        NoteKind::NoCeilings => "the adapter's limits were not measured",
        NoteKind::OtherClocks => "passes are timed by another clock than the audit chose",
        NoteKind::Incomplete => "cells of the merged run are missing",
        NoteKind::Unfinished => {
            "the run ended or went on before figures other than times were read"
        }
        NoteKind::Resumed => "some samples are of an earlier run",
        NoteKind::Unsteady => "the frame time still fell when warm-up ended",
        NoteKind::Imprecise => "sampling stopped before the precision asked for was reached",
        NoteKind::Outliers => "some frames were far slower or faster than the median",
        NoteKind::Throttled => "heat or power throttled the clocks in some samples",
        NoteKind::NotFinite => "a figure was not finite and is left out",
        NoteKind::NotComputed => "a figure could not be computed",
        NoteKind::NoPicture => "a picture could not be written",
    }
}

fn rejected(section: &Section<'_>) -> Markup {
    let frames: u32 = section.measured().map(|(_, measured)| measured.rejected_frames()).sum();
    html! { @if frames > 0 { p.faint { (frames) " timed frames were rejected; “Trust” lists the reasons." } } }
}

/// Assets that were absent, and what stood for them.
fn stand_ins<'n>(section: &'n Section<'_>) -> IndexSet<&'n str> {
    section.entries.iter().flat_map(|entry| &entry.cell.stand_ins).map(String::as_str).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{overlaid, written};
    use fathom_experiments::fixtures;
    use fathom_record::{Cell, Note};

    #[test]
    fn every_experiment_has_a_target_for_the_links_of_its_claims() {
        let text = written(write, &fixtures::run());
        for id in Experiment::builtin_ids() {
            assert!(text.contains(&format!("id=\"plot-{id}\"")), "{id}");
            assert!(text.contains(&format!("href=\"{id}.svg\"")), "{id}");
        }
    }

    #[test]
    fn a_kind_of_note_is_told_once() {
        let mut records = fixtures::run();
        let cells = fixtures::cells(&mut records).filter(|cell| cell.experiment == "uw-photons");
        for (number, measured) in cells.filter_map(Cell::measured_mut).take(3).enumerate() {
            measured.notes.push(Note::new(NoteKind::Imprecise, format!("at {number} %")));
        }
        let text = written(write, &records);
        assert_eq!(text.matches(meaning(NoteKind::Imprecise)).count(), 1);
        assert!(text.contains("3 notes: ") && text.contains("at 2 %"));
    }

    #[test]
    fn an_overlay_names_the_run_of_each_plot_and_links_no_file() {
        let text = overlaid(write);
        assert_eq!(text.matches("id=\"plot-uw-photons\"").count(), 1);
        assert_eq!(text.matches("aria-label=\"uw-photons: ").count(), 2);
        assert!(["<h3>one", "<h3>two"].iter().all(|label| text.contains(label)), "{text}");
        assert!(!text.contains(".svg\""));
    }

    #[test]
    fn no_records_have_no_plots() {
        assert_eq!(written(write, &[]), "");
    }
}
