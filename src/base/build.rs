//! Rebuilds a release when a file is added to an embedded folder: the compiler knows only of those that are there.
//! A development build reads the folders from disk (`embedded.rs`) and needs no build. And tells the program how it is built.

// How a build script speaks to cargo.
#![allow(clippy::print_stdout)]

fn main() {
    if std::env::var("PROFILE").is_ok_and(|profile| profile == "release") {
        for folder in ["shaders", "scenes", "benches/experiments", "benches/figures"] {
            println!("cargo::rerun-if-changed=../../{folder}");
        }
    }
    println!("cargo::rerun-if-changed=build.rs");
    let variable = |name| std::env::var(name).unwrap_or_default();
    let version = std::process::Command::new(variable("RUSTC")).arg("-V").output();
    let version = version.map(|output| output.stdout).unwrap_or_default();
    for (name, value) in [
        ("PROFILE", variable("PROFILE")),
        ("OPT_LEVEL", variable("OPT_LEVEL")),
        ("TARGET", variable("TARGET")),
        ("FLAGS", variable("CARGO_ENCODED_RUSTFLAGS").replace('\u{1f}', " ")),
        ("COMPILER", String::from_utf8_lossy(&version).trim().to_owned()),
    ] {
        println!("cargo::rustc-env=FATHOM_{name}={value}");
    }
}
