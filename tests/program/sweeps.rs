//! `fathom sweep` over a mesh of one's own, as a user meets it.

use std::path::Path;
use std::process::Command;

use crate::common::{
    Ends, Place, SMALL, cells, holds, measured, own_experiment, records, write_records,
};
use crate::files::{GLTF, fan, glb};
use fathom::record::{Outcome, Record};

/// Small enough for a second a cell on a software driver.
const SIZES: &str = "--axis voxel.resolution=8,16,32 --set view.width=40 --set view.height=30 --set shadow.size=64 --set ao.rays=4";

#[test]
fn a_sweep_over_a_mesh_prints_tables_and_leaves_its_experiment() {
    let place = Place::new();
    let elsewhere = Place::new();
    let mesh = elsewhere.write("own.glb", glb(GLTF, &fan())).display().to_string();
    let sweep = format!("sweep volume_ao --scene {mesh} {SIZES} --camera 10,40 --visits 1");
    let output = place.fathom(format!("{sweep} --budget 10m --out out")).answer();
    let expected = [
        "times over voxels along the longest side",
        "growth over voxels along the longest side",
        "RMS error of occlusion",
        "More than 50 % of the frame",
        "3 cells measured, 0 skipped, 0 failed",
    ];
    holds(&output, &expected);
    assert!(!output.contains("NaN"), "{output}");
    let cells = cells(&place.path("out"));
    let mut errors = cells.iter().flat_map(|cell| &measured(cell).errors);
    assert!(errors.all(|error| error.value.is_finite()), "{output}");
    let page = place.read("out/index.html");
    holds(&page, &["id=\"sizes\"", "growth over voxels"]);
    assert!(!page.contains("href=\"#claims\""), "there is no such section");
    holds(&place.read("out/cells.csv"), &["axis:voxel.resolution"]);
    let private = elsewhere.path("").display().to_string();
    for name in ["records.jsonl", "index.html", "cells.csv", "summary.md"] {
        assert!(!place.read(format!("out/{name}")).contains(&private), "{name} tells {private}");
    }
}

/// What a command of the shell answers in this folder.
fn shell(command: &str, folder: &Path) -> String {
    let script = format!("fathom() {{ \"$0\" \"$@\"; }}; {command}");
    let mut shell = Command::new("sh");
    shell.args(["-c", &script, env!("CARGO_BIN_EXE_fathom")]).current_dir(folder).answer()
}

/// Runs the commands of error, summary and page of a run in the folder `out`, as they stand: the latter where they are printed for.
fn obey_printed(place: &Place, words: &str, out: &Path, here: &Path) {
    let begin = format!("{words} --visits 1 --budget 10m --out {}", out.display());
    place.fathom(begin).ends(0);
    let whole = cells(&place.path(out));
    // As the end of a budget leaves it.
    let leave_one = || {
        let mut all = records(&place.path(out));
        let cell = all.iter_mut().rev().find_map(Record::try_as_cell_mut).unwrap();
        cell.outcome = Outcome::OverBudget;
        write_records(&place.path(out), &all);
    };
    let resumes = |command: &str, folder: &Path| {
        shell(command, folder);
        let resumed = cells(&place.path(out));
        assert_eq!(resumed.len(), whole.len(), "{command}");
        let samples = resumed.iter().map(|cell| &measured(cell).frame.untimed_samples_ns);
        let first = &measured(&whole[0]).frame.untimed_samples_ns;
        assert!(samples.clone().any(|of| of.starts_with(first)), "{command}");
    };
    let refused = format!("run --resume --out {}", out.display());
    let refused = place.fathom(refused).refused("cells of another experiment");
    leave_one();
    resumes(refused.split('`').nth(1).unwrap(), &place.path(""));
    leave_one();
    place.fathom("report").arg(out).ends(0);
    let [summary, page] = ["summary.md", "index.html"].map(|name| place.read(out.join(name)));
    let printed = summary.split('`').find(|part| part.starts_with("fathom run")).unwrap();
    holds(&page, &[&format!("<code>{printed}</code>")]);
    resumes(printed, here);
    let copied = page.split("data-copy=\"").nth(1).unwrap().split('"').next().unwrap();
    let again = out.file_name().unwrap().display();
    let options = format!("--visits 1 --budget 10m --no-ceilings --out again-{again}");
    holds(&shell(&format!("{copied} {options}"), here), &["1 cells measured, 0 skipped, 0 failed"]);
}

#[test]
#[cfg_attr(not(feature = "nightly"), ignore = "a dozen runs: make test-all runs it")]
fn every_command_that_is_printed_of_a_run_measures_what_is_said() {
    let (place, elsewhere) = (Place::new(), Place::new());
    place.write("mine/own.toml", own_experiment(1));
    place.write("mine/own.glb", glb(GLTF, &fan()));
    let waves = "run uw-waves --no-ceilings --axis water=circular --axis water.amplitude_m=0.0,0.1";
    let here = place.path("");
    obey_printed(&place, &format!("{waves} {SMALL}"), Path::new("builtin"), &here);
    obey_printed(&place, "run mine/own.toml --no-ceilings", Path::new("own"), &here);
    let (sweep, out) = ("sweep volume_ao --scene mine/own.glb", elsewhere.path("out"));
    obey_printed(&place, &format!("{sweep} {SIZES}"), &out, &out);
    // Under the same path another mesh.
    place.write("mine/own.glb", glb(&GLTF.replace("0.125", "0.250"), &fan()));
    let told = shell("fathom run ./sweep.toml --visits 1 --out . --resume", &out);
    holds(&told, &["3 cells measured, 0 skipped, 0 failed, 0 kept"]);
}
