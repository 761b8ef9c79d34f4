//! `fathom export`: one format of what a folder's records hold. `fathom schema`: what its lines look like.

use std::io::Write;
use std::path::Path;
use std::process::ExitCode;

use anyhow::Context;

use super::ExportArgs;
use super::commands::Outcome;
use crate::record::output::{OutputFolder, RECORDS};
use crate::record::schema::LineKind;
use crate::record::{self, Reading};
use crate::report::{Artifact, Exported, FrameChoice};
use crate::{exporters, folder, tell};

pub fn export(args: ExportArgs) -> Outcome {
    let ExportArgs { format, folder: from, output, cell, frame } = args;
    let choice = FrameChoice { cell, frame };
    let exported = exporters::export(&format, &from, read(&from)?, &choice)?;
    match (exported, output) {
        (Exported::One(file), None) => tell::Answer.write_all(&file.bytes)?,
        (Exported::One(file), Some(path)) if !path.is_dir() => {
            folder::write(&path, &file.bytes)
                .with_context(|| format!("cannot write {}", path.display()))?;
            tell::done(path.display());
        }
        (exported, Some(folder)) => write_into(&folder, exported.files())?,
        (Exported::Several(_), None) => {
            anyhow::bail!("`{format}` is a file for each experiment: name a folder with -o DIR")
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// The sound records of a folder; the others are named.
fn read(folder: &Path) -> anyhow::Result<Reading> {
    let path = OutputFolder { folder: folder.to_owned() }.records();
    let reading = record::read_good(&path)
        .with_context(|| format!("the folder of a run or a comparison holds a file {RECORDS}"))?;
    reading.damaged.notices(&path).into_iter().for_each(tell::note);
    Ok(reading)
}

/// Writes files into a folder, under their own names.
pub(super) fn write_into(folder: &Path, files: Vec<Artifact>) -> anyhow::Result<()> {
    for path in exporters::put(folder, files)? {
        tell::done(path.display());
    }
    Ok(())
}

pub fn schema(kind: LineKind) -> Outcome {
    tell::answer(kind.text());
    Ok(ExitCode::SUCCESS)
}
