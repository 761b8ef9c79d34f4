//! `summary.md`: what a run says within a minute, on at most [`MAX_LINES`] lines. Everything else is on the page and in
//! `cells.csv`.

use indexmap::IndexSet;

use super::document::{self, Block, Line, Span};
use super::page::{self, Page, PageRun, overview};
use super::{CELLS_CSV, Exporter, Report, RunExporter, RunFormat, Section, Timing, facts, sizes};

pub const EXPORTER: RunExporter = Exporter {
    name: "markdown",
    about: "verdicts, where the time goes and how it scales, on at most 200 lines",
    file: "summary.md",
    written: Timing::WithEveryReport,
    export: RunFormat::One(export),
};

/// Lines of the summary of any run. Each table has a limit of its own, so that all of them stay below it.
#[cfg(test)]
const MAX_LINES: usize = 200;

/// Rows of tables: of the papers' claims that are not supported, of own hypotheses, of stages, of exponents.
const MAX_CLAIMS: [usize; 2] = [36, 10];
const MAX_STAGES: usize = 30;
const MAX_EXPONENTS: usize = 18;
const MAX_NOTES: usize = 5;
/// Of a sweep: rows, and headings and tables.
const MAX_SIZES: usize = 60;
const MAX_BLOCKS: usize = 16;

fn export(view: &Report<'_>) -> String {
    let Some(run) = view.run() else {
        return "# fathom\n\nThe records hold no run.\n".to_owned();
    };
    let link = |words: &str, to: &str| {
        Line::from(Span::Link { words: words.to_owned(), to: to.to_owned() })
    };
    let place = link("page", page::FILE);
    let mut parts = shortened(sizes::parts(view, &|_, _| None), &[MAX_SIZES], &place);
    parts.truncate(MAX_BLOCKS);
    parts.extend(overview::caveats(view));
    // Of exponents there is a table, and of limits the page has one.
    for card in overview::cards(view).into_iter().take(3).filter(|card| !card.parts.is_empty()) {
        parts.push(Block::paragraph(Span::Bold(card.question.to_owned())));
        parts.extend(card.parts);
    }
    parts.extend(overview::identity(view).map(Block::Table));
    let files = place.clone().and(" and ").and(link(CELLS_CSV.file, CELLS_CSV.file));
    parts.push(Block::Paragraph(Line::from("Every cell, picture and plot: ").and(files)));
    parts.extend(Block::list(notes(view)).truncate(MAX_NOTES, &place));
    let page = Page::new(vec![PageRun { label: String::new(), view }]);
    for (title, of_section, max_rows) in [
        ("Claims", page::claims::parts(&page), &MAX_CLAIMS[..]),
        ("Where the time goes", page::time::parts(&page), &[MAX_STAGES]),
        ("How it scales", page::scaling::parts(&page), &[MAX_EXPONENTS]),
    ] {
        parts.extend((!of_section.is_empty()).then(|| Block::Title(title.into())));
        parts.extend(shortened(of_section, max_rows, &place));
    }
    let title = Line::from(format!("fathom on {}", run.adapter.title()));
    format!("# {}\n\n{}", title.markdown(), document::markdown(&parts))
}

/// At most so many rows below each heading, or in all where there is one number. What is folded gets the rows that the tables before it leave.
fn shortened(parts: Vec<Block>, max_rows: &[usize], place: &Line) -> Vec<Block> {
    let mut limits = max_rows.iter().copied();
    let mut remaining_rows = if max_rows.len() == 1 { max_rows[0] } else { 0 };
    let cut = |part: Block| match part {
        Block::Heading(_) => {
            remaining_rows = limits.next().unwrap_or(remaining_rows);
            vec![part]
        }
        Block::Table(table) => {
            let (limit, rows) = (remaining_rows, table.rows.len());
            remaining_rows = remaining_rows.saturating_sub(rows);
            Block::Table(table).truncate(limit, place)
        }
        Block::Fold(words, folded) if remaining_rows > 0 => {
            let tables = folded.into_iter().flat_map(|part| part.truncate(remaining_rows, place));
            std::iter::once(Block::Paragraph(words)).chain(tables).collect()
        }
        part => part.truncate(0, place),
    };
    parts.into_iter().flat_map(cut).collect()
}

/// Notes on the run, the stand-ins that cells ran on, and what cannot be shown, once each.
fn notes(view: &Report<'_>) -> IndexSet<String> {
    let of_runs = view.runs.iter().flat_map(|run| &run.notes).map(|note| &note.text);
    let stand_ins = view.entries().flat_map(|entry| &entry.cell.stand_ins);
    let mut all: IndexSet<String> = of_runs.chain(stand_ins).cloned().collect();
    let left_out = view.left_out.iter();
    all.extend(left_out.map(|left_out| format!("left out: {}", left_out.line())));
    all.extend(view.sections.iter().flat_map(missing_parts));
    all.extend(facts::ended_early(view));
    all
}

fn missing_parts(section: &Section<'_>) -> Vec<String> {
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
    use crate::report_files as artifacts;
    use fathom_experiments::fixtures;
    use fathom_record::{Cell, Definition, Record};

    fn written(records: &[Record]) -> String {
        let page = EXPORTER.run(&Report::new(records, None));
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
        let view = Report::new(&records, None);
        let lines = overview::terminal_summary(&view);
        let tallies: Vec<String> =
            crate::facts::tallies(&view).map(|(whose, _)| whose.to_string()).collect();
        assert_eq!(lines.len(), 3 + tallies.len(), "{lines:?}");
        assert!(
            lines[0].starts_with("quiet run: frame times scatter by ")
                && lines[0].contains(" (bound 5 %); ")
        );
        assert!(lines[1].contains("load and steal time not recorded"));
        let counted = lines[0].rsplit("; ").next().unwrap().split_once(" of ").unwrap();
        assert_eq!(counted.1, format!("{} timed cells have an interval", counted.0));
        for (line, whose) in lines[2..].iter().zip(&tallies) {
            assert!(line.starts_with(whose) && line.contains(" supported, "), "{line}");
        }
        assert!(
            lines[2 + tallies.len()].starts_with("slowest stage of each pipeline: underwater: ")
        );
        assert!(overview::terminal_summary(&Report::new(&[], None)).is_empty());
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
        assert!(one.lines().count() <= MAX_LINES, "{}", one.lines().count());
        let many = written(&many_times(4));
        assert!(many.lines().count() <= MAX_LINES, "{}", many.lines().count());
        assert!(many.matches("more on the [page](index.html)").count() >= 4, "{many}");
    }
}
