//! Rebuilds the crate when an embedded file changes: `include_dir!` does not track them itself.

use std::path::Path;

fn main() {
    for folder in ["shaders", "scenes", "benches/experiments"] {
        if Path::new(folder).is_dir() {
            println!("cargo::rerun-if-changed={folder}");
        }
    }
    println!("cargo::rerun-if-changed=build.rs");
}
