//! Reports: pure functions from records to bytes. The same records give the same bytes.
//!
//! An [`Exporter`] turns a [`View`] of the records into named files. Adding one costs a file and a line in [`EXPORTERS`].

mod cells_csv;
pub mod format;
mod plots;
mod summary;
mod view;

#[cfg(test)]
mod fixtures;

use std::path::{Path, PathBuf};

use crate::record::Record;
use crate::text;

pub use view::{Entry, Section, View};

/// Folder, beside the records, of the pictures that a summary links to.
pub const PICTURES: &str = "renders";

/// How the name of a picture ends, before the dot, that shows a cell's error and not its image. No stem ends so.
pub const ERROR_PICTURE: &str = "~error";

/// Name of the picture of an experiment's cell, with `ending` before the dot: `EXPERIMENT_CELL.png`, different for different
/// cells. An id holds no `_`, so that where it ends is plain.
pub fn picture_name(experiment: &str, cell: &str, ending: &str) -> String {
    let [experiment, cell] = [experiment, cell].map(text::file_stem);
    format!("{experiment}_{cell}{ending}.png")
}

#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    #[error("cannot draw the plot of `{experiment}`: {message}")]
    Plot { experiment: String, message: String },
    #[error("cannot write {}: {source}", path.display())]
    Write {
        path: PathBuf,
        source: std::io::Error,
    },
}

/// A file of the report: its name within the output folder, and its bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Artifact {
    pub name: String,
    pub bytes: Vec<u8>,
}

pub struct Exporter {
    pub name: &'static str,
    pub about: &'static str,
    pub export: fn(&View<'_>) -> Result<Vec<Artifact>, ReportError>,
}

/// Every exporter, in the order in which their files are written.
pub const EXPORTERS: &[Exporter] = &[plots::EXPORTER, cells_csv::EXPORTER, summary::EXPORTER];

/// Every file of the report. `pictures` are paths relative to the output folder.
pub fn artifacts(records: &[Record], pictures: &[String]) -> Result<Vec<Artifact>, ReportError> {
    let view = View::new(records, pictures);
    let mut files = Vec::new();
    for exporter in EXPORTERS {
        files.extend((exporter.export)(&view)?);
    }
    Ok(files)
}

/// Writes the report beside the records, linking the pictures found there, and gives the paths written.
pub fn write(out: &Path, records: &[Record]) -> Result<Vec<PathBuf>, ReportError> {
    let mut paths = Vec::new();
    for artifact in artifacts(records, &pictures_in(out))? {
        let path = out.join(&artifact.name);
        std::fs::write(&path, &artifact.bytes).map_err(|source| ReportError::Write {
            path: path.clone(),
            source,
        })?;
        paths.push(path);
    }
    Ok(paths)
}

/// PNG files of the output folder's pictures, sorted. A folder that is not there holds none.
fn pictures_in(out: &Path) -> Vec<String> {
    let Ok(entries) = std::fs::read_dir(out.join(PICTURES)) else {
        return Vec::new();
    };
    let mut names: Vec<String> = entries
        .filter_map(|entry| entry.ok()?.file_name().into_string().ok())
        .filter(|name| name.ends_with(".png"))
        .map(|name| format!("{PICTURES}/{name}"))
        .collect();
    names.sort();
    names
}
