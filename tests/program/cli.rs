//! The command line as a user meets it. What measures runs on the default adapter, a software one at least.

mod exports;

use std::path::Path;
use std::process::Command;

use super::private;
use crate::common::{Ends, Place, SMALL, cells, fathom, holds, measured, records};
use fathom::record::{NoteKind, Outcome, Record};
use image::RgbImage;
use serde_json::Value;

fn picture(path: &Path) -> RgbImage {
    image::open(path).unwrap().into_rgb8()
}

/// The second half is found by planning, before measuring.
#[test]
fn bad_input_is_one_clear_line_and_status_2() {
    for (words, reason) in [
        ("run uw-defalt", "unknown experiment `uw-defalt`; did you mean `uw-default`?"),
        ("run tank", "experiment `tank`: this is a scene; see `fathom list experiments`"),
        ("run uw-photons --axis zzz=3", "has no axis `zzz`; there are caustics.grid, "),
        ("run --set nothing", "not of the form PATH=VALUE"),
        ("run --profile qick", "'quick'"),
        ("run --shard 3/2", "'3/2'"),
        ("run --budget 0", "a time above 0 is needed, such as 90s"),
        ("rum", "'run'"),
        ("render no/such/file.toml", "no/such/file.toml"),
        (
            "verify cuastics",
            "no check matches `cuastics`; did you mean `caustics`?; there are checks of ",
        ),
        ("render tank --pipeline underwatr", "did you mean `underwater`"),
        ("render --figure uw6", "unknown figure `uw6`; did you mean `uw-6`?"),
        ("render plane -o plane.jpg", "their names end in `.png`"),
        ("render tank --samples 3", "samples of a pixel are 1, 4, 9 or 16"),
        ("list parameters --set caustics.gird=3", "did you mean `caustics.grid`"),
        ("report no/such/folder", "no/such/folder/records.jsonl"),
        ("list stages --pipeline hsoa", "unknown pipeline `hsoa`; did you mean `hsao`?"),
        ("list stages --scene tank", "--scene and --set apply to `list parameters` only"),
        ("list scenes --pipeline hsao", "--pipeline applies to `list stages` and "),
        ("run uw-waves --axis watr=circular", "did you mean `water`"),
        ("run uw-default --adapter none-such", "no adapter matches"),
        ("audit --without float32", "there are timestamp-query, timestamp-query-inside-encoders, "),
        ("dump ao/march", "; with --pipeline it is run by volume_ao"),
        ("dump caustics/trce --set caustics.grid=8", "did you mean `caustics/trace`"),
        ("render slab --set light.direction=[0,0,0] --pipeline volume_ao", "has no direction"),
        (
            "run vao-guard --set voxel.cells=[8,8,8] --set voxel.voxel_m=0.1 --set voxel.origin_m=[500,500,500]",
            "voxel.cells, voxel.origin_m and voxel.voxel_m place the grid at",
        ),
        ("render plane --set water.waves=[1]", "a list of tables"),
    ] {
        fathom(words).refused(reason);
    }
    let unlike_any = fathom("run --parallel 3").refused("unexpected argument '--parallel'");
    assert!(!unlike_any.contains("tip"), "{unlike_any}");
}

#[test]
fn a_stand_in_is_told_once() {
    let place = Place::new();
    // Damaged, and no package beside it.
    place.write("sponza.obj", "v 0 0 0\n");
    let words =
        "render sponza -o x.png --pipeline voxelize --set view.width=16 --set voxel.resolution=16";
    let mut command = place.fathom(words);
    let output = command.envs(["FATHOM_CACHE", "CARGO_HOME"].map(|name| (name, place.path(""))));
    let told = output.ends(0).err;
    let stand_ins = told.matches("stand-in: sponza: asset has the wrong SHA-256");
    assert_eq!(stand_ins.count(), 1, "{told}");
}

