//! A release holds the folders that come with it: this module, built without debug assertions and alone in a crate.

use std::path::Path;
use std::process::Command;

use fathom::embedded::{EXPERIMENTS, FIGURES, SCENES, SHADERS};

use super::common::{Ends, Place};

/// A program that writes each file of each folder.
const WRITER: &str = r#"
    #[allow(dead_code)]
    #[path = "embedded.rs"]
    mod embedded;
    fn main() {
        for folder in [embedded::SHADERS, embedded::SCENES, embedded::EXPERIMENTS, embedded::FIGURES] {
            for path in folder.paths() {
                let to = std::path::Path::new("written").join(&*folder.name).join(&*path);
                std::fs::create_dir_all(to.parent().unwrap()).unwrap();
                std::fs::write(to, folder.file(&path).unwrap()).unwrap();
            }
        }
    }"#;

#[test]
fn a_release_holds_every_file() {
    let (place, source) = (Place::new(), Path::new(env!("CARGO_MANIFEST_DIR")));
    let folders = [SHADERS, SCENES, EXPERIMENTS, FIGURES];
    for folder in &folders {
        for path in folder.paths() {
            place.write(format!("{}/{path}", folder.name), folder.file(&path).unwrap());
        }
    }
    for (file, to) in [("Cargo.lock", "Cargo.lock"), ("src/base/embedded.rs", "embedded.rs")] {
        let bytes = std::fs::read(source.join(file)).unwrap();
        place.write(format!("src/embedded/{to}"), bytes);
    }
    place.write("src/embedded/main.rs", WRITER);
    let manifest = std::fs::read_to_string(source.join("Cargo.toml")).unwrap();
    let dependency = manifest.lines().find(|line| line.starts_with("rust-embed")).unwrap();
    let manifest = format!(
        "[package]\nname = \"writer\"\nedition = \"2024\"\n[workspace]\n[[bin]]\nname = \"writer\"\n\
         path = \"main.rs\"\n[dependencies]\n{dependency}\n[profile.dev]\ndebug-assertions = false\n"
    );
    place.write("src/embedded/Cargo.toml", manifest);
    let target = place.path("target");
    let mut cargo = Command::new(env!("CARGO"));
    cargo.args(["build", "--offline", "--quiet"]).env("CARGO_TARGET_DIR", &target);
    cargo.current_dir(place.path("src/embedded")).ends(0);
    for folder in &folders {
        std::fs::remove_dir_all(place.path(&*folder.name)).unwrap();
    }
    Command::new(target.join("debug/writer")).current_dir(place.path("")).ends(0);
    for folder in &folders {
        for path in folder.paths() {
            let written = std::fs::read(place.path(format!("written/{}/{path}", folder.name)));
            let same = written.is_ok_and(|bytes| bytes == *folder.file(&path).unwrap());
            assert!(same, "a release lacks {}/{path}", folder.name);
        }
    }
}
