//! A second implementation of WebGPU: Dawn, Chromium's, runs frames that fathom wrote down and leaves the same. On SwiftShader, as Dawn
//! refuses lavapipe of Mesa 22.3. Without Node, the npm package or the driver this test says that it was skipped.
//! `FATHOM_REPLAY=all cargo test --test program replayed` runs every gate configuration in place of one of each pipeline, and
//! `FATHOM_REPLAY_DRIVER=ICD.json` runs them on another driver.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;

use fathom::Catalog;
use fathom::compare::cells::Gates;
use fathom::compare::protocol::GateConfiguration;
use rayon::prelude::*;
use serde_json::Value;

use crate::common::{Ends, Place, ended};

const ALL: &str = "FATHOM_REPLAY";
const DRIVER: &str = "FATHOM_REPLAY_DRIVER";
const SWIFTSHADER: &str = "/usr/lib/chromium/libvk_swiftshader.so";
const DAWN: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/target/npm/node_modules/webgpu/index.js");
const REPLAY: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scripts/replay.mjs");
/// Of the values of an output, how many may differ by more than rounding. None does here; where threads add in another order, some may.
const SHARE: &str = "0.001";

#[test]
fn dawn_leaves_what_wgpu_leaves() {
    let node = Command::new("node").arg("--version").output().is_ok();
    let driver = std::env::var_os(DRIVER).is_some() || Path::new(SWIFTSHADER).exists();
    if !node || !driver || !Path::new(DAWN).exists() {
        println!(
            "skipped: no Node, no package `webgpu`, or no SwiftShader (scripts/setup.sh test)"
        );
        return;
    }
    let mut seen = BTreeSet::new();
    let mut configurations = Gates::load(None, Catalog::builtin().gates).unwrap().configurations;
    configurations.retain(|of| seen.insert(of.pipeline.clone()) || std::env::var_os(ALL).is_some());
    configurations.par_iter().for_each(|configuration| {
        let place = Place::new();
        bundle(&place, configuration).ends(0);
        let told = ended(replay(&place), 0);
        let outputs = told.out.lines().count();
        assert!(outputs > 0, "{}: no outputs", configuration.id);
        println!("{}: {outputs} outputs", configuration.id);
        if configuration.id == "pool" {
            // A control: Dawn runs the shaders that the bundle holds.
            change_a_shader(&place.path("bundle/trace"));
            ended(replay(&place), 1);
        }
    });
}

#[test]
fn a_bundle_needs_a_folder_of_its_own() {
    let place = Place::new();
    place.write("bundle/trace/own", "kept");
    place.fathom("dump --bundle -o bundle").refused("it is there already: a bundle needs a folder");
    assert_eq!(place.read("bundle/trace/own"), "kept");
    place.fathom("dump compose --bundle").refused("--bundle");
    place.fathom("dump").refused("<STAGE>");
}

fn bundle(place: &Place, of: &GateConfiguration) -> Command {
    let manifest =
        r#"{"file_format_version":"1.0.0","ICD":{"library_path":"PATH","api_version":"1.0.5"}}"#;
    place.write("swiftshader.json", manifest.replace("PATH", SWIFTSHADER));
    let words = format!("dump --bundle -o bundle --pipeline {} --scene {}", of.pipeline, of.scene);
    let mut command = place.fathom(words);
    for (path, value) in &of.params {
        set(&mut command, path, value);
    }
    on_driver(place, command)
}

/// A table's values one by one, as the command line takes no tables.
fn set(command: &mut Command, path: &str, value: &Value) {
    match value {
        Value::Object(table) => {
            table.iter().for_each(|(name, value)| set(command, &format!("{path}.{name}"), value));
        }
        value => drop(command.args(["--set", &format!("{path}={value}")])),
    }
}

fn replay(place: &Place) -> Command {
    let mut command = Command::new("node");
    command.arg(REPLAY).arg(place.path("bundle")).arg(SHARE).env("DAWN", DAWN);
    on_driver(place, command)
}

fn on_driver(place: &Place, mut command: Command) -> Command {
    let swiftshader = || place.path("swiftshader.json");
    let manifest = std::env::var_os(DRIVER).map_or_else(swiftshader, PathBuf::from);
    command.env("VK_DRIVER_FILES", &manifest).env("VK_ICD_FILENAMES", manifest);
    // A library of Dawn's looks for a display.
    command.env("XDG_RUNTIME_DIR", place.path(""));
    command
}

/// The screen shift of what the water mirrors.
fn change_a_shader(trace: &Path) {
    let mut changed = 0;
    for file in std::fs::read_dir(trace).unwrap() {
        let path = file.unwrap().path();
        let Ok(text) = std::fs::read_to_string(&path) else { continue };
        let other = text.replace("const DISTORTION: f32 = 0.08f;", "const DISTORTION: f32 = 0.8f;");
        changed += u32::from(other != text);
        std::fs::write(&path, other).unwrap();
    }
    assert_eq!(changed, 1, "shaders with the constant");
}
