//! Known changes: `benches/selftest/injections.toml`, and the two no-op ones.

use std::collections::BTreeMap;

use serde::Deserialize;
use strum::{Display, EnumIter};

static BUILT_IN: &str = include_str!("../injections.toml");

/// What stands in an edit for the size, for a loop that does nothing, and for what that loop begins with.
const SIZE: &str = "{n}";
const IDLE: &str = "{idle}";
const SEED: &str = "{seed}";

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    /// The loop.
    idle: String,
    injection: Vec<Injection>,
}

#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Injection {
    pub id: String,
    /// The only stage that is changed.
    pub stage: String,
    #[serde(default = "iterations")]
    pub kind: String,
    /// The configuration of the gates in which its sizes are what they say.
    #[serde(default = "pool")]
    pub configuration: String,
    /// Name of a size → repetitions; none for a change of one size.
    #[serde(default)]
    pub sizes: BTreeMap<Size, u32>,
    /// The file that is edited; none for the stage's shader.
    file: Option<String>,
    #[serde(default)]
    seed: String,
    /// Its one place in the file.
    find: String,
    replace: String,
}

fn iterations() -> String {
    "extra loop iterations".to_owned()
}

fn pool() -> String {
    "pool".to_owned()
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

/// An edit that does not fit.
pub fn unfit(reason: String) -> anyhow::Error {
    anyhow::anyhow!("injections do not fit these sources: {reason}")
}

/// Changed files with their new text.
pub type Changes = BTreeMap<String, String>;

/// Gives the text of a file of the sources.
pub type Read<'a> = &'a dyn Fn(&str) -> Result<String, String>;

impl Injection {
    /// Every injection.
    pub fn all() -> Result<Vec<Self>, String> {
        let File { idle, mut injection } = toml::from_str(BUILT_IN)
            .map_err(|error| format!("benches/selftest/injections.toml: {error}"))?;
        for Self { replace, seed, .. } in &mut injection {
            *replace = replace.replace(IDLE, &idle.replace(SEED, seed));
        }
        Ok(injection)
    }

    fn file(&self) -> String {
        self.file.clone().unwrap_or_else(|| format!("shaders/{}.wgsl", self.stage))
    }

    /// The files that it changes, at a size if it has sizes.
    pub fn changes(&self, size: Option<Size>, read: Read<'_>) -> Result<Changes, String> {
        let text = read(&self.file())?;
        let n = size.and_then(|size| self.sizes.get(&size)).copied().unwrap_or(1);
        let edited = match text.matches(&self.find).count() {
            1 => text.replace(&self.find, &self.replace.replace(SIZE, &n.to_string())),
            0 => return Err(format!("{} no longer holds `{}`", self.file(), self.find)),
            n => return Err(format!("{} holds `{}` {n} times", self.file(), self.find)),
        };
        Ok(Changes::from([(self.file(), edited)]))
    }
}

/// The files that all injections with sizes together change, each its own stage's shader.
pub fn every(injections: &[Injection], size: Size, read: Read<'_>) -> Result<Changes, String> {
    let sized = injections.iter().filter(|injection| !injection.sizes.is_empty());
    let changes = sized.map(|injection| injection.changes(Some(size), read));
    Ok(changes.collect::<Result<Vec<_>, _>>()?.into_iter().flatten().collect())
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
    use std::collections::BTreeSet;

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
                    let holds = |placeholder| text.contains(placeholder);
                    assert!(![SIZE, IDLE, SEED].into_iter().any(holds), "{}", injection.id);
                }
                let shader = format!("shaders/{}.wgsl", injection.stage);
                let own = changes.contains_key(&shader);
                assert!(own || injection.sizes.is_empty(), "{}", injection.id);
            }
        }
        let sized = injections.iter().filter(|other| !other.sizes.is_empty());
        let shaders = sized.clone().map(|one| format!("shaders/{}.wgsl", one.stage));
        let together = every(&injections, Size::Slow5, &source).unwrap();
        assert!(together.keys().eq(shaders.collect::<BTreeSet<_>>().iter()));
        assert_eq!(together.len(), sized.count());
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
        let (find, replace) = ("x".to_owned(), "y{n}".to_owned());
        let sizes = BTreeMap::from([(Size::Slow3, 3)]);
        let edit = Injection { sizes, find, replace, ..Injection::all().unwrap().remove(0) };
        let made = |text: &str| edit.changes(Some(Size::Slow3), &|_| Ok(text.to_owned()));
        assert_eq!(made("a x b").unwrap().into_values().next().unwrap(), "a y3 b");
        assert!(made("a b").unwrap_err().contains("no longer holds"));
        assert!(made("x x").unwrap_err().contains("2 times"));
    }
}
