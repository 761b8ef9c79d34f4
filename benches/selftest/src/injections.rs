//! Known changes: `benches/selftest/injections.toml`, and the two no-op ones.

use std::collections::BTreeMap;

use serde::Deserialize;
use strum::{Display, EnumIter};

use crate::trials::Variant;

static BUILT_IN: &str = include_str!("../injections.toml");

/// What stands in an edit for the size, for the loops that come to nothing, and in these for values.
const SIZE: &str = "{n}";
const IDLE: &str = "{idle}";
const LOADS: &str = "{loads}";
const SEED: &str = "{seed}";
const PART: &str = "{part}";

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    /// A loop that computes, and one that reads.
    idle: String,
    loads: String,
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
    /// A number that differs between groups of neighbouring invocations.
    #[serde(default)]
    part: String,
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
        let File { idle, loads, mut injection } = toml::from_str(BUILT_IN)
            .map_err(|error| format!("benches/selftest/injections.toml: {error}"))?;
        for Self { replace, seed, part, .. } in &mut injection {
            for (name, code) in [(IDLE, &idle), (LOADS, &loads)] {
                *replace = replace.replace(name, &code.replace(SEED, seed).replace(PART, part));
            }
        }
        Ok(injection)
    }

    fn file(&self) -> String {
        self.file.clone().unwrap_or_else(|| format!("shaders/{}.wgsl", self.stage))
    }

    /// Adds its change to others, at a size if it has sizes.
    pub fn add(
        &self,
        size: Option<Size>,
        read: Read<'_>,
        changes: &mut Changes,
    ) -> Result<(), String> {
        let file = self.file();
        let text = changes.remove(&file).map_or_else(|| read(&file), Ok)?;
        let n = size.and_then(|size| self.sizes.get(&size)).copied().unwrap_or(1);
        let edited = match text.matches(&self.find).count() {
            1 => text.replace(&self.find, &self.replace.replace(SIZE, &n.to_string())),
            0 => return Err(format!("{file} no longer holds `{}`", self.find)),
            n => return Err(format!("{file} holds `{}` {n} times", self.find)),
        };
        changes.insert(file, edited);
        Ok(())
    }
}

/// The files that a variant changes.
pub fn changes(
    variant: &Variant,
    injections: &[Injection],
    read: Read<'_>,
) -> Result<Changes, String> {
    let size = match variant {
        Variant::Again => None,
        Variant::Unrelated => return unrelated(read),
        Variant::Injected(_, size) => *size,
        Variant::Every(size) => Some(*size),
    };
    let mut changes = Changes::new();
    for injection in injections.iter().filter(|injection| variant.injects(injection)) {
        injection.add(size, read, &mut changes)?;
    }
    Ok(changes)
}

/// A change of the host that no stage uses: a function, data and a long text, which move everything behind them.
fn unrelated(read: Read<'_>) -> Result<Changes, String> {
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
    use std::path::Path;

    use fathom::compare::cells::Gates;
    use fathom::embedded::{Folder, Folders, SHADERS};
    use fathom::gpu::{default_defs, link};
    use fathom::record::comparison::CellId;

    use super::*;

    fn source(file: &str) -> Result<String, String> {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(file);
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
                let variant = Variant::Injected(injection.id.clone(), size);
                let changes = changes(&variant, &injections, &source).unwrap();
                assert_eq!(changes.len(), 1);
                for (file, text) in &changes {
                    assert_ne!(source(file).unwrap(), *text);
                    let holds = |placeholder| text.contains(placeholder);
                    assert!(
                        ![SIZE, IDLE, LOADS, SEED, PART].into_iter().any(holds),
                        "{}",
                        injection.id
                    );
                    let is_shader = Path::new(file).starts_with("shaders");
                    assert_eq!(is_shader, !injection.sizes.is_empty(), "{}", injection.id);
                }
            }
        }
        let unrelated = changes(&Variant::Unrelated, &injections, &source).unwrap();
        let (_, text) = unrelated.first_key_value().unwrap();
        assert!(text.contains("extern \"C\" fn fathom_unrelated"));
    }

    #[test]
    fn every_stage_of_the_gates_has_an_injection_with_sizes() {
        let gates = Gates::load(None, fathom::Catalog::builtin().gates).unwrap();
        let injections = Injection::all().unwrap();
        for injection in injections.iter().filter(|one| !one.sizes.is_empty()) {
            let tuned = CellId::new(&injection.configuration, &injection.stage);
            assert!(gates.cells().contains(&tuned), "{tuned} is no cell");
        }
        let cells = gates.cells();
        for stage in cells.iter().filter(|cell| cell.subject().is_stage()).map(CellId::stage) {
            let own = injections.iter().filter(|one| one.stage == stage && !one.sizes.is_empty());
            let asked = "add one to benches/selftest/injections.toml";
            assert!(own.count() > 0, "no injection with sizes into {stage}: {asked}");
        }
    }

    /// With each definition with which the committed shader links.
    #[test]
    fn injected_shaders_link() {
        let injections = Injection::all().unwrap();
        let every = changes(&Variant::Every(Size::Slow5), &injections, &source).unwrap();
        let folder = tempfile::tempdir().unwrap();
        for (file, text) in &every {
            let to = folder.path().join(file);
            std::fs::create_dir_all(to.parent().unwrap()).unwrap();
            std::fs::write(to, text).unwrap();
        }
        let injected = Folders::of(Folder::at(folder.path().join("shaders"))).and(SHADERS);
        let committed = errors(&Folders::of(SHADERS), &every);
        for (key, error) in errors(&injected, &every) {
            assert!(error.is_none() || committed[&key].is_some(), "{key:?}: {error:?}");
        }
        assert!(committed.values().filter(|error| error.is_none()).count() > every.len());
    }

    /// Why shaders do not link, by path and a definition with one of its values.
    fn errors(
        folders: &Folders,
        files: &Changes,
    ) -> BTreeMap<(String, String, i32), Option<String>> {
        let mut errors = BTreeMap::new();
        for file in files.keys() {
            let path = file.strip_prefix("shaders/").and_then(|path| path.strip_suffix(".wgsl"));
            let path = path.unwrap();
            let defaults = default_defs(folders, path).unwrap();
            let values = |(name, _)| [0, 1, 2].map(|value| (String::clone(&name), value));
            let one = ("NONE".to_owned(), 0);
            for (name, value) in defaults.into_iter().flat_map(values).chain([one]) {
                let failed = link(folders, path, &[(&name, value)]).err();
                let key = (path.to_owned(), name, value);
                errors.insert(key, failed.map(|error| error.to_string()));
            }
        }
        errors
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
        let made = |text: &str| {
            let mut changes = Changes::new();
            edit.add(Some(Size::Slow3), &|_| Ok(text.to_owned()), &mut changes)?;
            Ok::<_, String>(changes.into_values().next().unwrap())
        };
        assert_eq!(made("a x b").unwrap(), "a y3 b");
        assert!(made("a b").unwrap_err().contains("no longer holds"));
        assert!(made("x x").unwrap_err().contains("2 times"));
    }
}
