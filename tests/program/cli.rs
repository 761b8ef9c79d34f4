//! The command line as a user meets it. What measures runs on the default adapter, a software one at least.

mod exports;

use std::collections::BTreeSet;
use std::path::Path;
use std::process::Command;

use crate::common::{cells, fathom, measured, records, small};
use assert_cmd::prelude::*;
use fathom::picture::RgbImage;
use fathom::record::{NoteKind, Outcome, Record};
use itertools::Itertools;
use predicates::prelude::*;
use predicates::str::contains;

fn picture(path: &Path) -> RgbImage {
    RgbImage::from_png(&std::fs::read(path).unwrap(), 8192, 64 << 20).unwrap()
}

/// Runs that print nothing but one error.
#[track_caller]
fn refused(arguments: &[&str], reason: &str) {
    let output = fathom().args(arguments).output().unwrap();
    crate::common::refused(&output, reason);
    assert!(output.stdout.is_empty(), "{arguments:?}");
}

/// The second half is found by planning, before measuring.
#[test]
fn bad_input_is_one_clear_line_and_status_2() {
    for (arguments, reason) in [
        ("run uw-defalt", "unknown experiment `uw-defalt`; did you mean `uw-default`?"),
        ("run --set nothing", "not of the form PATH=VALUE"),
        ("run --profile qick", "'quick'"),
        ("run --budget 0", "--budget must be a positive number"),
        ("rum", "'run'"),
        ("render tnk", "did you mean `tank`"),
        ("render tank --pipeline underwatr", "did you mean `underwater`"),
        ("render --figure uw6", "unknown figure `uw6`; did you mean `uw-6`?"),
        ("render tank --samples 3", "samples of a pixel are 1, 4, 9 or 16"),
        ("list parameters --set caustics.gird=3", "did you mean `caustics.grid`"),
        ("report no/such/folder", "no/such/folder/records.jsonl"),
        ("list stages --pipeline hsoa", "unknown pipeline `hsoa`; did you mean `hsao`?"),
        (
            "list stages --scene tank",
            "--scene does not apply to `list stages`, only to `list parameters`",
        ),
        ("list scenes --pipeline hsao", "does not apply"),
        ("list --set caustics.grid=3", "does not apply to `list`"),
        ("run uw-default --set caustics.gird=3", "did you mean `caustics.grid`"),
        ("run uw-default --set caustics.grid=few", "takes a whole number"),
        ("run uw-waves --axis watr=circular", "did you mean `water`"),
        ("run uw-default --adapter none-such", "no adapter matches"),
        ("bench caustics/trce", "no gate cell matches `caustics/trce`"),
        ("dump caustics/trce --set caustics.grid=8", "did you mean `caustics/trace`"),
    ] {
        refused(&arguments.split(' ').collect::<Vec<_>>(), reason);
    }
}

#[test]
fn a_light_and_a_grid_that_give_nothing_are_errors_in_every_command() {
    let none = ["--set", "light.direction=[0,0,0]"];
    let beside = ["voxel.cells=[8,8,8]", "voxel.voxel_m=0.1", "voxel.origin_m=[500,500,500]"];
    let beside = beside.map(|set| ["--set", set]).concat();
    let folder = tempfile::tempdir().unwrap();
    let points = folder.path().join("points.csv");
    std::fs::write(&points, "x,y,z,nx,ny,nz\n0,-4,0,0,1,0\n").unwrap();
    let [out, points] = [folder.path().join("out"), points].map(|p| p.display().to_string());
    let query = ["query", "ao", "--scene", "ball", "--points", &points];
    let ao = ["--pipeline", "volume_ao"];
    let commands: [(&[&str], &[&str]); 4] = [
        (&["run", "vao-guard", "--no-ceilings", "--out", &out], &[]),
        (&["render", "slab", "-o", &out], &ao),
        (&["dump", "ao/march", "--scene", "slab", "-o", &out], &ao),
        (&query, &[]),
    ];
    for (command, pipeline) in commands {
        let with = |set: &[&'static str]| {
            let all = command.iter().chain(pipeline).copied();
            all.chain(set.iter().copied()).collect::<Vec<&str>>()
        };
        refused(&with(&none), "light.direction = [0.0, 0.0, 0.0] has no direction");
        refused(&with(&beside), "voxel.cells, voxel.origin_m and voxel.voxel_m place the grid at");
    }
    assert!(!folder.path().join("out").exists());
}

