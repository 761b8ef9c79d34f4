//! Reports: pure functions from records to bytes. The same records give the same bytes.
//!
//! A [`RunExporter`] turns a [`Report`] of a run's records into files.

pub mod axis;
pub mod bencher;
pub mod ceilings;
mod cells_csv;
pub mod changes;
pub mod charts;
mod claims;
pub mod colors;
pub mod comparison;
pub mod document;
pub mod facts;
pub mod format;
pub mod noise;
pub mod page;
pub mod sizes;
mod summary;
#[cfg(test)]
mod testing;
pub mod trust;
mod view;

pub use bencher::EXPORTER as BENCHER;
pub use cells_csv::EXPORTER as CELLS_CSV;
pub use charts::EXPORTER as PLOTS;
pub use claims::EXPORTER as CLAIMS;
pub use page::EXPORTER as PAGE;
pub use page::overview::terminal_summary;
pub use summary::EXPORTER as SUMMARY;
pub use trust::conditions as run_conditions;

use std::path::Path;

use fathom_record::Record;

pub use fathom_judge::claims::RunCell;
pub use view::{Report, Section, SkippedInput, shown_file};

/// A file of the report: its name within the output folder, and its bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Artifact {
    pub name: String,
    pub bytes: Vec<u8>,
}

impl Artifact {
    pub fn new(name: impl Into<String>, text: String) -> Artifact {
        Artifact { name: name.into(), bytes: text.into_bytes() }
    }
}

/// A format of reports.
pub struct Exporter<F> {
    /// Its identifier on the command line, such as `csv`.
    pub name: &'static str,
    /// What the format is, in one line.
    pub about: &'static str,
    /// The name of its file. Where there are several, a word in capitals stands for the experiment.
    pub file: &'static str,
    pub written: Timing,
    /// Makes what the files hold.
    pub export: F,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, strum::Display)]
pub enum Timing {
    #[strum(to_string = "with every report")]
    WithEveryReport,
    #[strum(to_string = "on request")]
    OnRequest,
}

/// A format of a run.
pub type RunExporter = Exporter<RunFormat>;

pub enum RunFormat {
    /// The text of one file.
    One(fn(&Report<'_>) -> String),
    /// A file for each experiment.
    Several(fn(&Report<'_>) -> Vec<Artifact>),
}

/// What an exporter made.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Exported {
    One(Artifact),
    /// A file for each experiment, however many there are.
    Several(Vec<Artifact>),
}

impl Exported {
    pub fn files(self) -> Vec<Artifact> {
        match self {
            Self::One(file) => vec![file],
            Self::Several(files) => files,
        }
    }
}

impl<F> Exporter<F> {
    /// Its only file with this text.
    pub fn one(&self, text: String) -> Exported {
        Exported::One(Artifact::new(self.file, text))
    }
}

impl RunExporter {
    /// Its files.
    pub fn run(&self, view: &Report<'_>) -> Exported {
        match self.export {
            RunFormat::One(export) => self.one(export(view)),
            RunFormat::Several(export) => Exported::Several(export(view)),
        }
    }
}

/// Exporters of runs, in the order in which their files are written.
pub const OF_RUNS: [RunExporter; 6] = [PLOTS, CELLS_CSV, PAGE, SUMMARY, CLAIMS, BENCHER];

/// The files of a run's report. Pictures are shown that lie in `folder`.
pub fn report_files(records: &[Record], folder: Option<&Path>) -> Vec<Artifact> {
    let view = Report::new(records, folder);
    let written = OF_RUNS.iter().filter(|exporter| exporter.written == Timing::WithEveryReport);
    written.flat_map(|exporter| exporter.run(&view).files()).collect()
}
