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

use anyhow::{Result, bail, ensure};

use super::outcome::Counts;
use fathom_record::output::OutputFolder;
use fathom_record::{Adapter, Damaged, Part, Reading, Record, Run, Shard, read};

pub use records::CellId;
pub use staging::{Staging, put_pictures, put_records};

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
pub fn sources(folders: &[PathBuf]) -> Result<Vec<OfAdapter>> {
    let all = folders.iter().map(|folder| Source::read(folder)).collect::<Result<Vec<_>>>()?;
    all.iter().try_for_each(|source| source.belongs_to(&all[0]))?;
    let mut groups: Vec<OfAdapter> = Vec::new();
    for source in all {
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
                let [first, other] = [0, 1].map(|source| pair[source].folder.display());
                bail!(
                    "{first} and {other} both hold shard {}: name one of them",
                    pair[0].shard.part
                );
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
    fn read(folder: &Path) -> Result<Self> {
        let shown = folder.display();
        let path = OutputFolder { folder: folder.to_owned() }.records();
        let reading = read(&path)?;
        let last = reading.records.iter().rev().find_map(Record::try_as_run_ref);
        let Some(header) = last.cloned() else {
            // A file without any sound record is named with its damage.
            fathom_record::empty_or_sound(&path, &reading)?;
            bail!("{shown} holds no header of a run: nothing can be merged with it");
        };
        let Some(shard) = header.shard.clone() else {
            bail!(
                "{shown} holds a whole run and no shard; `fathom report DIR DIR… --out DIR` shows several runs on one page"
            );
        };
        let part = shard.part;
        ensure!(part.is_one(), "{shown} says that it is shard {part}, and there is no such shard");
        let Reading { records, damaged } = reading;
        Ok(Self { folder: folder.to_owned(), records, damaged, shard, header: *header })
    }

    fn belongs_to(&self, first: &Self) -> Result<()> {
        let Self { header, shard, .. } = first;
        let differs = [
            ("their format", header.schema != self.header.schema),
            ("fathom's version", header.fathom_version != self.header.fathom_version),
            ("the profile", header.profile != self.header.profile),
            ("the checks in shaders", header.shader_checks != self.header.shader_checks),
            ("the number of shards", shard.part.of != self.shard.part.of),
            ("experiments, cells or parameters", shard.plan != self.shard.plan),
        ];
        if let Some((what, _)) = differs.into_iter().find(|(_, differs)| *differs) {
            let (first, other) = (first.folder.display(), self.folder.display());
            bail!("{first} and {other} are shards of different runs: they differ in {what}");
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
