//! Every report that is made from the records of a run or of a comparison. The same records give the same bytes.
//! Adding one costs a file and an entry in `OF_RUNS` or `OF_COMPARISONS`.

use std::io;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow, bail, ensure};
use itertools::Itertools;

use crate::folder::Dir;
use crate::judge::files::RunFile;
use crate::judge::store::{Comparison, holds_comparison};
use crate::judge::verdict::Verdicts;
use crate::private;
use crate::record::output::RECORDS;
use crate::record::{self, RecordFile};
use crate::report::charts::png::Rasterizer;
use crate::report::comparison::on_page;
use crate::report::page::{self, ComparisonOnPage, Page};
use crate::report::{
    Artifact, Exported, Exporter, OF_RUNS, Report, RunExporter, SkippedInput, Timing,
};
use crate::text;

pub use crate::report::comparison::OF_COMPARISONS;

pub fn comparison_files(verdicts: &Verdicts<'_>) -> Vec<Artifact> {
    let written = OF_COMPARISONS.iter().filter(|e| e.written == Timing::WithEveryReport);
    written.flat_map(|exporter| exporter.one((exporter.export)(verdicts)).files()).collect()
}

/// Whether there is a format of this name: told before a folder is read.
pub fn check_format(name: &str) -> anyhow::Result<()> {
    let meant = text::did_you_mean(name, exporter_names());
    let is_known = exporter_names().any(|known| known == name);
    is_known.then_some(()).with_context(|| format!("unknown format `{}`{meant}", text::line(name)))
}

/// One of the formats that there are, of the records that were read in a folder.
pub fn export(name: &str, folder: &Path, reading: RecordFile) -> anyhow::Result<Exported> {
    let (held, formats) = if holds_comparison(&reading.records) {
        if let Some(exporter) = OF_COMPARISONS.iter().find(|exporter| exporter.name == name) {
            let comparison = Comparison::from_reading(reading, &folder.join(RECORDS))?;
            return Ok(exporter.one((exporter.export)(&Verdicts::judge(&comparison))));
        }
        ("a comparison", OF_COMPARISONS.iter().map(|exporter| exporter.name).join(", "))
    } else {
        if let Some(exporter) = OF_RUNS.iter().find(|exporter| exporter.name == name) {
            return Ok(exporter.run(&Report::new(&reading.records, Some(folder))));
        }
        ("a run", OF_RUNS.iter().map(|exporter| exporter.name).join(", "))
    };
    let folder = folder.display();
    bail!("{folder} holds {held}, which cannot be written as `{name}`, only as {formats}")
}

fn exporter_names() -> impl Iterator<Item = &'static str> {
    let of_runs = OF_RUNS.iter().map(|exporter| exporter.name);
    of_runs.chain(OF_COMPARISONS.iter().map(|exporter| exporter.name)).unique()
}

/// Name, what it is a format of, file, when that is written, and description of each exporter.
pub fn listing() -> Vec<[String; 5]> {
    fn row<F>(of: &str, exporter: &Exporter<F>) -> [String; 5] {
        let Exporter { name, about, file, written, .. } = exporter;
        [name, of, file, written.to_string().as_str(), about].map(str::to_owned)
    }
    let of_runs = OF_RUNS.iter().map(|exporter| row("run", exporter));
    let of_comparisons = OF_COMPARISONS.iter().map(|e| row("comparison", e));
    of_runs.chain(of_comparisons).collect()
}

/// Writes the files of a folder's records beside them, plots as PNG too where a rasterizer is given. Gives their paths. A run's link the pictures that lie there.
pub fn write(
    folder: &Path,
    reading: RecordFile,
    png: Option<&Rasterizer>,
) -> anyhow::Result<Vec<PathBuf>> {
    if holds_comparison(&reading.records) {
        ensure!(png.is_none(), "a comparison has no plots for --png");
        let comparison = Comparison::from_reading(reading, &folder.join(RECORDS))?;
        return write_artifacts(folder, comparison_files(&Verdicts::judge(&comparison)));
    }
    let left_out =
        SkippedInput::lines(&folder.join(RECORDS), &reading.damaged).into_iter().collect();
    let view = Report { left_out, ..Report::new(&reading.records, Some(folder)) };
    let pngs = png.map(|png| png.pictures(&view)).transpose()?.unwrap_or_default();
    Ok([write_view(folder, &view)?, write_artifacts(folder, pngs)?].concat())
}

/// Writes the files of a run beside its records, and gives their paths.
pub fn write_view(folder: &Path, view: &Report<'_>) -> anyhow::Result<Vec<PathBuf>> {
    let written = OF_RUNS.iter().filter(|exporter| exporter.written == Timing::WithEveryReport);
    let export = |exporter: &RunExporter| write_artifacts(folder, exporter.run(view).files());
    written.map(export).flatten_ok().collect()
}

/// Several folders of runs and comparisons. What cannot be read is left out and listed.
#[derive(Default)]
pub struct ReportFolders {
    runs: Vec<RunFile>,
    comparisons: Vec<ComparisonOnPage>,
    left_out: Vec<SkippedInput>,
}

impl ReportFolders {
    /// Where nothing can be read the first folder's error is returned.
    pub fn read(folders: &[PathBuf]) -> anyhow::Result<Self> {
        let mut all = Self::default();
        let mut errors = Vec::new();
        for folder in folders {
            if let Err(error) = all.add(folder) {
                let reason = private::redact(&format!("{error:#}"));
                all.left_out.push(SkippedInput::new(private::path(folder), reason));
                errors.push(error);
            }
        }
        if all.runs.is_empty() && all.comparisons.is_empty() {
            return Err(errors.swap_remove(0));
        }
        Ok(all)
    }

    fn add(&mut self, folder: &Path) -> anyhow::Result<()> {
        let path = folder.join(RECORDS);
        let reading = record::read_good(&path)?;
        self.left_out.extend(SkippedInput::lines(&path, &reading.damaged));
        if holds_comparison(&reading.records) {
            let comparison = Comparison::from_reading(reading, &path)?;
            self.comparisons.push(on_page(&Verdicts::judge(&comparison)));
        } else {
            self.runs.push(RunFile { path, reading });
        }
        Ok(())
    }

    /// One page of all.
    pub fn page(self) -> Artifact {
        let Self { runs, comparisons, left_out } = self;
        let views = runs.iter().map(|RunFile { path, reading }| {
            let folder = path.parent().unwrap_or(Path::new(""));
            (folder, Report::new(&reading.records, Some(folder)))
        });
        Page { comparisons, left_out, ..Page::new(page::labelled(&views.collect_vec())) }.file()
    }
}

fn unwritable(path: &Path) -> impl Fn(io::Error) -> anyhow::Error {
    move |source| anyhow!("cannot write {}: {source}", path.display())
}

/// Writes files into a folder, which is made if need be, and gives their paths.
pub fn write_artifacts(folder: &Path, files: Vec<Artifact>) -> anyhow::Result<Vec<PathBuf>> {
    let opened = Dir::make(folder).map_err(unwritable(folder))?;
    let write = |file: Artifact| {
        let path = folder.join(&file.name);
        opened.write(&file.name, &file.bytes).map_err(unwritable(&path))?;
        Ok(path)
    };
    files.into_iter().map(write).collect()
}