#[test]
fn every_command_tells_a_stand_in_and_a_query_refuses_it() {
    let folder = tempfile::tempdir().unwrap();
    let points = folder.path().join("points.csv");
    std::fs::write(&points, "x,y,z,nx,ny,nz\n0,-4,0,0,1,0\n").unwrap();
    // Damaged, and no package beside it.
    std::fs::write(folder.path().join("sponza.obj"), "v 0 0 0\n").unwrap();
    let with = |arguments: &[&str], file: &Path| {
        let mut command = fathom();
        command.args(arguments).arg(file);
        command.args(["--set", "voxel.resolution=16"]);
        let places = ["FATHOM_CACHE", "CARGO_HOME"];
        command.envs(places.map(|name| (name, folder.path())));
        command
    };
    let told = contains("stand-in: sponza: asset has the wrong SHA-256").count(1);
    let voxelize = ["--pipeline", "voxelize", "--set", "view.width=16"];
    let mut render = with(&["render", "sponza", "-o"], &folder.path().join("x.png"));
    render.args(voxelize).assert().success().stderr(told.clone());
    let query = ["query", "ao", "--scene", "sponza", "--points"];
    let refusal =
        contains("error: scene `sponza` has stand-ins").and(contains("--allow-stand-ins"));
    let refused = with(&query, &points).assert().code(2);
    refused.stderr(refusal).stdout("");
    let mut allowed = with(&query, &points);
    let allowed = allowed.args(["--allow-stand-ins", "--set", "ao.rays=4"]);
    let answered = allowed.assert().success();
    answered.stderr(told).stdout(contains("x,y,z,nx,ny,nz,occlusion"));
}

#[test]
fn a_folder_that_cannot_be_written_to_is_found_before_measuring() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("file");
    std::fs::write(&file, "in the way").unwrap();
    let out = file.to_str().unwrap();
    refused(&["run", "uw-default", "--out", out], "choose another folder with --out");
    assert_eq!(std::fs::read_to_string(&file).unwrap(), "in the way");
}

#[test]
fn listings_name_what_there_is() {
    let lists = |what: &str| fathom().args(["list", what]).assert().success();
    lists("experiments").stdout(contains("uw-photons").and(contains("uw-waves")));
    lists("scenes").stdout(contains("tank").and(contains("plane")));
    lists("stages").stdout(contains("caustics/trace").and(contains("compose")));
    lists("parameters").stdout(contains("water.refractive_index").and(contains("1.33")));
    lists("pipelines").stdout(contains("underwater"));
}

#[test]
fn a_listing_takes_the_options_that_apply_to_it() {
    let stages = |pipeline: &str| {
        let mut list = fathom();
        list.args(["list", "stages", "--pipeline", pipeline]);
        let output = list.assert().success().get_output().stdout.clone();
        let text = String::from_utf8(output).unwrap();
        let names = text.lines().filter_map(|line| line.split_whitespace().next());
        names.map(str::to_owned).collect::<Vec<String>>()
    };
    let hsao = "frame scene/deform shadow/depth scene/gbuffer hsao/march hsao/filter ao/compose ao/glass post/luminance";
    assert_eq!(stages("hsao").join(" "), hsao);
    assert!(stages("voxelize").contains(&"voxel/overlap".to_owned()));
}

fn run(out: &Path, arguments: &[&str]) -> Command {
    let mut command = fathom();
    command
        .args(["run", "uw-default", "--no-ceilings", "--budget", "1", "--seed", "1", "--out"])
        .arg(out);
    command.args(small()).args(arguments);
    command
}

