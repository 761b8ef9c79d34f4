//! Changes to the sources: what a variant is built of.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, Result, bail};
use fathom::compare::store::StoredComparison;
use serde::Deserialize;

use crate::slowed::{self, TRIED};
use crate::trials::{Variant, stages};

/// An entry of `benches/selftest/patches.toml`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Patch {
    pub kind: String,
    /// What a gate must name, a stage or what the host does. Without it nothing that is measured changes.
    pub stage: Option<String>,
    file: String,
    /// Its one place in the file.
    find: String,
    replace: String,
}

impl Patch {
    pub fn all() -> Result<Vec<Self>> {
        let mut file: BTreeMap<String, Vec<Self>> =
            toml::from_str(include_str!("../patches.toml"))?;
        file.remove("patch").context("there are no patches")
    }

    fn applied(&self, text: &str) -> Result<String> {
        match text.matches(&self.find).count() {
            1 => Ok(text.replace(&self.find, &self.replace)),
            n => bail!("{}: {} holds `{}` {n} times", self.kind, self.file, self.find),
        }
    }
}

/// Changed files with their new text.
pub type Changes = BTreeMap<String, String>;

/// The files of a checkout that a variant changes. `tried` is what [`Variant::Tried`] gave.
pub fn changes(
    checkout: &Path,
    variant: &Variant,
    tried: Option<&StoredComparison>,
) -> Result<Changes> {
    let read = |file: &str| std::fs::read_to_string(checkout.join(file)).context(file.to_owned());
    let mut changes = Changes::new();
    let mut slow = |stage: &str, iterations: u32| -> Result<()> {
        let (file, condition) = slowed::shader(stage);
        let text = changes.remove(&file).map_or_else(|| read(&file), Ok)?;
        let looped = slowed::with_loop(&text, iterations, condition.as_deref());
        changes.insert(file, looped.with_context(|| format!("{stage} has no entry point"))?);
        Ok(())
    };
    match variant {
        Variant::Again => {}
        Variant::Tried => stages().iter().try_for_each(|stage| slow(stage, TRIED))?,
        Variant::Slowed(stage, share) => {
            let measured = tried.and_then(|tried| slowed::iterations(tried, stage, *share));
            slow(stage, measured.with_context(|| format!("{stage} was not tried"))?)?;
        }
        Variant::Patched(patch) => {
            changes.insert(patch.file.clone(), patch.applied(&read(&patch.file)?)?);
        }
    }
    Ok(changes)
}

#[cfg(test)]
mod tests {
    use fathom::compare::cells::Gates;

    use super::*;

    #[test]
    fn every_patch_fits_one_place_of_these_sources_and_is_of_a_cell_of_the_gates() {
        let checkout = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        let cells = Gates::load(None, fathom::Catalog::builtin().gates).unwrap().cells();
        for patch in Patch::all().unwrap() {
            let is_own = |stage: &String| cells.iter().any(|cell| cell.stage() == stage);
            assert!(patch.stage.iter().all(is_own), "{}", patch.kind);
            let before = std::fs::read_to_string(checkout.join(&patch.file)).unwrap();
            let changed = changes(&checkout, &Variant::Patched(patch.clone()), None).unwrap();
            assert_ne!(before, changed[&patch.file]);
            assert!(patch.applied(&before.repeat(2)).is_err());
        }
    }
}
