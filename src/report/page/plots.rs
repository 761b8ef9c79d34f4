//! Each experiment with its plot: what was done, after what publication, what its claims came to, and what to know of its cells.

use indexmap::{IndexMap, IndexSet};
use itertools::Itertools;

use super::claims::verdict_mark;
use super::{Fold, Page, PageRun, PageSection};
use crate::document::{self, Block, Line, Span, Tone};
use crate::format::count_noun;
use crate::{Section, charts};
use fathom_record::NoteKind;
use strum::EnumMessage as _;

pub const SECTION: PageSection = PageSection {
    id: "plots",
    title: "Experiments",
    question: "What was each experiment, with its plot and its notes?",
    fold: Fold::Listed,
    write: |page| document::html_if_any(parts(page)),
};

fn parts<'p>(page: &'p Page<'p>) -> Vec<Block> {
    let sections = page.runs.iter().flat_map(|run| &run.view.sections);
    let ids: IndexSet<&str> = sections.map(|section| section.id).collect();
    let lead = "What was done in each experiment, after which publication, with its plot. Intervals in plots are of 95 %; those of claims are wider.";
    let lead = (!ids.is_empty()).then(|| Block::paragraph(lead));
    lead.into_iter().chain(ids.into_iter().map(|id| experiment(page, id))).collect()
}

fn experiment<'p>(page: &'p Page<'p>, id: &str) -> Block {
    let of_run = |run: &'p PageRun<'p>| {
        Some((run, run.view.sections.iter().find(|section| section.id == id)?))
    };
    let of_runs: Vec<_> = page.runs.iter().filter_map(of_run).collect();
    let title = of_runs.first().map_or(id, |(_, section)| section.title());
    let mut summary = Line::from(Span::Bold(id.to_owned())).and(format!(": {title}"));
    let definition = of_runs.iter().find_map(|(_, section)| section.experiment.as_ref());
    let mut parts = Vec::new();
    if let Some(definition) = definition {
        parts.push(faint(format!("Source: {}", definition.source)));
        let about = definition.about.split("\n\n").filter(|text| !text.is_empty());
        parts.extend(about.map(Block::paragraph));
    }
    for (run, section) in of_runs {
        summary.0.extend(tally(section));
        parts.extend(page.heading(run));
        parts.extend(outcome(page, section));
    }
    Block::Topic(format!("plot-{id}"), summary, parts)
}

/// How many claims have each verdict.
fn tally(section: &Section<'_>) -> Vec<Span> {
    let counts = section.rulings().iter().counts_by(|ruling| ruling.verdict);
    let same = counts.into_iter().sorted_unstable().flat_map(|(verdict, count)| {
        let chip = Span::Chip(Tone::from_verdict(verdict), verdict.to_string());
        [Span::Words(" ".to_owned()), chip, Span::Words(format!(" × {count}"))]
    });
    same.collect()
}

fn outcome(page: &Page<'_>, section: &Section<'_>) -> Vec<Block> {
    let problem = section.problem.iter().map(|problem| {
        let chip = Span::Chip(Tone::Open, "no claims and plots".to_owned());
        Block::paragraph(Line::from(chip).and(format!(": {problem}")))
    });
    let claim = |ruling| Line::from(verdict_mark(ruling)).and(format!(" {}", ruling.text));
    let mut parts: Vec<Block> = problem.collect();
    parts.push(Block::list(section.rulings().iter().map(claim)));
    if let Some(svg) = &section.figure().svg {
        parts.push(Block::Chart(svg.clone()));
        let file = || {
            let (words, to) = ("The plot as a file".to_owned(), charts::file_name(section));
            Block::paragraph(Span::Link { words, to })
        };
        parts.extend((!page.is_overlay()).then(file));
    }
    let missing = section.figure().missing.iter();
    parts.extend(
        missing.map(|(title, why)| faint(format!("The plot “{title}” is left out: {why}."))),
    );
    parts.extend(notes(section));
    parts
}

fn faint(words: String) -> Block {
    Block::paragraph(Span::Faint(words))
}

/// Each kind of note is told once, with the cells that have it folded away.
fn notes(section: &Section<'_>) -> Vec<Block> {
    let mut kinds = IndexMap::<NoteKind, Vec<String>>::new();
    for (cell, measured) in section.measured() {
        for note in &measured.notes {
            kinds.entry(note.kind).or_default().push(format!("{}: {}", cell.cell, note.text));
        }
    }
    let fold = |(kind, of_cells): (NoteKind, Vec<String>)| {
        let about = kind.get_documentation().unwrap_or_default();
        let words = format!("{}: {about}", count_noun(of_cells.len(), "note"));
        Block::Fold(words.into(), vec![Block::list(of_cells)])
    };
    let frames: u32 = section.measured().map(|(_, measured)| measured.rejected_frames()).sum();
    let rejected = format!("{frames} timed frames were rejected; “Trust” lists the reasons.");
    let stand_ins: IndexSet<&String> =
        section.entries.iter().flat_map(|entry| &entry.cell.stand_ins).collect();
    let remarks = (frames > 0).then_some(rejected).into_iter();
    let remarks = remarks.chain(stand_ins.into_iter().cloned()).map(faint);
    kinds.into_iter().map(fold).chain(remarks).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{overlaid, written};
    use fathom_experiments::{Experiment, fixtures};
    use fathom_record::{Cell, Note};

    #[test]
    fn every_experiment_has_a_target_for_the_links_of_its_claims() {
        let text = written(SECTION.write, &fixtures::run());
        for id in Experiment::builtin_ids() {
            assert!(text.contains(&format!("id=\"plot-{id}\"")), "{id}");
            assert!(text.contains(&format!("href=\"{id}.svg\"")), "{id}");
        }
        assert_eq!(written(SECTION.write, &[]), "");
    }

    #[test]
    fn a_kind_of_note_is_told_once() {
        let mut records = fixtures::run();
        let cells = fixtures::cells(&mut records).filter(|cell| cell.experiment == "uw-photons");
        for (number, measured) in cells.filter_map(Cell::measured_mut).take(3).enumerate() {
            measured.notes.push(Note::new(NoteKind::Imprecise, format!("at {number} %")));
        }
        let text = written(SECTION.write, &records);
        assert_eq!(text.matches("3 notes: Sampling stopped before").count(), 1);
        assert!(text.contains("at 2 %"));
    }

    #[test]
    fn an_overlay_names_the_run_of_each_plot_and_links_no_file() {
        let text = overlaid(SECTION.write);
        assert_eq!(text.matches("id=\"plot-uw-photons\"").count(), 1);
        assert_eq!(text.matches("aria-label=\"uw-photons: ").count(), 2);
        assert!(["<h3>one", "<h3>two"].iter().all(|label| text.contains(label)), "{text}");
        assert!(!text.contains(".svg\""));
    }
}
