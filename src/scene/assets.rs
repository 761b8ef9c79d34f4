//! Meshes and volumes that are not part of the project: found where an ordinary package client put
//! them, or in the cache, and never used unless their SHA-256 is the pinned one.

mod catalogue;

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

use super::{check, read};
use fathom_base::{folder, input};

pub use catalogue::{ASSETS, Asset, AssetKind, AssetSource};

/// The folders that are searched.
pub struct Places {
    pub cache: Option<PathBuf>,
    pub cargo_home: Option<PathBuf>,
    /// Root of the installed system.
    pub root: PathBuf,
}

/// The folder in which fathom keeps what it has fetched; none where there is no home folder and `FATHOM_CACHE` is not set.
pub fn cache() -> Option<PathBuf> {
    Places::detect().cache
}

impl Places {
    pub fn detect() -> Places {
        let variable = |name: &str| std::env::var_os(name).filter(|v| !v.is_empty());
        let home = std::env::home_dir().map(|home| home.join(".cargo"));
        Places {
            cache: variable("FATHOM_CACHE")
                .map(PathBuf::from)
                .or_else(|| Some(folder::user_cache()?.join("assets"))),
            cargo_home: variable("CARGO_HOME").map(PathBuf::from).or(home),
            root: PathBuf::from("/"),
        }
    }

    /// The files that may be the asset, best first, each with its origin.
    fn candidates(&self, asset: &Asset) -> Vec<(PathBuf, String)> {
        let mut names = vec![asset.file.to_owned()];
        let mut installed = Vec::new();
        match &asset.source {
            AssetSource::Debian { path, .. } => {
                installed.push(self.root.join(path.trim_start_matches('/')));
            }
            AssetSource::Crate { name, version, member } => {
                installed = self.find_in_registry(&format!("{name}-{version}"), member);
            }
            AssetSource::Npm { .. } => {}
            AssetSource::ByHand => names.push(format!("{}.gz", asset.file)),
        }
        let cached = self.cache.iter().flat_map(|cache| names.iter().map(|name| cache.join(name)));
        let cached = cached.map(|path| (path, "cached".to_owned()));
        let by = format!("installed by {}", asset.source);
        let all = cached.chain(installed.into_iter().map(|path| (path, by.clone())));
        all.filter(|(path, _)| path.is_file()).collect()
    }

    /// `member` of an unpacked crate, in each registry that cargo knows.
    pub fn find_in_registry(&self, folder: &str, member: &str) -> Vec<PathBuf> {
        let sources = self.cargo_home.iter().map(|home| home.join("registry/src"));
        let registries = sources.filter_map(|sources| std::fs::read_dir(sources).ok());
        let paths = registries.flatten().flatten().map(|registry| registry.path());
        paths.map(|path| path.join(folder).join(member)).filter(|path| path.is_file()).collect()
    }

    /// The first candidate with the right sum; an error if there are only others.
    pub fn locate(&self, asset: &Asset) -> Result<Option<(PathBuf, String)>, String> {
        let mut wrong = None;
        for (path, origin) in self.candidates(asset) {
            match asset.verify(&path) {
                Ok(()) => return Ok(Some((path, origin))),
                Err(fault) => wrong = Some(fault),
            }
        }
        wrong.map_or(Ok(None), Err)
    }
}

impl Asset {
    /// What is used in the asset's place, and how to get it.
    pub(super) fn stand_in_note(&self, size: &str) -> String {
        let (name, generator) = (self.name, self.stand_in.0);
        let why = match Places::detect().locate(self) {
            Err(_) => "asset has the wrong SHA-256",
            Ok(_) => "asset absent",
        };
        let verb = match self.source {
            AssetSource::ByHand => "tells where to put it",
            _ => "gets it",
        };
        format!("{name}: {why}, stand-in `{generator}` ({size}); `fathom fetch {name}` {verb}")
    }

    /// Whether the file has the asset's sum; the error says what to do about another one.
    fn verify(&self, path: &Path) -> Result<(), String> {
        let (found, expected) = (self.sum(path)?, self.sha256);
        if found == expected {
            return Ok(());
        }
        let (name, place) = (self.name, path.display());
        let remedy = match self.source {
            AssetSource::ByHand => format!("put the right {} in its place", self.file),
            _ => format!("`fathom fetch {name}` gets the right one"),
        };
        Err(format!(
            "{name}: {place} has SHA-256 {found}, not {expected}: it is not used, {remedy}"
        ))
    }

    /// The SHA-256 of a file as the asset's is pinned.
    pub fn sum(&self, path: &Path) -> Result<String, String> {
        let sum = match self.source {
            AssetSource::ByHand => read::open(path).and_then(input::sha256),
            _ => File::open(path).and_then(input::sha256),
        };
        sum.map_err(|error| self.unusable(path, &error))
    }

    pub fn unusable(&self, path: &Path, error: &io::Error) -> String {
        format!("{}: {}: {error}", self.name, path.display())
    }
}

/// The asset called `name`; the error names the nearest one.
pub fn named(name: &str) -> Result<&'static Asset, String> {
    ASSETS.iter().find(|a| a.name == name).ok_or_else(|| {
        let hint = check::hint(name, ASSETS.iter().map(|a| a.name));
        format!("there is no asset `{name}`: {hint}")
    })
}

/// The asset's file, if it is there and has the right sum.
pub fn find(name: &str) -> Option<PathBuf> {
    let asset = named(name).ok()?;
    Places::detect().locate(asset).ok()?.map(|f| f.0)
}
