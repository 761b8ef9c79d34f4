//! `fathom merge`: from the folders of shards to that of the run, with its reports.

use std::path::{Path, PathBuf};

use super::commands::{Outcome, ended};
use crate::harness::merge::{self, Merged};
use crate::record::output::OutputFolder;
use crate::record::{self, OVER_BUDGET, OutcomeCounts};
use crate::report::ReportView;
use crate::{exporters, tell, text};

pub fn merge(folders: &[PathBuf], out: &Path) -> Outcome {
    let Merged { absent, notes, lock: _lock } = merge::merge(folders, out)?;
    let reading = record::read(&OutputFolder { folder: out.to_owned() }.records())?;
    let view = ReportView::new(&reading.records, Some(out));
    let counts = OutcomeCounts::of(view.entries().map(|entry| entry.cell));
    exporters::write(out, reading)?;
    let OutcomeCounts { measured, skipped, failed, over_budget } = counts;
    tell::done(format!(
        "{measured} cells measured, {skipped} skipped, {failed} failed, {over_budget} {OVER_BUDGET}"
    ));
    absent.iter().for_each(|part| tell::note(format!("shard {part} is not there")));
    notes.iter().for_each(|note| tell::note(text::line(note)));
    tell::done(out.display());
    ended(absent.is_empty() && failed == 0)
}
