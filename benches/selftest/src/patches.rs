//! Changes to the sources: what a variant is built of.

use std::collections::BTreeMap;

use anyhow::{Context, Result, bail};
use serde::Deserialize;

/// An entry of `benches/selftest/patches.toml`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Patch {
    pub kind: String,
    /// What a gate must name, a stage or what the host does. Without it nothing that is measured changes.
    pub stage: Option<String>,
    pub file: String,
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

    pub fn applied(&self, text: &str) -> Result<String> {
        match text.matches(&self.find).count() {
            1 => Ok(text.replace(&self.find, &self.replace)),
            n => bail!("{}: {} holds `{}` {n} times", self.kind, self.file, self.find),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use fathom::compare::cells::Gates;

    use super::*;
    use crate::trials::Variant;
    use crate::workshop::changes;

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
