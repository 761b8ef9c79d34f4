//! Assets in folders of their own.

use std::io::Write as _;

use flate2::{Compression, write::GzEncoder};
use tempfile::TempDir;

use super::*;
use fathom_scene::assets::AssetKind;

/// An asset whose content is `abc`.
const ABC: Asset = Asset {
    name: "abc",
    about: "three letters",
    file: "abc.txt",
    sha256: "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad",
    source: AssetSource::Debian { package: "abc-data", path: "/usr/share/abc.txt" },
    licence: "MIT",
    content: AssetKind::Mesh,
    stand_in: ("knot", &[]),
};

/// Places in a folder of their own, with these files of these texts.
fn places(files: &[(&str, &str)]) -> (TempDir, Places) {
    let folder = tempfile::tempdir().expect("folder");
    for (file, text) in files {
        let path = folder.path().join(file);
        std::fs::create_dir_all(path.parent().expect("a folder")).expect("folder");
        std::fs::write(path, text).expect("file");
    }
    let [cache, cargo_home] = ["cache", "cargo"].map(|name| Some(folder.path().join(name)));
    let root = folder.path().to_owned();
    (folder, Places { cache, cargo_home, root })
}

/// The package's file.
const INSTALLED: &str = "usr/share/abc.txt";

#[test]
fn absent_installed_and_cached_are_told_apart() {
    let (_folder, empty) = places(&[]);
    assert_eq!(empty.locate(&ABC).expect("no failure"), None);
    let (_folder, places) = places(&[(INSTALLED, "abc")]);
    let found = || places.locate(&ABC).expect("no failure").expect("found");
    assert_eq!(found().1, "installed by Debian package abc-data");
    let stored = store(&places, &ABC, &found().0).expect("stored");
    assert_eq!(std::fs::read_to_string(stored).expect("text"), "abc");
    assert_eq!(found().1, "cached");
}

#[test]
fn a_file_with_another_sum_is_never_used() {
    let (folder, places) = places(&[(INSTALLED, "abd")]);
    let fault = places.locate(&ABC).unwrap_err();
    assert!(fault.contains("SHA-256"), "{fault}");
    let error = store(&places, &ABC, &folder.path().join(INSTALLED)).unwrap_err();
    assert!(error.contains("was not kept"), "{error}");
    assert!(!folder.path().join("cache/abc.txt").exists());
}

#[test]
fn crates_are_found_in_any_registry() {
    let file = "cargo/registry/src/some-registry/abc-1.0.0/media/abc.txt";
    let (folder, places) = places(&[(file, "abc")]);
    assert_eq!(places.find_in_registry("abc-1.0.0", "media/abc.txt"), [folder.path().join(file)]);
    assert!(places.find_in_registry("abc-2.0.0", "media/abc.txt").is_empty());
}

/// [`ABC`], but no package has it.
const BY_HAND: Asset = Asset { source: AssetSource::ByHand, ..ABC };

#[test]
fn an_asset_without_package_is_told_to_be_absent_and_that_is_no_failure() {
    let (_folder, places) = places(&[(INSTALLED, "abc")]);
    let status = fetch_one(&places, &BY_HAND).expect("no failure");
    assert_eq!(status.path, None);
    assert!(status.origin.contains("put abc.txt"), "{}", status.origin);
    assert!(status.origin.contains("cache"), "{}", status.origin);
}

#[test]
fn an_asset_put_there_by_hand_is_found_plain_and_packed_by_the_sum_of_its_content() {
    let (folder, places) = places(&[]);
    let cache = folder.path().join("cache");
    std::fs::create_dir_all(&cache).expect("folder");
    let packed = cache.join("abc.txt.gz");
    let mut gzip = GzEncoder::new(Vec::new(), Compression::fast());
    gzip.write_all(b"abc").expect("packed");
    std::fs::write(&packed, gzip.finish().expect("packed")).expect("file");
    let found = |asset| places.locate(asset).expect("no failure").map(|found| found.0);
    assert_eq!(found(&BY_HAND), Some(packed));
    // A package's file has its sum as it is.
    assert_eq!(found(&ABC), None);
    let plain = cache.join("abc.txt");
    std::fs::write(&plain, "abc").expect("file");
    assert_eq!(fetch_one(&places, &BY_HAND).expect("found").path, Some(plain));
    let (_folder, places) = self::places(&[("cache/abc.txt", "abd")]);
    let error = fetch_one(&places, &BY_HAND).err().expect("wrong");
    assert!(error.contains("put the right abc.txt"), "{error}");
}

#[test]
fn unknown_assets_get_the_nearest_name() {
    let error = named("buny").err().expect("unknown");
    assert!(error.contains("`bunny`"), "{error}");
    assert!(fetch(&["sponsa"])[0].is_err());
}