#[test]
fn a_run_leaves_records_reports_and_pictures_and_resumes() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path();
    let ended = run(out, &[]).assert().success();
    ended.stdout(
        contains("1 cells measured").and(contains("slowest stages: ")).and(contains("summary.md")),
    );
    let first = cells(out);
    let all = records(out);
    let [Record::Run(_), Record::Experiment(_), .., Record::End(end)] = &all[..] else {
        panic!("{all:?}");
    };
    assert!(!end.interrupted);
    assert!(end.measured_gpu_s > 0.0 && end.measuring_wall_s >= end.measured_gpu_s);
    let measured = measured(&first[0]);
    let frame = &measured.frame;
    assert!(frame.untimed.n >= 8 && frame.untimed.ends()[0] <= frame.untimed.median);
    for stage in &measured.stages {
        assert_eq!(stage.samples_ns.len(), frame.envelope_samples_ns.len(), "{}", stage.stage);
    }
    assert!(measured.allocated_bytes > 0 && measured.warm_up_frames >= 2);
    for name in ["summary.md", "cells.csv", "renders/uw-default_base.png"] {
        assert!(out.join(name).metadata().unwrap().len() > 0, "{name}");
    }

    let occupied = run(out, &[]).assert().code(2);
    occupied.stderr(contains("--resume"));
    let resumed = run(out, &["--resume"]).assert().success();
    resumed.stdout(contains("0 cells measured, 0 skipped, 0 failed, 1 kept"));
    assert_eq!(cells(out), first);

    let before = std::fs::read(out.join("cells.csv")).unwrap();
    std::fs::remove_file(out.join("cells.csv")).unwrap();
    fathom().arg("report").arg(out).assert().success();
    assert_eq!(std::fs::read(out.join("cells.csv")).unwrap(), before);
}

#[test]
fn a_cell_beyond_the_limits_is_skipped_and_recorded() {
    let folder = tempfile::tempdir().unwrap();
    let refused = run(folder.path(), &["--set", "view.width=900000"]).assert().code(2);
    refused.stderr(contains("every cell was skipped").and(contains("900000")));
    let cell = cells(folder.path()).remove(0);
    let Outcome::Skipped { reason } = cell.outcome else { panic!("{:?}", cell.outcome) };
    assert!(reason.contains("900000"), "{reason}");
}

/// Each panel of a figure, and a sheet that holds them.
#[test]
fn a_figure_is_rendered_as_panels_and_a_sheet() {
    let out = tempfile::tempdir().unwrap();
    let mut render = fathom();
    render.args(["render", "--figure", "uw-5", "--set", "shadow.size=128", "-o"]).arg(out.path());
    render.args(small()).assert().success();
    let size = |name: &str| picture(&out.path().join(name)).size();
    let (a, b, sheet) = (size("uw-5-a.png"), size("uw-5-b.png"), size("uw-5.png"));
    assert_eq!(a, b);
    assert!(sheet[0] > a[0] + b[0] && sheet[1] > a[1], "{sheet:?} holds {a:?} and {b:?}");
}

/// More samples of a pixel change edges and nothing else: the size of the picture stays, and most of it is the same.
#[test]
fn samples_smooth_a_picture() {
    let out = tempfile::tempdir().unwrap();
    let rendered = |samples: &str| {
        let path = out.path().join(format!("{samples}.png"));
        let mut render = fathom();
        render.args(["render", "crates", "--pipeline", "voxelize", "--samples", samples, "-o"]);
        let size = ["--set", "view.width=64", "--set", "view.height=48"];
        let volume = ["--set", "voxel.resolution=16"];
        render.arg(&path).args(size).args(volume).assert().success();
        picture(&path)
    };
    let (one, four) = (rendered("1"), rendered("4"));
    assert_eq!(one.size(), four.size());
    let changed = one
        .pixels()
        .iter()
        .zip(four.pixels())
        .filter(|(a, b)| a.iter().zip(**b).any(|(a, b)| a.abs_diff(b) > 8));
    let changed = changed.count();
    assert!((10..64 * 48 / 2).contains(&changed), "{changed} pixels changed");
}

