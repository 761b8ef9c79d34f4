//! Names the code of the references by its digest, for answers that are kept on disk (`cache.rs`).

// How a build script speaks to cargo.
#![allow(clippy::print_stdout)]

use std::fs;
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};

fn main() {
    println!("cargo::rerun-if-changed=.");
    println!("cargo::rustc-env=FATHOM_REFERENCES={}", digest(Path::new(".")));
}

fn digest(folder: &Path) -> String {
    let mut files = files(folder);
    files.sort();
    let mut digest = Sha256::new();
    for file in files {
        digest.update(file.to_string_lossy().as_bytes());
        digest.update(fs::read(&file).expect("a source file can be read"));
    }
    digest.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
}

fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).expect("the sources can be listed");
    let paths = entries.map(|entry| entry.expect("an entry can be read").path());
    paths.flat_map(|path| if path.is_dir() { files(&path) } else { vec![path] }).collect()
}
