//! `fathom export`: one format of what a folder's records hold. `fathom schema`: what its lines look like.

use std::io::Write;
use std::process::ExitCode;

use anyhow::Context;

use super::ExportArgs;
use super::commands::{ExitResult, list_files, sound, write_into};
use crate::record::output::OutputFolder;
use crate::record::schema::LineKind;
use crate::report::Exported;
use crate::{exporters, folder, print};

pub fn export(args: ExportArgs) -> ExitResult {
    let ExportArgs { format, folder: from, output } = args;
    exporters::check_format(&format)?;
    let held = OutputFolder { folder: from.clone() };
    let records = sound(&held, "the folder of a run or a comparison holds a file")?;
    match (exporters::export(&format, &from, records)?, output) {
        (Exported::One(file), None) => {
            print::AnswerWriter.write_all(&file.bytes)?;
            Ok(ExitCode::SUCCESS)
        }
        (Exported::One(file), Some(path)) if !path.is_dir() => {
            folder::replace(&path, &file.bytes)
                .with_context(|| format!("cannot write {}", path.display()))?;
            list_files([path])
        }
        (exported, Some(folder)) => write_into(&folder, exported.files()),
        (Exported::Several(_), None) => {
            anyhow::bail!("`{format}` is a file for each experiment: name a folder with -o DIR")
        }
    }
}

pub fn schema(kind: LineKind) -> ExitResult {
    print::answer(kind.text());
    Ok(ExitCode::SUCCESS)
}
