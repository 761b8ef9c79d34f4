//! `summary.md`: what a run says within a minute, on at most [`MOST_LINES`] lines. Everything else is on the page and in
//! `cells.csv`.

mod head;
mod tables;

use super::noise::RunVerdict;
use super::{Exporter, OfRun, ReportView, RunExporter, Written, page};
use fathom_base::text;

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

fn export(view: &ReportView<'_>) -> String {
    let mut text = String::new();
    head::write(view, &mut text);
    tables::claims(view, &mut text);
    tables::frames(view, &mut text);
    tables::scaling(view, &mut text);
    text
}

/// What a run says in a few lines, for the terminal: the verdict on itself, the tally of verdicts and the slowest stages.
pub fn in_short(view: &ReportView<'_>) -> Vec<String> {
    let claims = head::tallies(view).map(|(whose, tally)| format!("{whose}: {tally}"));
    let slowest = head::slowest(view);
    let slowest =
        (!slowest.is_empty()).then(|| format!("slowest stage of each pipeline: {slowest}"));
    let of_run = RunVerdict::of(view).map_or_else(Vec::new, |verdict| verdict.lines());
    of_run.into_iter().chain(claims).chain(slowest).collect()
}

/// The rows that fit, and words on how many are left out.
fn cut<T>(mut rows: Vec<T>, most: usize) -> (Vec<T>, String) {
    let more = rows.len().saturating_sub(most);
    rows.truncate(most);
    let words = if more > 0 {
        format!(" … and {more} more on the [page]({})", page::FILE)
    } else {
        String::new()
    };
    (rows, words)
}

fn link(name: &str, path: &str) -> String {
    format!("[{}]({})", text::markdown(name), text::link(path))
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
    fn the_summary_tells_device_verdicts_and_figures() {
        let text = written(&fixtures::run());
        for expected in [
            "# fathom on llvmpipe",
            "software driver",
            "Absolute times",
            "(uw-photons.svg)",
            "(index.html)",
            "(cells.csv)",
            "\nContradicted",
            "caustics/splat",
        ] {
            assert!(text.contains(expected), "{expected}");
        }
    }

    #[test]
    fn a_run_ends_with_its_verdicts_and_slowest_stages() {
        let records = fixtures::run();
        let view = ReportView::new(&records, None);
        let lines = in_short(&view);
        let tallies: Vec<String> =
            head::tallies(&view).map(|(whose, _)| whose.to_string()).collect();
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
        assert!(in_short(&ReportView::new(&[], None)).is_empty());
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
