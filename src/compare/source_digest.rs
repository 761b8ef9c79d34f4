//! What build scripts share: a digest of files.

// How a build script speaks to cargo.
#![allow(clippy::print_stdout)]

use std::path::PathBuf;

/// FNV-1a over some files, those in these folders, and a text. Cargo runs the script again where one changes.
pub fn digest(mut files: Vec<PathBuf>, mut folders: Vec<PathBuf>, text: &str) -> u64 {
    while let Some(folder) = folders.pop() {
        println!("cargo::rerun-if-changed={}", folder.display());
        for entry in std::fs::read_dir(&folder).into_iter().flatten().flatten() {
            let path = entry.path();
            if path.is_dir() { folders.push(path) } else { files.push(path) }
        }
    }
    files.sort();
    let mut sum = 0xcbf2_9ce4_8422_2325_u64;
    let mut add = |bytes: &[u8]| {
        for byte in bytes {
            sum = (sum ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3);
        }
    };
    for file in &files {
        println!("cargo::rerun-if-changed={}", file.display());
        add(&std::fs::read(file).unwrap_or_default());
    }
    add(text.as_bytes());
    sum
}
