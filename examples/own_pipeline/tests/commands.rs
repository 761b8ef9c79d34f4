//! Every command over the crate's own pipeline, on the adapter at hand.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use fathom::compare::store::StoredComparison;
use fathom::compare::verdict::{CellVerdict, Verdicts};
use serde_json::Value;
use tempfile::TempDir;

const PROGRAM: &str = env!("CARGO_BIN_EXE_own_pipeline");

/// Runs the program in a folder, with these words as arguments.
fn run(folder: &Path, words: &str) -> Output {
    let mut program = Command::new(PROGRAM);
    program.current_dir(folder).args(words.split_whitespace()).output().expect("it starts")
}

/// Standard output of a command that does well.
fn told(folder: &Path, words: &str) -> String {
    let out = run(folder, words);
    assert!(out.status.success(), "{words}: {}", String::from_utf8_lossy(&out.stderr));
    String::from_utf8(out.stdout).unwrap()
}

#[test]
fn listings_hold_what_the_crate_brings_beside_what_fathom_brings() {
    let told = |words| told(Path::new("."), words);
    let pipelines = told("list pipelines");
    assert!(pipelines.contains("ripples") && pipelines.contains("underwater"), "{pipelines}");
    let stages = told("list stages --pipeline ripples");
    let names: Vec<&str> =
        stages.lines().filter_map(|line| line.split_whitespace().next()).collect();
    assert_eq!(names, ["ripple/draw", "ripple/blur"]);
    let parameters = told("list parameters --pipeline ripples --scene puddle");
    let rings = parameters.lines().find(|line| line.contains("ripples.rings")).unwrap();
    for part in ["8", "1 … 4096", "Rings that are added up"] {
        assert!(rings.contains(part), "{rings}");
    }
    assert_eq!(told("list experiments").lines().count(), 1);
    let none = "render puddle --pipeline ripples --set ripples.rings=0";
    let message = String::from_utf8(run(Path::new("."), none).stderr).unwrap();
    assert!(message.contains("ripples.rings is 0: it must lie within 1 … 4096"), "{message}");
}

#[test]
fn pictures_and_outputs_are_written() {
    let folder = TempDir::new().unwrap();
    let puddle = "puddle --pipeline ripples --set view.width=40 --set view.height=30";
    told(folder.path(), &format!("render {puddle} -o puddle.png"));
    assert!(fs::metadata(folder.path().join("puddle.png")).unwrap().len() > 200);
    told(folder.path(), &format!("dump ripple/draw --scene {puddle} -o ."));
    assert!(folder.path().join("ripple-draw-image.npy").exists());
}

#[test]
fn checks_are_sound_and_their_controls_fail() {
    let checks = told(Path::new("."), "verify ripple");
    for stage in ["ripple/draw", "ripple/blur"] {
        assert!(checks.contains(stage), "{checks}");
    }
}

#[test]
fn the_experiment_runs_and_is_told_again_from_its_records() {
    let folder = TempDir::new().unwrap();
    told(folder.path(), "run --no-ceilings --budget 6 --out run");
    let path = folder.path().join("run/summary.md");
    let summary = fs::read_to_string(&path).unwrap();
    assert!(summary.contains("More rings take longer to draw"), "{summary}");
    fs::remove_file(&path).unwrap();
    told(folder.path(), "report run");
    assert_eq!(fs::read_to_string(&path).unwrap(), summary);
}

/// The crate's shaders, with each pass over the rings made twice.
fn slowed_shaders(folder: &Path) -> PathBuf {
    let own = Path::new(env!("CARGO_MANIFEST_DIR")).join("shaders/ripple");
    let slowed = folder.join("shaders");
    fs::create_dir_all(slowed.join("ripple")).unwrap();
    for file in ["draw.wgsl", "blur.wgsl"] {
        let source = fs::read_to_string(own.join(file)).unwrap();
        let twice = source.replace("ring <= settings.rings", "ring <= settings.rings * 2u");
        assert_eq!(twice != source, file == "draw.wgsl");
        fs::write(slowed.join("ripple").join(file), twice).unwrap();
    }
    slowed
}

/// The same comparison, whose draws took so many times as long with the head, and all else as long: 1 ms, but for 0.4 %.
fn with_times(from: &Path, to: &Path, draw: f64) {
    let text = fs::read_to_string(from.join("records.jsonl")).unwrap();
    let lines = text.lines().enumerate().map(|(number, line)| {
        let mut line: Value = serde_json::from_str(line).unwrap();
        if line["kind"] == "pair" {
            let slower = line["cell"] == "puddle ripple/draw" && line["control"] != true;
            let noise = 1.0 + 1e-3 * (number * 7919 % 5) as f64;
            line["base_ns"] = 1e6.into();
            line["head_ns"] = (1e6 * noise * if slower { draw } else { 1.0 }).into();
        }
        format!("{line}\n")
    });
    fs::create_dir(to).unwrap();
    fs::write(to.join("records.jsonl"), lines.collect::<String>()).unwrap();
}

/// Both sides are measured. What is made of it is tested on times of a modelled clock: those of this machine depend on its load.
#[test]
fn its_own_compare_catches_a_slowdown_of_its_shader_and_nothing_else() {
    let place = TempDir::new().unwrap();
    let folder = place.path();
    let shaders = format!("OWN_PIPELINE_SHADERS={}", slowed_shaders(folder).display());
    let programs = format!("--base-bin {PROGRAM} --head-bin {PROGRAM} --out compared");
    let sides = format!("{programs} --head-env {shaders}");
    let gates = "--gates exact,time --launches 10 --pairs 2";
    let measured = run(folder, &format!("compare {gates} {sides}"));
    let judged = |name: &str| {
        let told = run(folder, &format!("compare --replay {name}"));
        let comparison = StoredComparison::read(&folder.join(name)).unwrap();
        let verdicts = Verdicts::of(&comparison);
        let of = |name: &str| {
            let cell = verdicts.cells.iter().find(|judged| judged.cell.as_str() == name);
            cell.unwrap_or_else(|| panic!("no cell `{name}`: {told:?}")).verdict
        };
        (told.status.code(), of("puddle ripple/draw"), of("puddle ripple/blur"))
    };
    let (status, ..) = judged("compared");
    assert!(matches!(status, Some(0 | 1 | 3)), "{measured:?}");
    assert_eq!(measured.status.code(), status, "{measured:?}");
    for (name, draw, expected) in [
        ("slower", 2.0, (Some(1), CellVerdict::Slower, CellVerdict::Same)),
        // More rings draw another picture, whatever its time: the changed shader did run.
        ("equal", 1.0, (Some(1), CellVerdict::LessAccurate, CellVerdict::Same)),
    ] {
        with_times(&folder.join("compared"), &folder.join(name), draw);
        assert_eq!(judged(name), expected, "{name}");
    }
}
