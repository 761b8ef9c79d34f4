//! Rebuilds a release when a file is added to an embedded folder: the compiler knows only of those that are there.
//! A development build reads the folders from disk (`embedded.rs`) and needs no build.

// How a build script speaks to cargo.
#![allow(clippy::print_stdout)]

fn main() {
    if std::env::var("PROFILE").is_ok_and(|profile| profile == "release") {
        for folder in ["shaders", "scenes", "benches/experiments", "benches/figures"] {
            println!("cargo::rerun-if-changed=../../{folder}");
        }
    }
    println!("cargo::rerun-if-changed=build.rs");
}
