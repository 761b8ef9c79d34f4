//! Names by a digest all code that the program runs on the host: its sources and the libraries below them. Shaders and scenes are data.

// How a build script speaks to cargo.
#![allow(clippy::print_stdout)]

use std::path::PathBuf;

fn main() {
    let mut files: Vec<PathBuf> = vec!["Cargo.toml".into(), "Cargo.lock".into()];
    let mut folders: Vec<PathBuf> = vec!["src".into()];
    while let Some(folder) = folders.pop() {
        println!("cargo::rerun-if-changed={}", folder.display());
        for entry in std::fs::read_dir(&folder).into_iter().flatten().flatten() {
            let path = entry.path();
            if path.is_dir() { folders.push(path) } else { files.push(path) }
        }
    }
    files.sort();
    let mut sum = 0xcbf2_9ce4_8422_2325_u64;
    for file in &files {
        println!("cargo::rerun-if-changed={}", file.display());
        // FNV-1a.
        for byte in std::fs::read(file).unwrap_or_default() {
            sum = (sum ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
        }
    }
    println!("cargo::rustc-env=FATHOM_HOST_CODE={sum:016x}");
}
