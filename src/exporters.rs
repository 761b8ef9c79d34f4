//! Every way to tell the records of a folder, of a run or of a comparison. The same records give the same bytes.
//! Adding one costs a file and a line in [`EXPORTERS`].

use std::path::{Path, PathBuf};

use thiserror::Error;

use crate::compare::store::{StoreError, StoredComparison, holds_comparison};
use crate::compare::tables::{self, Format};
use crate::compare::verdict::Verdicts;
use crate::harness::output::RECORDS;
use crate::record::{Reading, Record};
use crate::report::{self, Artifact, ReportError, View};

/// By what the records hold.
pub enum Exporter {
    Run(report::Exporter),
    Comparison(Format),
}

/// Every exporter, in the order in which their files are written.
pub const EXPORTERS: &[Exporter] = &[
    Exporter::Run(report::PLOTS),
    Exporter::Run(report::CELLS_CSV),
    Exporter::Run(report::SUMMARY),
    Exporter::Comparison(tables::TERMINAL),
    Exporter::Comparison(tables::MARKDOWN),
    Exporter::Comparison(tables::JUNIT),
    Exporter::Comparison(tables::BENCHER),
    Exporter::Comparison(tables::BENCHMARK),
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

/// Formats in which a comparison can be printed.
pub fn formats() -> impl Iterator<Item = &'static Format> {
    EXPORTERS.iter().filter_map(|exporter| match exporter {
        Exporter::Comparison(format) => Some(format),
        Exporter::Run(_) => None,
    })
}

/// The files that tell a run. Pictures are linked that lie in `folder`; without one, all that the records name.
pub fn of_run(records: &[Record], folder: Option<&Path>) -> Result<Vec<Artifact>, ReportError> {
    let view = View::new(records, folder);
    let mut files = Vec::new();
    for exporter in EXPORTERS {
        if let Exporter::Run(exporter) = exporter {
            files.extend((exporter.export)(&view)?);
        }
    }
    Ok(files)
}

/// The files that tell a comparison.
pub fn of_comparison(verdicts: &Verdicts<'_>) -> Vec<Artifact> {
    let file = |format: &Format| {
        let bytes = (format.write)(verdicts).into_bytes();
        Some(Artifact { name: format.file?.to_owned(), bytes })
    };
    formats().filter_map(file).collect()
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
