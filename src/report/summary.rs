//! `summary.md`: what a run says within a minute, on at most [`MOST_LINES`] lines. Everything else is on the page and in
//! `cells.csv`.

use indexmap::IndexSet;

use super::document::{self, Line, Part, Span};
use super::page::{self, Page, PageRun, overview};
use super::{CELLS_CSV, Exporter, OfRun, ReportView, RunExporter, Section, Written, facts};

pub const EXPORTER: RunExporter = Exporter {
    name: "markdown",
    about: "verdicts, where the time goes and how it scales, on at most 200 lines",
    file: "summary.md",
    written: Written::WithEveryReport,
    export: OfRun::One(export),
};

/// Lines of the summary of any run. Each table has a limit of its own, so that all of them stay below it.
#[cfg(test)]
const MOST_LINES: usize = 200;

/// Rows of tables: of the papers' claims that are not supported, of own hypotheses, of stages, of exponents.
const MOST_CLAIMS: [usize; 2] = [36, 10];
const MOST_STAGES: usize = 30;
const MOST_EXPONENTS: usize = 20;
const MOST_NOTES: usize = 5;

fn export(view: &ReportView<'_>) -> String {
    let Some(run) = view.run() else {
        return "# fathom\n\nThe records hold no run.\n".to_owned();
    };
    let link = |words: &str, to: &str| {
        Line::from(Span::Link { words: words.to_owned(), to: to.to_owned() })
    };
    let place = link("page", page::FILE);
    let mut parts = overview::doubts(view);
    // Of exponents there is a table, and of limits the page has one.
    for card in overview::cards(view).into_iter().take(3) {
        parts.push(Part::paragraph(Span::Bold(card.question.to_owned())));
        parts.extend(card.parts);
    }
    parts.extend(overview::identity(view).map(Part::Table));
    let files = place.clone().and(" and ").and(link(CELLS_CSV.file, CELLS_CSV.file));
    parts.push(Part::Paragraph(Line::from("Every cell, picture and plot: ").and(files)));
    parts.extend(Part::list(notes(view)).cut(MOST_NOTES, &place));
    let page = Page::new(vec![PageRun { label: String::new(), view }]);
    for (title, of_section, most) in [
        ("Claims", page::claims::parts(&page), &MOST_CLAIMS[..]),
        ("Where the time goes", page::time::parts(&page), &[MOST_STAGES]),
        ("How it scales", page::scaling::parts(&page), &[MOST_EXPONENTS]),
    ] {
        parts.extend((!of_section.is_empty()).then(|| Part::Title(title.into())));
        parts.extend(shortened(of_section, most, &place));
    }
    let title = Line::from(format!("fathom on {}", run.adapter.title()));
    format!("# {}\n\n{}", title.markdown(), document::markdown(&parts))
}

/// At most so many rows below each heading, or in all where there is one number. What is folded gets the rows that the tables before it leave.
fn shortened(parts: Vec<Part>, most: &[usize], place: &Line) -> Vec<Part> {
    let mut limits = most.iter().copied();
    let mut left = if most.len() == 1 { most[0] } else { 0 };
    let cut = |part: Part| match part {
        Part::Heading(_) => {
            left = limits.next().unwrap_or(left);
            vec![part]
        }
        Part::Table(table) => {
            let (most, rows) = (left, table.rows.len());
            left = left.saturating_sub(rows);
            Part::Table(table).cut(most, place)
        }
        Part::Fold(words, folded) if left > 0 => {
            let tables = folded.into_iter().flat_map(|part| part.cut(left, place));
            std::iter::once(Part::Paragraph(words)).chain(tables).collect()
        }
        part => part.cut(0, place),
    };
    parts.into_iter().flat_map(cut).collect()
}

/// Notes on the run, the stand-ins that cells ran on, and what cannot be shown, once each.
fn notes(view: &ReportView<'_>) -> IndexSet<String> {
    let of_runs = view.runs.iter().flat_map(|run| &run.notes).map(|note| &note.text);
    let stand_ins = view.entries().flat_map(|entry| &entry.cell.stand_ins);
    let mut all: IndexSet<String> = of_runs.chain(stand_ins).cloned().collect();
    let left_out = view.left_out.iter();
    all.extend(left_out.map(|left_out| format!("left out: {}", left_out.line())));
    all.extend(view.sections.iter().flat_map(left_out_of));
    all.extend(facts::ended_early(view));
    all
}

