//! `fathom compare`: whether a change made any stage of any pipeline slower, costlier or less accurate.
//!
//! Two builds are held against each other through three gates, from exact to noisy: declared work, counters,
//! bytes and errors ([`exact`]); instruction counts ([`instructions`]); time ([`time`]). [`worker`] is the measured side: a
//! process that holds the prepared configurations of one build and answers [`protocol`]'s requests. [`flow`] measures;
//! what is measured goes to a folder of lines ([`store`]); the [`verdict`] is a function of those lines alone, and
//! [`tables`] tell it.

pub mod bench;
pub mod build;
pub mod cells;
pub mod exact;
pub mod files;
pub mod flow;
pub mod instructions;
pub mod launch;
pub mod nan;
pub mod protocol;
mod quiet;
pub mod rank;
pub mod rounds;
pub mod store;
pub mod survey;
pub mod tables;
pub mod time;
pub mod unpaired;
mod valgrind;
pub mod verdict;
pub mod worker;

use std::path::{Path, PathBuf};

use store::{Comparison, StoreError};
use verdict::Verdicts;

/// Writes what is told of a comparison into its folder, and gives the paths.
pub fn write_tables(folder: &Path, verdicts: &Verdicts<'_>) -> Result<Vec<PathBuf>, StoreError> {
    let mut paths = Vec::new();
    for format in tables::FORMATS {
        let Some(name) = format.file else { continue };
        let path = folder.join(name);
        std::fs::write(&path, (format.write)(verdicts))
            .map_err(|source| StoreError::Unwritable { path: path.clone(), source })?;
        paths.push(path);
    }
    Ok(paths)
}

/// The stored comparison of a folder.
pub fn read(folder: &Path) -> Result<Comparison, StoreError> {
    Comparison::read(folder)
}
