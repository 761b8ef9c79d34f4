//! Known changes: `benches/injections.toml`, and the two no-op ones.

use std::collections::BTreeMap;

use serde::Deserialize;

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
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Size {
    /// About 2 % more instructions.
    Instructions,
    /// About 3, 5 and 10 % more time.
    Slow3,
    Slow5,
    Slow10,
}

impl Size {
    pub const SLOW: [Self; 3] = [Self::Slow3, Self::Slow5, Self::Slow10];

    pub fn name(self) -> &'static str {
        match self {
            Self::Instructions => "+2 % instructions",
            Self::Slow3 => "+3 % time",
            Self::Slow5 => "+5 % time",
            Self::Slow10 => "+10 % time",
        }
    }

    /// As part of a file's name.
    pub fn word(self) -> &'static str {
        match self {
            Self::Instructions => "instructions",
            Self::Slow3 => "slow3",
            Self::Slow5 => "slow5",
            Self::Slow10 => "slow10",
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

/// A file with its new text.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Changed {
    pub file: String,
    pub text: String,
}

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

    /// The files that it changes, at a size if it has sizes. `read` gives a file's text.
    pub fn changes(
        &self,
        size: Option<Size>,
        read: &dyn Fn(&str) -> Result<String, String>,
    ) -> Result<Vec<Changed>, String> {
        let mut changed = Vec::new();
        self.change(size, read, &mut changed)?;
        Ok(changed)
    }

    /// Makes its edits where other edits have been made already.
    fn change(
        &self,
        size: Option<Size>,
        read: &dyn Fn(&str) -> Result<String, String>,
        changed: &mut Vec<Changed>,
    ) -> Result<(), String> {
        let n = size.and_then(|size| self.sizes.get(&size)).copied();
        for edit in &self.edit {
            let known = changed.iter_mut().find(|known| known.file == edit.file);
            let text = match &known {
                Some(known) => known.text.clone(),
                None => read(&edit.file)?,
            };
            let text = edit.made(&text, n.unwrap_or(1))?;
            match known {
                Some(known) => known.text = text,
                None => changed.push(Changed { file: edit.file.clone(), text }),
            }
        }
        Ok(())
    }
}

/// The files that all injections with sizes together change.
pub fn every(
    injections: &[Injection],
    size: Size,
    read: &dyn Fn(&str) -> Result<String, String>,
) -> Result<Vec<Changed>, String> {
    let mut changed = Vec::new();
    for injection in injections {
        if !injection.sizes.is_empty() {
            injection.change(Some(size), read, &mut changed)?;
        }
    }
    Ok(changed)
}

/// A change of the host that no stage uses: a function, data and a long text, which move everything behind them.
pub fn unrelated(read: &dyn Fn(&str) -> Result<String, String>) -> Result<Vec<Changed>, String> {
    const FILE: &str = "src/statistics.rs";
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
    Ok(vec![Changed { file: FILE.to_owned(), text: format!("{above}{CODE}\n#[cfg(test)]{tests}") }])
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
            let known = fathom::stages::REGISTRY.iter();
            assert!(
                known.map(|stage| stage.name).any(|name| name == injection.stage),
                "{}",
                injection.id
            );
            let sizes = injection.sizes.keys().copied().map(Some);
            for size in sizes.chain([None]) {
                let changes = injection.changes(size, &source).unwrap();
                for changed in &changes {
                    assert_ne!(source(&changed.file).unwrap(), changed.text);
                    assert!(!changed.text.contains(SIZE), "{}", injection.id);
                }
                let shader = format!("shaders/{}.wgsl", injection.stage);
                let own = changes.iter().any(|changed| changed.file == shader);
                assert!(own || injection.sizes.is_empty(), "{}", injection.id);
            }
        }
        let sized = injections.iter().filter(|other| !other.sizes.is_empty());
        let together = every(&injections, Size::Slow5, &source).unwrap();
        for shader in sized.map(|one| format!("shaders/{}.wgsl", one.stage)) {
            assert!(together.iter().any(|changed| changed.file == shader));
        }
        let unrelated = unrelated(&source).unwrap();
        assert!(unrelated[0].text.contains("extern \"C\" fn fathom_unrelated"));
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
