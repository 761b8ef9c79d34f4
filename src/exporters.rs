//! Every report that is made from the records of a run or of a comparison. The same records give the same bytes.
//! Adding one costs a file and an entry in `OF_RUNS` or `OF_COMPARISONS`.

use std::path::{Path, PathBuf};

use indexmap::IndexMap;
use itertools::Itertools;
use thiserror::Error;

use crate::compare::store::{StoreError, StoredComparison, holds_comparison};
use crate::compare::tables::{self, Format};
use crate::compare::verdict::Verdicts;
use crate::harness::output::RECORDS;
use crate::record::{self, Reading, Record};
use crate::report::page::{self, ComparisonOnPage, LeftOut, Page};
use crate::report::{self, Artifact, ReportError, ReportView};

/// Exporters of runs, in the order in which their files are written.
const OF_RUNS: [report::Exporter; 4] =
    [report::PLOTS, report::CELLS_CSV, report::PAGE, report::SUMMARY];

/// Formats of comparisons, in the order in which their files are written.
pub const OF_COMPARISONS: [Format; 6] = [
    tables::TERMINAL,
    tables::MARKDOWN,
    tables::PAGE,
    tables::JUNIT,
    tables::BENCHER,
    tables::BENCHMARK,
];

#[derive(Debug, Error)]
pub enum ExportError {
    #[error(transparent)]
    Report(#[from] ReportError),
    #[error(transparent)]
    Comparison(#[from] StoreError),
    #[error("cannot write {}: {source}", path.display())]
    Write { path: PathBuf, source: std::io::Error },
}

/// The files of a run's report. Pictures are linked that lie in `folder`; without one, all that the records name.
pub fn of_run(records: &[Record], folder: Option<&Path>) -> Result<Vec<Artifact>, ReportError> {
    let view = ReportView::new(records, folder);
    let files = OF_RUNS.iter().map(|exporter| (exporter.export)(&view));
    files.flatten_ok().collect()
}

/// The files of a comparison's report.
pub fn of_comparison(verdicts: &Verdicts<'_>) -> Vec<Artifact> {
    let file = |format: &Format| {
        let bytes = (format.write)(verdicts).into_bytes();
        Some(Artifact { name: format.file?.to_owned(), bytes })
    };
    OF_COMPARISONS.iter().filter_map(file).collect()
}

/// Writes the files of a folder's records beside them, and gives their paths. A run's link the pictures that lie there.
pub fn write(folder: &Path, reading: Reading) -> Result<Vec<PathBuf>, ExportError> {
    if holds_comparison(&reading.records) {
        let comparison = StoredComparison::of(reading, &folder.join(RECORDS))?;
        return put(folder, of_comparison(&Verdicts::of(&comparison)));
    }
    put(folder, of_run(&reading.records, Some(folder))?)
}

/// What a folder gives to a page.
enum Content {
    Run { folder: PathBuf, records: Vec<Record> },
    Comparison(ComparisonOnPage),
}

/// One page of several folders of runs and comparisons. What cannot be read is left out and listed. Where nothing can be read
/// the first folder's error is returned.
pub fn page_of(folders: &[PathBuf]) -> Result<Artifact, ExportError> {
    let (mut contents, mut left_out, mut errors) = (Vec::new(), Vec::new(), Vec::new());
    for folder in folders {
        match content(folder, &mut left_out) {
            Ok(content) => contents.push(content),
            Err(error) => {
                left_out.push(LeftOut::new(folder.display(), &error));
                errors.push(error);
            }
        }
    }
    if contents.is_empty() {
        return Err(errors.swap_remove(0));
    }
    Ok(page(contents, left_out))
}

fn content(folder: &Path, left_out: &mut Vec<LeftOut>) -> Result<Content, ExportError> {
    let path = folder.join(RECORDS);
    let reading = record::read_good(&path).map_err(StoreError::from)?;
    left_out.extend(unread(&path, &reading));
    if holds_comparison(&reading.records) {
        let comparison = StoredComparison::of(reading, &path)?;
        return Ok(Content::Comparison(tables::on_page(&Verdicts::of(&comparison))));
    }
    Ok(Content::Run { folder: folder.to_owned(), records: reading.records })
}

/// The lines of a file that could not be read, those of one reason together.
fn unread(path: &Path, reading: &Reading) -> Vec<LeftOut> {
    let mut by_reason = IndexMap::<&str, Vec<usize>>::new();
    for damage in &reading.damaged {
        by_reason.entry(&damage.reason).or_default().push(damage.line);
    }
    let path = path.display();
    let told = by_reason.into_iter().map(|(reason, lines)| match lines.as_slice() {
        [line] => LeftOut::new(format_args!("{path}, line {line}"), reason),
        [first, .., last] => {
            let lines = format_args!("{path}, {} lines from {first} to {last}", lines.len());
            LeftOut::new(lines, reason)
        }
        [] => unreachable!("a reason comes with its line"),
    });
    told.collect()
}

fn page(contents: Vec<Content>, left_out: Vec<LeftOut>) -> Artifact {
    let (mut runs, mut comparisons) = (Vec::new(), Vec::new());
    for content in contents {
        match content {
            Content::Run { folder, records } => runs.push((folder, records)),
            Content::Comparison(comparison) => comparisons.push(comparison),
        }
    }
    let views: Vec<(&Path, ReportView<'_>)> = runs
        .iter()
        .map(|(folder, records)| (folder.as_path(), ReportView::new(records, Some(folder))))
        .collect();
    Page { comparisons, left_out, ..Page::new(page::labelled(&views)) }.file()
}

/// Writes files into a folder, and gives their paths.
pub fn put(folder: &Path, files: Vec<Artifact>) -> Result<Vec<PathBuf>, ExportError> {
    let write = |file: Artifact| {
        let path = folder.join(&file.name);
        match std::fs::write(&path, &file.bytes) {
            Ok(()) => Ok(path),
            Err(source) => Err(ExportError::Write { path, source }),
        }
    };
    files.into_iter().map(write).collect()
}
