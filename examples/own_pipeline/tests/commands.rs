//! Every command over the crate's own pipeline, on the adapter at hand.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use fathom::compare::store::Comparison;
use fathom::compare::verdict::{CellVerdict, Verdicts};
use tempfile::TempDir;

const PROGRAM: &str = env!("CARGO_BIN_EXE_own_pipeline");

/// Runs the program in a folder, with these words as arguments.
fn run(folder: &Path, words: &str) -> Output {
    let mut program = Command::new(PROGRAM);
    program.current_dir(folder).args(words.split_whitespace()).output().expect("it starts")
}

/// Standard output of a command that does well.
fn stdout(folder: &Path, words: &str) -> String {
    let out = run(folder, words);
    assert!(out.status.success(), "{words}: {}", String::from_utf8_lossy(&out.stderr));
    String::from_utf8(out.stdout).unwrap()
}

#[test]
fn listings_hold_what_the_crate_brings_beside_what_fathom_brings() {
    let told = |words| stdout(Path::new("."), words);
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
    stdout(folder.path(), &format!("render {puddle} -o puddle.png"));
    assert!(fs::metadata(folder.path().join("puddle.png")).unwrap().len() > 200);
    stdout(folder.path(), &format!("dump ripple/draw --scene {puddle} -o ."));
    assert!(folder.path().join("ripple-draw-image.npy").exists());
}

#[test]
fn checks_are_sound_and_their_controls_fail() {
    let checks = stdout(Path::new("."), "verify ripple");
    for stage in ["ripple/draw", "ripple/blur"] {
        assert!(checks.contains(stage), "{checks}");
    }
}

#[test]
fn the_experiment_runs_and_is_told_again_from_its_records() {
    let folder = TempDir::new().unwrap();
    stdout(folder.path(), "run --no-ceilings --budget 10m --visits 1 --out run");
    let path = folder.path().join("run/summary.md");
    let summary = fs::read_to_string(&path).unwrap();
    assert!(summary.contains("More rings take longer to draw"), "{summary}");
    fs::remove_file(&path).unwrap();
    stdout(folder.path(), "report run");
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

/// The picture is another with more rings: the changed shader did run. Which times count as slower is tested on modelled clocks.
#[test]
fn its_own_compare_catches_a_change_of_its_shader_and_nothing_else() {
    let place = TempDir::new().unwrap();
    let folder = place.path();
    let shaders = format!("OWN_PIPELINE_SHADERS={}", slowed_shaders(folder).display());
    let sides = format!("--base-bin {PROGRAM} --head-bin {PROGRAM} --head-env {shaders}");
    let compare = format!("compare --gates exact,time --launches 2 --pairs 2 {sides} --out out");
    let measured = run(folder, &compare);
    assert_eq!(measured.status.code(), Some(1), "{measured:?}");
    let comparison = Comparison::read(&folder.join("out")).unwrap();
    assert!(comparison.faults.is_empty() && comparison.launches.len() >= 2);
    let verdicts = Verdicts::judge(&comparison);
    let of = |name: &str| verdicts.cells.iter().find(|cell| cell.cell.as_str() == name).unwrap();
    assert_eq!(of("puddle ripple/draw").verdict, CellVerdict::LessAccurate);
    assert_ne!(of("puddle ripple/blur").verdict, CellVerdict::LessAccurate);
}
