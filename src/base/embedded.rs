//! Folders that come with the program. A development build reads them from disk, so that a change needs no build; a
//! release build holds them.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use rust_embed::{Embed, EmbeddedFile};

/// The stages' shaders and the modules that they share.
pub const SHADERS: Folder = Folder::from_embed::<ShaderFiles>("shaders");

pub const SCENES: Folder = Folder::from_embed::<SceneFiles>("scenes");

pub const EXPERIMENTS: Folder = Folder::from_embed::<ExperimentFiles>("benches/experiments");

#[derive(Embed)]
#[folder = "../../shaders"]
struct ShaderFiles;

#[derive(Embed)]
#[folder = "../../scenes"]
struct SceneFiles;

pub const FIGURES: Folder = Folder::from_embed::<FigureFiles>("benches/figures");

#[derive(Embed)]
#[folder = "../../benches/experiments"]
struct ExperimentFiles;

#[derive(Embed)]
#[folder = "../../benches/figures"]
struct FigureFiles;

#[derive(Clone, Debug)]
pub struct Folder {
    /// Where it lies, for messages.
    pub name: Cow<'static, str>,
    source: FolderSource,
}

#[derive(Clone, Debug)]
enum FolderSource {
    Embedded { file: fn(&str) -> Option<EmbeddedFile>, paths: fn() -> Vec<Cow<'static, str>> },
    Disk(PathBuf),
}

impl Folder {
    /// The folder of a type that derives [`Embed`]; `name` is for messages.
    pub const fn from_embed<E: Embed>(name: &'static str) -> Self {
        let source = FolderSource::Embedded { file: E::get, paths: || E::iter().collect() };
        Self { name: Cow::Borrowed(name), source }
    }

    pub fn from_path(path: impl Into<PathBuf>) -> Self {
        let path = path.into();
        Self { name: path.display().to_string().into(), source: FolderSource::Disk(path) }
    }

    /// Paths of all files, from the folder, with `/` between names.
    pub fn paths(&self) -> Vec<Cow<'static, str>> {
        match &self.source {
            FolderSource::Embedded { paths, .. } => paths(),
            FolderSource::Disk(root) => {
                let mut paths = Vec::new();
                list(root, "", &mut paths);
                paths
            }
        }
    }

    /// What the file of this path holds. A path that [`Self::paths`] does not list is no file.
    pub fn file(&self, path: &str) -> Option<Cow<'static, [u8]>> {
        let listed = self.paths().iter().any(|known| known == path);
        match &self.source {
            _ if !listed => None,
            FolderSource::Embedded { file, .. } => file(path).map(|file| file.data),
            FolderSource::Disk(root) => std::fs::read(root.join(path)).ok().map(Cow::Owned),
        }
    }

    /// The file of this path, if it is text.
    pub fn text(&self, path: &str) -> Option<String> {
        String::from_utf8(self.file(path)?.into_owned()).ok()
    }

    /// Path without the ending, and text, of each file that ends in `ending` (such as `.toml`), in alphabetical order.
    pub fn texts(&self, ending: &str) -> Vec<(String, String)> {
        let paths = self.paths();
        let stems = paths.iter().filter_map(|path| Some((path, path.strip_suffix(ending)?)));
        let mut texts: Vec<(String, String)> =
            stems.filter_map(|(path, stem)| Some((stem.to_owned(), self.text(path)?))).collect();
        texts.sort_unstable();
        texts
    }
}

/// Adds the files under `root` whose paths begin with `prefix`; what cannot be listed has none.
fn list(root: &Path, prefix: &str, paths: &mut Vec<Cow<'static, str>>) {
    for entry in std::fs::read_dir(root.join(prefix)).into_iter().flatten().flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        let path = if prefix.is_empty() { name } else { format!("{prefix}/{name}") };
        match entry.file_type() {
            Ok(kind) if kind.is_dir() => list(root, &path, paths),
            Ok(kind) if kind.is_file() => paths.push(path.into()),
            _ => {}
        }
    }
}

/// Folders that are searched in their order.
#[derive(Clone, Debug)]
pub struct Folders(Vec<Folder>);

impl Folders {
    pub fn new(folder: Folder) -> Self {
        Self(vec![folder])
    }

    #[must_use]
    pub fn with(mut self, folder: Folder) -> Self {
        self.0.push(folder);
        self
    }

    /// The text of the first file of this path, and its folder's name.
    pub fn text(&self, path: &str) -> Option<(&str, String)> {
        self.0.iter().find_map(|folder| Some((&*folder.name, folder.text(path)?)))
    }

    /// See [`Folder::texts`]; of files with the same path the first.
    pub fn texts(&self, ending: &str) -> Vec<(String, String)> {
        let all = self.0.iter().rev().flat_map(|folder| folder.texts(ending));
        all.collect::<BTreeMap<_, _>>().into_iter().collect()
    }

    /// The stems of [`Self::texts`].
    pub fn stems(&self, ending: &str) -> impl Iterator<Item = String> {
        self.texts(ending).into_iter().map(|(stem, _)| stem)
    }

    pub fn names(&self) -> Vec<Cow<'static, str>> {
        self.0.iter().map(|folder| folder.name.clone()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_gives_what_it_lists_and_nothing_else() {
        assert!(SHADERS.text("shared/uniforms.wgsl").unwrap().contains("#define_import_path"));
        for path in ["", "shared", "none.wgsl", "./compose.wgsl", "../Cargo.toml", "/etc/passwd"] {
            assert!(SHADERS.file(path).is_none(), "{path}");
        }
        let scenes = SCENES.texts(".toml");
        assert!(scenes.is_sorted() && scenes.iter().any(|(name, _)| name == "bunny"));
        assert_eq!(scenes.len(), SCENES.paths().len(), "a scene is no text or ends otherwise");
    }
}