#[test]
fn listings_name_what_there_is() {
    for (what, named) in [
        ("experiments", ["uw-photons", "uw-waves"]),
        ("scenes", ["tank", "plane"]),
        ("stages", ["caustics/trace", "compose"]),
        ("parameters", ["water.refractive_index", "1.33"]),
        ("pipelines", ["underwater", "hsao"]),
        ("claims", ["caustics-trace-linear", "uw-photons"]),
        ("exporters", ["junit", "bencher"]),
    ] {
        let rows = fathom(format!("list {what} --json")).ends(0).json();
        let rows = rows.as_array().unwrap();
        for name in named {
            let is_named = |row: &Value| {
                row.as_object().unwrap().values().any(|value| value.to_string().contains(name))
            };
            assert!(rows.iter().any(is_named), "{name}: {rows:?}");
        }
    }
    holds(&fathom("list exporters").answer(), &["csv", "cells.csv", "plots", "bencher"]);
    let all = fathom("list --json").ends(0).json();
    assert_eq!(all["pipelines"].as_array().unwrap().len(), fathom::pipelines::KINDS.len());
}

/// Completions know every command, the help every pipeline.
#[test]
fn shells_and_readers_are_told_what_there_is() {
    let script = fathom("completions bash").answer();
    let help = fathom("--help").answer();
    holds(&script, &["verify", "--budget"]);
    let words = help.split_whitespace().collect::<Vec<_>>().join(" ");
    for kind in fathom::pipelines::KINDS {
        holds(&words, &[&format!("({})", kind.name)]);
    }
    holds(&words, &["3 `compare` was inconclusive"]);
    assert!(!help.contains('\u{1b}'), "no colours where there is no terminal");
}

#[test]
fn checks_and_the_audit_answer_in_json_and_notes_can_be_turned_off() {
    let output = fathom("verify voxel/clear --json").ends(0);
    let answer = output.json();
    assert_eq!(answer["all_sound"], true);
    assert_eq!(answer["checks"][0]["stage"], "voxel/clear");
    holds(&output.err, &["1 of "]);
    let quiet = fathom("verify voxel/clear --json --quiet").ends(0);
    assert_eq!((quiet.json(), quiet.err.contains("1 of ")), (answer, false));
    fathom("render tnk --quiet").refused("did you mean `tank`");
    let output = fathom("audit --json").envs(private::variables(private::NOWHERE)).ends(0);
    assert!(!output.out.contains(private::MARK), "{}", output.out);
    let audit = output.json();
    for pass in ["render", "compute", "copy"] {
        assert!(audit["clocks"][pass].is_string(), "{audit}");
    }
    // As `run`, it starts itself again on one core, where the CPU time of the process is audited.
    let rows = audit["audit"].as_array().expect("rows");
    assert!(rows.iter().any(|row| row["clock"] == "process_cpu"), "{audit}");
}

#[test]
fn a_doctor_without_an_adapter_says_what_to_install() {
    let output = fathom("doctor").env("WGPU_BACKEND", "dx12").ends(2);
    let named = ["fault", "(WGPU_BACKEND=dx12)", "apt-get install libvulkan1 mesa-vulkan-drivers"];
    holds(&output.out, &named);
}

/// A run of the default frame into the folder `out`.
fn run(place: &Place, options: &str) -> Command {
    let words =
        "run uw-default --cell base --no-ceilings --budget 10m --visits 1 --seed 1 --out out";
    place.fathom(format!("{words} {SMALL} {options}"))
}

#[test]
fn a_run_leaves_records_reports_and_pictures_and_resumes() {
    let place = Place::new();
    let out = &place.path("out");
    let output = run(&place, "").answer();
    holds(&output, &["1 cells measured", "slowest stage of each pipeline: ", "summary.md"]);
    let first = cells(out);
    let all = records(out);
    let [Record::Run(_), Record::Experiment(_), .., Record::End(end)] = &all[..] else {
        panic!("{all:?}");
    };
    assert!(!end.interrupted);
    assert!(end.measured_gpu_s > 0.0 && end.measuring_wall_s >= end.measured_gpu_s);
    let measured = measured(&first[0]);
    let frame = &measured.frame;
    assert_eq!(frame.untimed.n, *frame.visits.last().unwrap() as usize + 1);
    for stage in &measured.stages {
        assert_eq!(stage.samples_ns.len(), frame.envelope_samples_ns.len(), "{}", stage.stage);
        assert!(stage.samples_ns.iter().all(|ns| *ns > 0.0), "{stage:?}");
        let time = fathom::visits::estimate_of_samples(&stage.samples_ns, &frame.visits);
        assert_eq!(stage.time, time, "{stage:?}");
    }
    assert!(measured.allocated_bytes > 0 && measured.warm_up_frames >= 2);
    for name in ["summary.md", "cells.csv", "renders/uw-default_base.png"] {
        assert!(out.join(name).metadata().unwrap().len() > 0, "{name}");
    }

    run(&place, "").refused("--resume");
    let resumed = run(&place, "--resume").answer();
    holds(&resumed, &["0 cells measured, 0 skipped, 0 failed, 1 kept"]);
    assert_eq!(cells(out), first);

    let before = place.read("out/cells.csv");
    std::fs::remove_file(out.join("cells.csv")).unwrap();
    place.fathom("report out").ends(0);
    assert_eq!(place.read("out/cells.csv"), before);
}