/// What an experiment cannot show, and why.
fn left_out_of(section: &Section<'_>) -> Vec<String> {
    let problem = section.problem.iter();
    let problem =
        problem.map(|problem| format!("{} has no claims and plots: {problem}", section.id));
    let missing = section.figure().missing.iter();
    let missing = missing.map(|(title, reason)| {
        format!("The plot “{title}” of {} is left out: {reason}", section.id)
    });
    problem.chain(missing).collect()
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::of_run as artifacts;
    use fathom_experiments::fixtures;
    use fathom_record::{Cell, Definition, Record};

    fn written(records: &[Record]) -> String {
        let page = EXPORTER.run(&ReportView::new(records, None));
        String::from_utf8(page.files().remove(0).bytes).unwrap()
    }

    #[test]
    fn the_same_records_give_the_same_bytes() {
        let records = fixtures::run();
        assert_eq!(artifacts(&records, None), artifacts(&records, None));
    }

    #[test]
    fn a_run_ends_with_its_verdicts_and_slowest_stages() {
        let records = fixtures::run();
        let view = ReportView::new(&records, None);
        let lines = overview::in_short(&view);
        let tallies: Vec<String> =
            crate::facts::tallies(&view).map(|(whose, _)| whose.to_string()).collect();
        assert_eq!(lines.len(), 4 + tallies.len(), "{lines:?}");
        assert!(lines[0].starts_with("quiet run: ") && lines[0].ends_with(" cells reached ±2 %"));
        assert!(lines[1].contains("load and steal time not recorded"));
        assert!(lines[2].starts_with("to do: add samples"));
        for (line, whose) in lines[3..].iter().zip(&tallies) {
            assert!(line.starts_with(whose) && line.contains(" supported, "), "{line}");
        }
        assert!(
            lines[3 + tallies.len()].starts_with("slowest stage of each pipeline: underwater: ")
        );
        assert!(overview::in_short(&ReportView::new(&[], None)).is_empty());
    }

    /// Of no records, and of cells that were all skipped: every report is written, and says nothing that was not measured.
    #[test]
    fn reports_of_nothing_are_written_all_the_same() {
        for records in [Vec::new(), fixtures::all_skipped()] {
            let files = artifacts(&records, None);
            assert!(files.iter().any(|file| file.name == "summary.md"));
            assert!(files.iter().all(|file| !file.name.ends_with(".svg")));
            assert!(!written(&records).contains("NaN"));
        }
    }

    /// The records of a run many times, each time with other experiments and pipelines.
    fn many_times(count: usize) -> Vec<Record> {
        let renamed = |record: &Record, time: usize| match record {
            Record::Experiment(definition) => {
                let id = format!("{}-{time}", definition.id);
                let toml = definition.toml.replacen(
                    &format!("id = \"{}\"", definition.id),
                    &format!("id = \"{id}\""),
                    1,
                );
                Some(Record::Experiment(Definition { id, toml }))
            }
            Record::Cell(cell) => Some(Record::Cell(Box::new(Cell {
                experiment: format!("{}-{time}", cell.experiment),
                pipeline: format!("{}-{time}", cell.pipeline),
                params: json!({ "view": cell.params.get("view") }).into(),
                ..*cell.clone()
            }))),
            _ => None,
        };
        let one = fixtures::run();
        let copies = (0..count).flat_map(|time| one.iter().filter_map(move |r| renamed(r, time)));
        let copies: Vec<Record> = copies.collect();
        one.iter().cloned().chain(copies).collect()
    }

    #[test]
    fn the_summary_of_any_run_has_at_most_200_lines_and_says_what_is_left_out() {
        let one = written(&fixtures::run());
        assert!(one.lines().count() <= MOST_LINES, "{}", one.lines().count());
        let many = written(&many_times(4));
        assert!(many.lines().count() <= MOST_LINES, "{}", many.lines().count());
        assert!(many.matches("more on the [page](index.html)").count() >= 4, "{many}");
    }
}