#[test]
fn a_rendered_file_is_a_picture_of_the_asked_size() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("plane.png");
    fathom().args(["render", "plane", "-o"]).arg(&path).args(small()).assert().success();
    assert_eq!(picture(&path).size(), [64, 64]);
    let other = folder.path().join("plane.jpg");
    let arguments = ["render", "plane", "-o", other.to_str().unwrap()];
    refused(&[&arguments[..], &small().collect_vec()].concat(), "their names end in `.png`");
}

#[test]
fn a_dump_says_what_its_columns_are() {
    let folder = tempfile::tempdir().unwrap();
    let mut dump = fathom();
    dump.args(["dump", "caustics/trace", "-o"]).arg(folder.path()).args(small());
    dump.assert().success();
    let array = crate::common::array(&folder.path().join("caustics-trace-photons.npy"));
    let about = std::fs::read(folder.path().join("caustics-trace-photons.json")).unwrap();
    let about: serde_json::Value = serde_json::from_slice(&about).unwrap();
    assert_eq!(array.shape, [16 * 16 * 4, 13]);
    assert_eq!(about["columns"].as_array().unwrap().len(), 13);
    assert_eq!(about["shape"], serde_json::json!(array.shape));
    assert_eq!(about["params"]["water"]["refractive_index"], 1.33);
}

#[test]
fn a_volume_is_dumped_with_its_grid() {
    let folder = tempfile::tempdir().unwrap();
    fathom()
        .args(["dump", "voxel/unpack", "--pipeline", "voxelize"])
        .args(["--scene", "slab", "--set", "voxel.resolution=24", "-o"])
        .arg(folder.path())
        .assert()
        .success();
    let file = |ending: &str| {
        let mut files = std::fs::read_dir(folder.path()).unwrap();
        let found = files.find_map(|file| {
            Some(file.ok()?.path()).filter(|p| p.extension().is_some_and(|e| e == ending))
        });
        found.unwrap()
    };
    let array = crate::common::array(&file("npy"));
    let about: serde_json::Value =
        serde_json::from_slice(&std::fs::read(file("json")).unwrap()).unwrap();
    assert_eq!(about["axes"], serde_json::json!(["z", "y", "x"]));
    assert_eq!(about["shape"], serde_json::json!(array.shape));
    assert_eq!(array.shape[2], 24);
    let occupied = array.values.iter().filter(|value| **value == 1.0).count();
    let empty = array.values.iter().filter(|value| **value == 0.0).count();
    assert_eq!(occupied + empty, array.values.len(), "a binary volume");
    // A slab lies flat: all that is occupied lies within few layers, at the height that the grid gives them.
    let [_, height, width] = array.shape[..] else { panic!("{:?}", array.shape) };
    let occupied = array.values.iter().positions(|value| *value > 0.0);
    let layers: BTreeSet<usize> = occupied.map(|place| place / width % height).collect();
    assert!(!layers.is_empty() && layers.len() <= 3, "{layers:?}");
    assert!(about["grid"]["spacing_m"][1].as_f64().unwrap() > 0.0);
}

#[test]
fn a_cell_of_volume_occlusion_has_its_error_and_pictures() {
    let out = tempfile::tempdir().unwrap();
    fathom()
        .args(["run", "vao-guard", "--no-ceilings", "--profile", "quick", "--budget", "1", "--out"])
        .arg(out.path())
        .args(["--axis", "scene=corner", "--axis", "ao.guard=variable"])
        .args(["--set", "view.width=48", "--set", "view.height=48"])
        .args(["--set", "voxel.resolution=32", "--set", "shadow.size=64"])
        .assert()
        .success();
    let cells = cells(out.path());
    assert_eq!(cells.len(), 1);
    let measured = measured(&cells[0]);
    assert_eq!(measured.notes.iter().find(|note| note.kind == NoteKind::NotComputed), None);
    let error = measured.figures()["ao_rmse"];
    assert!(error > 0.0 && error < 0.2, "{error}");
    assert!(measured.quantities["ao_reference_mean"] > 0.01);
    // Below the picture of occlusion stands a scale of its greys.
    for (ending, scale_px) in [("", 26), ("~error", 0)] {
        let name = format!("vao-guard_scene=corner,ao.guard=variable{ending}.png");
        let size = picture(&out.path().join("renders").join(name)).size();
        assert_eq!(size, [48, 48 + scale_px]);
    }
}