#[test]
fn a_cell_beyond_the_limits_is_skipped_and_recorded() {
    let place = Place::new();
    let output = run(&place, "--set view.width=900000").ends(2);
    holds(output.error("every cell was skipped"), &["900000"]);
    let cell = cells(&place.path("out")).remove(0);
    let Outcome::Skipped { reason } = cell.outcome else { panic!("{:?}", cell.outcome) };
    holds(&reason, &["900000"]);
}

#[test]
fn a_figure_is_rendered_as_panels_and_a_page_that_shows_them() {
    let place = Place::new();
    place.fathom(format!("render --figure uw-5 {SMALL} --set shadow.size=128 -o .")).ends(0);
    let page = std::fs::read_to_string(place.path("uw-5.html")).unwrap();
    for name in ["uw-5-a.png", "uw-5-b.png"] {
        let (width, height) = picture(&place.path(name)).dimensions();
        let shown = format!("<img src=\"{name}\" width=\"{width}\" height=\"{height}\"");
        assert!(page.contains(&shown), "{page}");
    }
}

/// More samples of a pixel change edges and nothing else: the size of the picture stays as asked, and most of it is the same.
#[test]
fn samples_smooth_a_picture() {
    let place = Place::new();
    let small = "--set view.width=64 --set view.height=48 --set voxel.resolution=16";
    let rendered = |samples: u32| {
        let words =
            format!("render crates --pipeline voxelize {small} --samples {samples} -o a.png");
        place.fathom(words).ends(0);
        picture(&place.path("a.png"))
    };
    let (one, four) = (rendered(1), rendered(4));
    assert_eq!([one.dimensions(), four.dimensions()], [(64, 48); 2]);
    let pixels = one.pixels().zip(four.pixels());
    let changed = pixels.filter(|(a, b)| a.0.iter().zip(b.0).any(|(a, b)| a.abs_diff(b) > 8));
    let changed = changed.count();
    assert!((10..64 * 48 / 2).contains(&changed), "{changed} pixels changed");
}

#[test]
fn a_cell_of_volume_occlusion_has_its_error_and_pictures() {
    let place = Place::new();
    let run = "run vao-guard --no-ceilings --profile quick --budget 10m --visits 1 --out out";
    let cell = "--axis scene=corner --cell scene=corner,ao.guard=variable,ao.threshold=0.65";
    let small =
        "--set view.width=48 --set view.height=48 --set voxel.resolution=32 --set shadow.size=64";
    place.fathom(format!("{run} {cell} {small}")).ends(0);
    let cells = cells(&place.path("out"));
    assert_eq!(cells.len(), 1);
    let measured = measured(&cells[0]);
    assert_eq!(measured.notes.iter().find(|note| note.kind == NoteKind::NotComputed), None);
    let error = measured.figures()["ao_rmse"];
    assert!(error > 0.0 && error < 0.2, "{error}");
    assert!(measured.quantities.get("ao_reference_mean").is_some_and(|mean| *mean > 0.01));
    for ending in ["", "~error"] {
        let name = format!(
            "out/renders/vao-guard_scene=corner,ao.guard=variable,ao.threshold=0.65{ending}.png"
        );
        assert_eq!(picture(&place.path(name)).dimensions(), (48, 48));
    }
}
