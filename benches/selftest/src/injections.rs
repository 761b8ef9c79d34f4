//! Known changes: `benches/injections.toml`, and the two no-op ones.

use std::collections::BTreeMap;

use serde::Deserialize;
use strum::{Display, EnumIter};

static BUILT_IN: &str = include_str!("../injections.toml");

/// What stands for the size in an edit.
const SIZE: &str = "{n}";

#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Injection {
    pub id: String,
    /// The only stage that is changed.
    pub stage: String,
    /// Such as `extra loop iterations`.
    pub kind: String,
    /// The configuration of the gates in which its sizes are what they say.
    pub configuration: String,
    /// Name of a size → repetitions; none for a change of one size.
    #[serde(default)]
    pub sizes: BTreeMap<Size, u32>,
    pub edit: Vec<Edit>,
}

/// How much is injected.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Deserialize, Display, EnumIter,
)]
#[serde(rename_all = "lowercase")]
#[strum(serialize_all = "lowercase")]
pub enum Size {
    /// About 2 % more instructions.
    Instructions,
    /// About 3, 5 and 10 % more time.
    Slow3,
    Slow5,
    Slow10,
}

impl Size {
    /// For people; [`Display`] is part of a file's name.
    pub fn label(self) -> &'static str {
        match self {
            Self::Instructions => "+2 % instructions",
            Self::Slow3 => "+3 % time",
            Self::Slow5 => "+5 % time",
            Self::Slow10 => "+10 % time",
        }
    }
}

/// One place of one file.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Edit {
    pub file: String,
    pub find: String,
    pub replace: String,
}

/// Changed files with their new text.
pub type Changes = BTreeMap<String, String>;

/// Gives the text of a file of the sources.
pub type Read<'a> = &'a dyn Fn(&str) -> Result<String, String>;

impl Edit {
    /// The file's text with the edit made; the message says why it cannot be.
    fn made(&self, text: &str, n: u32) -> Result<String, String> {
        match text.matches(&self.find).count() {
            1 => Ok(text.replace(&self.find, &self.replace.replace(SIZE, &n.to_string()))),
            0 => Err(format!("{} no longer holds `{}`", self.file, self.find)),
            n => Err(format!("{} holds `{}` {n} times", self.file, self.find)),
        }
    }
}

impl Injection {
    /// Every injection.
    pub fn all() -> Result<Vec<Self>, String> {
        #[derive(Deserialize)]
        #[serde(deny_unknown_fields)]
        struct File {
            injection: Vec<Injection>,
        }
        let file: File = toml::from_str(BUILT_IN)
            .map_err(|error| format!("benches/selftest/injections.toml: {error}"))?;
        Ok(file.injection)
    }

    /// The files that it changes, at a size if it has sizes.
    pub fn changes(&self, size: Option<Size>, read: Read<'_>) -> Result<Changes, String> {
        let mut changes = Changes::new();
        self.change(size, read, &mut changes)?;
        Ok(changes)
    }

    /// Makes its edits where other edits have been made already.
    fn change(
        &self,
        size: Option<Size>,
        read: Read<'_>,
        changes: &mut Changes,
    ) -> Result<(), String> {
        let n = size.and_then(|size| self.sizes.get(&size)).copied().unwrap_or(1);
        for edit in &self.edit {
            let text = match changes.get(&edit.file) {
                Some(text) => edit.made(text, n)?,
                None => edit.made(&read(&edit.file)?, n)?,
            };
            changes.insert(edit.file.clone(), text);
        }
        Ok(())
    }
}

/// The files that all injections with sizes together change.
pub fn every(injections: &[Injection], size: Size, read: Read<'_>) -> Result<Changes, String> {
    let mut changes = Changes::new();
    for injection in injections.iter().filter(|injection| !injection.sizes.is_empty()) {
        injection.change(Some(size), read, &mut changes)?;
    }
    Ok(changes)
}

/// A change of the host that no stage uses: a function, data and a long text, which move everything behind them.
pub fn unrelated(read: Read<'_>) -> Result<Changes, String> {
    const FILE: &str = "src/base/statistics.rs";
    const CODE: &str = r#"
/// Changes nothing that is measured.
#[used]
static UNRELATED: [u8; 12_345] = [7; 12_345];

#[unsafe(no_mangle)]
pub extern "C" fn fathom_unrelated(n: u64) -> u64 {
    (0..n)
        .map(|i| i.wrapping_mul(u64::from(UNRELATED[(i % 12_345) as usize])))
        .fold(1, u64::wrapping_add)
}
"#;
    let text = read(FILE)?;
    let (above, tests) =
        text.split_once("\n#[cfg(test)]").ok_or_else(|| format!("{FILE} has no tests"))?;
    let text = format!("{above}{CODE}\n#[cfg(test)]{tests}");
    Ok(Changes::from([(FILE.to_owned(), text)]))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn source(file: &str) -> Result<String, String> {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(file);
        std::fs::read_to_string(path).map_err(|error| error.to_string())
    }

    #[test]
    fn every_injection_applies_to_these_sources_and_changes_one_stage() {
        let injections = Injection::all().unwrap();
        for injection in &injections {
            let mut known = fathom::stages::REGISTRY.iter();
            assert!(known.any(|stage| stage.name == injection.stage), "{}", injection.id);
            let sizes = injection.sizes.keys().copied().map(Some);
            for size in sizes.chain([None]) {
                let changes = injection.changes(size, &source).unwrap();
                for (file, text) in &changes {
                    assert_ne!(source(file).unwrap(), *text);
                    assert!(!text.contains(SIZE), "{}", injection.id);
                }
                let shader = format!("shaders/{}.wgsl", injection.stage);
                let own = changes.contains_key(&shader);
                assert!(own || injection.sizes.is_empty(), "{}", injection.id);
            }
        }
        let sized = injections.iter().filter(|other| !other.sizes.is_empty());
        let together = every(&injections, Size::Slow5, &source).unwrap();
        for shader in sized.map(|one| format!("shaders/{}.wgsl", one.stage)) {
            assert!(together.contains_key(&shader));
        }
        let unrelated = unrelated(&source).unwrap();
        let (_, text) = unrelated.first_key_value().unwrap();
        assert!(text.contains("extern \"C\" fn fathom_unrelated"));
    }

    #[test]
    fn sized_injections_have_every_size_and_larger_ones_are_larger() {
        for injection in Injection::all().unwrap() {
            if injection.sizes.is_empty() {
                continue;
            }
            let n = |size| injection.sizes[&size];
            assert!(n(Size::Slow3) <= n(Size::Slow5) && n(Size::Slow5) < n(Size::Slow10));
            assert!(n(Size::Instructions) >= 1);
        }
    }

    #[test]
    fn an_edit_that_does_not_fit_is_told() {
        let edit = Edit { file: "a.wgsl".into(), find: "x".into(), replace: "y{n}".into() };
        assert_eq!(edit.made("a x b", 3).unwrap(), "a y3 b");
        assert!(edit.made("a b", 3).unwrap_err().contains("no longer holds"));
        assert!(edit.made("x x", 3).unwrap_err().contains("2 times"));
    }
}
