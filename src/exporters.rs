//! Every report that is made from the records of a run or of a comparison. The same records give the same bytes.
//! Adding one costs a file and an entry in `OF_RUNS` or `OF_COMPARISONS`.

use std::path::{Path, PathBuf};

use itertools::Itertools;
use thiserror::Error;

use crate::compare::store::{StoreError, StoredComparison, holds_comparison};
use crate::compare::tables::{self, Format};
use crate::compare::verdict::Verdicts;
use crate::harness::output::RECORDS;
use crate::record::{Reading, Record};
use crate::report::{self, Artifact, ReportError, ReportView};

/// Exporters of runs, in the order in which their files are written.
const OF_RUNS: [report::Exporter; 4] =
    [report::PLOTS, report::ROOFLINES, report::CELLS_CSV, report::SUMMARY];

/// Formats of comparisons, in the order in which their files are written.
pub const OF_COMPARISONS: [Format; 5] =
    [tables::TERMINAL, tables::MARKDOWN, tables::JUNIT, tables::BENCHER, tables::BENCHMARK];

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