#[cfg(unix)]
#[test]
fn an_interrupted_run_ends_cleanly_and_resumes() {
    use std::process::Stdio;

    let folder = tempfile::tempdir().unwrap();
    let out = folder.path();
    let measure = |budget: &str, resume: &[&str]| {
        let mut process = fathom();
        process.args([
            "run",
            "uw-waves",
            "--no-ceilings",
            "--budget",
            budget,
            "--precision",
            "1e-9",
            "--out",
        ]);
        process.arg(out).args(small()).args(resume).stdout(Stdio::piped()).stderr(Stdio::null());
        process
    };
    let mut child = measure("600", &[]).spawn().unwrap();
    // In the midst of its samples.
    let begun = || {
        let samples = out.join("samples.jsonl").metadata();
        samples.is_ok_and(|samples| samples.len() > 0)
    };
    while !begun() {
        assert_eq!(child.try_wait().unwrap(), None, "it ended before there were samples");
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    let interrupt = Command::new("kill").args(["-INT", &child.id().to_string()]).status();
    assert!(interrupt.unwrap().success());
    assert_eq!(child.wait().unwrap().code(), Some(130));
    assert!(matches!(records(out).last(), Some(Record::End(end)) if end.interrupted));
    let first = cells(out);

    let resumed = measure("1", &["--resume"]).output().unwrap();
    assert!(resumed.status.success());
    let all = cells(out);
    let mut names: Vec<&str> = all.iter().map(|cell| cell.cell.as_str()).collect();
    let total = names.len();
    names.sort_unstable();
    names.dedup();
    assert_eq!(names.len(), total, "no cell is measured twice");
    assert_eq!(total, 8, "{names:?}");
    assert_eq!(all[..first.len()], first, "what was measured stays");
}

#[test]
fn a_query_answers_at_points_in_their_order() {
    let folder = tempfile::tempdir().unwrap();
    let [points, out] = ["points.csv", "out.csv"].map(|name| folder.path().join(name));
    let query = |text: &str| {
        std::fs::write(&points, text).unwrap();
        let mut query = fathom();
        query.args(["query", "ao", "--scene", "ball", "--points"]).arg(&points);
        query.args(["--set", "voxel.resolution=48", "--set", "ao.rays=32"]);
        query
    };
    // On the floor far from the ball, beside its foot, and on its top.
    let text = "note,x,y,z,nx,ny,nz\n\
        far,-2.5,-4,-2.5,0,1,0\n\
        foot,0.6,-4,0,0,3,0\n\
        top,0,-2.4,0,0,1,0\n";
    query(text).arg("-o").arg(&out).assert().success();
    let written = std::fs::read_to_string(&out).unwrap();
    let mut lines = written.lines();
    assert_eq!(lines.next(), Some("x,y,z,nx,ny,nz,occlusion"));
    let rows: Vec<Vec<f64>> =
        lines.map(|line| line.split(',').map(|v| v.parse().unwrap()).collect()).collect();
    assert_eq!(rows[1][..6], [0.6, -4.0, 0.0, 0.0, 3.0, 0.0]);
    let occlusion: Vec<f64> = rows.iter().map(|row| row[6]).collect();
    assert!(occlusion[0] < 0.02 && occlusion[2] < 0.02, "{occlusion:?}");
    assert!(occlusion[1] > 0.2 && occlusion[1] < 0.9, "{occlusion:?}");
    query(text).assert().success().stdout(contains("x,y,z,nx,ny,nz,occlusion\n"));

    let faulty = "x,y,z,nx,ny,nz\n0,-4,0,0,1,0\n0,-4,0,0,NaN,0\n";
    let fault = contains("points.csv, line 3, column `ny`: `NaN` is not a number");
    query(faulty).assert().code(2).stderr(fault);
    let mut small = query(text);
    small.args(["--set", "ao.r_max_m=0.001"]);
    let fault = contains("error: ao.r_max_m is 1.000e-3 m, less than a voxel");
    small.assert().code(2).stderr(fault);
}
