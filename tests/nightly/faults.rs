//! The table of faults in docs/measuring.md, row by row: `faults.c` is a layer of Vulkan whose calls fail.

use std::path::Path;
use std::process::Command;

use fathom::record::Outcome;
use serde_json::Value;

use super::common::{CommandOutput, Ends, Place, cells, holds};

/// Bytes of the voxels of 24³, which no other buffer has.
const OF_24: &str = "1728";
const EXPERIMENT: &str = r#"
id = "faulty"
title = "t"
source = "s"
pipeline = "voxelize"
scene = "corner"
params = { view = { width = 16, height = 16 } }
sweep = [{ axis."voxel.resolution".values = [16, 20, 24, 32, 40] }]
"#;
const RUN: &str = "run faulty.toml --out out --budget 600 --visits 1 --no-ceilings --seed 1";

/// A folder with the layer, which a C compiler builds, and the experiment.
fn place() -> Place {
    let place = Place::new();
    let mut build = Command::new("cc");
    build.args(["-shared", "-fPIC", "-O1", "-Wall", "-Werror", "-o"]).arg(place.path("faults.so"));
    build.arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/nightly/faults.c")).ends(0);
    place.write("faults.json", include_str!("faults.json"));
    place.write("faulty.toml", EXPERIMENT);
    place
}

/// The program with a fault from the first buffer of so many bytes on, or from its begin.
fn faulty(place: &Place, words: &str, fault: &str, from: &str) -> Command {
    let mut command = place.fathom(words);
    command.env("VK_LAYER_PATH", place.path("")).env("WGPU_BACKEND", "vulkan");
    command.env("VK_INSTANCE_LAYERS", "VK_LAYER_fathom_faults");
    command.env("FAULT", fault).env("FAULT_FROM", from);
    command
}

/// A run with a fault, which ends with this status: names of the cells that failed, and why.
#[track_caller]
fn failures(place: &Place, fault: &str, status: i32) -> Vec<(String, String)> {
    let _ = std::fs::remove_dir_all(place.path("out"));
    holds(&faulty(place, RUN, fault, OF_24).ends(status).err, &["fault: "]);
    let failed = cells(&place.path("out")).into_iter().filter_map(|cell| match cell.outcome {
        Outcome::Failed { reason } => Some((cell.cell, reason)),
        _ => None,
    });
    failed.collect()
}

#[test]
fn a_fault_fails_the_cell_that_it_befalls() {
    let place = place();
    for (fault, reason) in [
        ("vkQueueSubmit 3 -4", "device lost: "),
        ("vkWaitSemaphores 3 -4", "device lost: "),
        ("vkQueueSubmit 3 hang", "device lost: a submission did not end within 600 s"),
        ("vkCreateFramebuffer 1 -2", "device lost: "),
        ("vkCreateComputePipelines 1 -13", "device lost: "),
        ("vkCreateBuffer 1 -2", "out of GPU memory: "),
        ("vkCreateImage 1 -2", "out of GPU memory: "),
    ] {
        let failed = failures(&place, fault, 1);
        let [(cell, why)] = &failed[..] else { panic!("{fault}: {failed:?}") };
        assert!(cell == "voxel.resolution=24" && why.starts_with(reason), "{fault}: {failed:?}");
    }
    assert!(failures(&place, "vkQueueSubmit 3 stall", 0).is_empty());
    // Lost a second time, the device is not opened again.
    let failed = failures(&place, "vkQueueSubmit -3 -4", 1);
    assert!(failed.iter().any(|(_, why)| why.ends_with("it was lost before")), "{failed:?}");
}

#[test]
fn a_fault_before_the_first_cell_ends_the_command() {
    let place = place();
    let small = "--pipeline voxelize --set view.width=16 --set view.height=16";
    let sweep = "sweep voxelize --scene corner --axis voxel.resolution=16,20 --out sweep";
    let render = format!("render corner {small}");
    let dump = format!("dump voxel/combine --scene corner {small}");
    for words in [RUN, sweep, &render, &dump, "audit", "ceilings", "verify voxel/combine"] {
        faulty(&place, words, "vkQueueSubmit 2 -4", "").refused("the GPU device was lost: ");
    }
    let doctor = faulty(&place, "doctor", "vkQueueSubmit 2 -4", "").ends(2);
    holds(&doctor.out, &["the GPU device was lost: "]);
    // Each call once, whether it lies on the way of this command or not.
    let calls = include_str!("faults.c").split(" CALL(").skip(1);
    for call in calls.filter_map(|rest| Some(rest.split_once(',')?.0)) {
        for result in [-2, -4] {
            let mut command = faulty(&place, &render, &format!("vk{call} 1 {result}"), "");
            let output = command.output().unwrap();
            let status = output.status.code().filter(|status| [0, 2].contains(status));
            CommandOutput::check(output, status.unwrap_or(2));
        }
    }
}

/// The verdict on timestamps alone, as lavapipe's own are wrong for some passes.
#[test]
fn impossible_timestamps_are_refused_and_those_of_any_period_and_width_are_read() {
    let place = place();
    let wrong = ["14 of 14 durations cannot be true", "timestamps are multiples of 65.5 µs"];
    for ticks in ["zero", "same", "backwards", "coarse", "1,36", "83,40"] {
        let audit = faulty(&place, "audit --json", "", "").env("TICKS", ticks).ends(0).json();
        let rows = audit["audit"].as_array().unwrap().iter();
        let mut rows = rows.filter(|row| row["clock"] == "timestamp");
        let is_wrong = |row: &Value| wrong.contains(&row["reason"].as_str().unwrap());
        assert!(rows.all(|row| is_wrong(row) != ticks.contains(',')), "{ticks}: {audit:#}");
    }
}
