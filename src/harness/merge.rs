//! `fathom merge`: the shards of a run as one run.
//!
//! A merged run is a run in several sittings: each shard's header stands before its cells. Shards whose headers say the same are
//! one sitting. So reports of merged records are those of a run that was measured in these sittings.
//!
//! - Shards of one run have the same plan, profile, version of fathom and shader checks. Others are an error.
//! - A shard may be there once.
//! - Shards on different adapters become a run for each adapter.
//! - Of a cell with several records the latest counts that was measured; else the latest that was skipped; else the latest.
//!
//! The folder is made beside its place and moved there when it is whole.

mod records;
mod staging;

use std::path::{Path, PathBuf};

use thiserror::Error;

use super::outcome::Counts;
use super::plan::PlanError;
use fathom_experiments::ExperimentError;
use fathom_record::output::{OutputError, OutputFolder};
use fathom_record::{
    Adapter, Damaged, LockError, Part, Reading, Record, RecordError, Run, Shard, read,
};

pub use records::CellId;
pub use staging::Staging;

#[derive(Debug, Error)]
pub enum MergeError {
    #[error(transparent)]
    Record(#[from] RecordError),
    #[error(transparent)]
    Output(#[from] OutputError),
    #[error(transparent)]
    Lock(#[from] LockError),
    #[error(transparent)]
    Experiment(#[from] ExperimentError),
    #[error(transparent)]
    Plan(#[from] PlanError),
    #[error("{} holds no header of a run: nothing can be merged with it", folder.display())]
    NoHeader { folder: PathBuf },
    #[error(
        "{} holds a whole run and no shard; `fathom report DIR DIR… --out DIR` shows several runs on one page",
        folder.display()
    )]
    NoShard { folder: PathBuf },
    #[error("{} says that it is shard {part}, and there is no such shard", folder.display())]
    NoSuchShard { folder: PathBuf, part: Part },
    #[error("{} and {} are shards of different runs: they differ in {what}", first.display(), other.display())]
    OtherRun { first: PathBuf, other: PathBuf, what: &'static str },
    #[error("{} and {} both hold shard {part}: name one of them", first.display(), other.display())]
    Twice { first: PathBuf, other: PathBuf, part: Part },
    #[error("{} is there already: choose another folder with --out", path.display())]
    Taken { path: PathBuf },
    #[error("cannot write to {}: {source}", path.display())]
    Io { path: PathBuf, source: std::io::Error },
}

/// The folder of a shard, as it was read.
struct Source {
    folder: PathBuf,
    records: Vec<Record>,
    damaged: Damaged,
    shard: Shard,
    /// Its last header.
    header: Run,
}

/// The shards that one adapter measured, in order of their numbers.
pub struct OfAdapter {
    pub adapter: Adapter,
    sources: Vec<Source>,
}

/// What became of the shards of one adapter.
pub struct Merged {
    pub adapter: Adapter,
    pub counts: Counts,
    /// Cells of the plan that no shard has a record of.
    pub missing: Vec<CellId>,
    /// Shards that were not there.
    pub absent: Vec<Part>,
    /// What of the input was not taken over, a line each.
    pub notes: Vec<String>,
}

/// Reads the shards and sorts them by adapter, in the order of the folders.
pub fn sources(folders: &[PathBuf]) -> Result<Vec<OfAdapter>, MergeError> {
    let mut groups: Vec<OfAdapter> = Vec::new();
    let mut first: Option<(PathBuf, Run, Shard)> = None;
    for folder in folders {
        let source = Source::read(folder)?;
        match &first {
            Some((path, header, shard)) => source.belongs_to(path, header, shard)?,
            None => first = Some((folder.clone(), source.header.clone(), source.shard.clone())),
        }
        let adapter = &source.header.adapter;
        match groups.iter_mut().find(|group| same_adapter(&group.adapter, adapter)) {
            Some(group) => group.sources.push(source),
            None => groups.push(OfAdapter { adapter: adapter.clone(), sources: vec![source] }),
        }
    }
    for group in &mut groups {
        group.sources.sort_by_key(|source| source.shard.part.number);
        for pair in group.sources.windows(2) {
            if pair[0].shard.part.number == pair[1].shard.part.number {
                let [first, other] = [&pair[0], &pair[1]].map(|source| source.folder.clone());
                return Err(MergeError::Twice { first, other, part: pair[0].shard.part });
            }
        }
    }
    Ok(groups)
}

/// Hosts may differ where the GPU does the work.
fn same_adapter(a: &Adapter, b: &Adapter) -> bool {
    let of_gpu = |adapter: &Adapter| Adapter { host_threads: 0, ..adapter.clone() };
    a == b || !a.software && of_gpu(a) == of_gpu(b)
}

impl Source {
    fn read(folder: &Path) -> Result<Self, MergeError> {
        let path = OutputFolder { folder: folder.to_owned() }.records();
        let reading = read(&path)?;
        let last = reading.records.iter().rev().find_map(Record::try_as_run_ref);
        let folder = folder.to_owned();
        let Some(header) = last.cloned() else {
            // A file without any sound record is named with its damage.
            fathom_record::empty_or_sound(&path, &reading)?;
            return Err(MergeError::NoHeader { folder });
        };
        let Some(shard) = header.shard.clone() else {
            return Err(MergeError::NoShard { folder });
        };
        let part = shard.part;
        if !part.is_one() {
            return Err(MergeError::NoSuchShard { folder, part });
        }
        let Reading { records, damaged } = reading;
        Ok(Self { folder, records, damaged, shard, header: *header })
    }

    fn belongs_to(&self, first: &Path, header: &Run, shard: &Shard) -> Result<(), MergeError> {
        let differs = [
            ("their format", header.schema != self.header.schema),
            ("fathom's version", header.fathom_version != self.header.fathom_version),
            ("the profile", header.profile != self.header.profile),
            ("the checks in shaders", header.shader_checks != self.header.shader_checks),
            ("the number of shards", shard.part.of != self.shard.part.of),
            ("experiments, cells or parameters", shard.plan != self.shard.plan),
        ];
        let (first, other) = (first.to_owned(), self.folder.clone());
        match differs.into_iter().find(|(_, differs)| *differs) {
            Some((what, _)) => Err(MergeError::OtherRun { first, other, what }),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests;
