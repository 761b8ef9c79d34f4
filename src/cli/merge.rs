//! `fathom merge`: from the folders of shards to that of the run, with its reports.

use std::path::{Path, PathBuf};

use super::commands::{Outcome, ended};
use crate::harness::merge::{self, Merged, OfAdapter, Staging};
use crate::harness::outcome::Counts;
use crate::record::OVER_BUDGET;
use crate::record::{Damaged, Reading};
use crate::{exporters, tell, text};

/// Cells, shards or notes that are named one by one.
const MOST_NAMED: usize = 20;

pub fn merge(folders: &[PathBuf], out: &Path) -> Outcome {
    ended(join(folders, out)?.iter().all(is_whole))
}

/// Every cell is there, and none failed.
pub fn is_whole(merged: &Merged) -> bool {
    merged.missing.is_empty() && merged.counts.failed == 0
}

/// Joins shards into the folder `out` and says what became of them. Several adapters get a folder each within it, and one page.
pub fn join(folders: &[PathBuf], out: &Path) -> anyhow::Result<Vec<Merged>> {
    let groups = merge::sources(folders)?;
    let staging = Staging::begin(out)?;
    let names = names(&groups);
    let mut all = Vec::new();
    for (group, name) in groups.into_iter().zip(&names) {
        let (records, merged) = staging.write(name.as_deref(), group)?;
        let folder = name.as_ref().map_or(staging.folder().into(), |n| staging.folder().join(n));
        exporters::write(&folder, Reading { records, damaged: Damaged::default() })?;
        all.push(merged);
    }
    if all.len() > 1 {
        let folders: Vec<PathBuf> =
            names.iter().flatten().map(|name| staging.folder().join(name)).collect();
        exporters::put(staging.folder(), vec![exporters::Folders::read(&folders)?.page()])?;
    }
    staging.publish()?;
    for (merged, name) in all.iter().zip(&names) {
        tell_of(merged, &name.as_ref().map_or(out.to_owned(), |name| out.join(name)));
    }
    Ok(all)
}

/// The folder of each adapter within the whole; none where there is one adapter.
fn names(groups: &[OfAdapter]) -> Vec<Option<String>> {
    let name = |(index, group): (usize, &OfAdapter)| {
        let stem = text::file_stem(&group.adapter.title());
        (groups.len() > 1).then(|| format!("{}-{stem}", index + 1))
    };
    groups.iter().enumerate().map(name).collect()
}

fn tell_of(merged: &Merged, folder: &Path) {
    let Counts { measured, skipped, failed, over_budget } = merged.counts;
    let missing = merged.missing.len();
    tell::done(format!(
        "{}: {measured} cells measured, {skipped} skipped, {failed} failed, {over_budget} {OVER_BUDGET}, \
         {missing} missing",
        text::line(&merged.adapter.title())
    ));
    named(merged.absent.iter().map(|part| format!("shard {part} is not there")));
    named(merged.missing.iter().map(|(experiment, cell)| format!("missing: {experiment} {cell}")));
    named(merged.notes.iter().cloned());
    tell::done(folder.display());
}

fn named(all: impl ExactSizeIterator<Item = String>) {
    let more = all.len().saturating_sub(MOST_NAMED);
    all.take(MOST_NAMED).for_each(|line| tell::note(text::line(&line)));
    if more > 0 {
        tell::note(format!("and {more} more"));
    }
}
