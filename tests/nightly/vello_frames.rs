//! `examples/vello_frames`: a program whose library submits by itself.

use std::path::{Path, PathBuf};
use std::process::Command;

use fathom::compare::store::Comparison;
use fathom::record::output::RECORDS;
use fathom::record::{Record, read};

use super::common::{Ends, Place, holds};

const CELLS: [&str; 4] = ["scene=icon", "scene=chart", "scene=map", "scene=forest"];

/// Built by cargo, outside fathom's workspace.
fn vello_frames() -> PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let target = root.join("target/vello_frames");
    let mut cargo = Command::new(env!("CARGO"));
    cargo.args(["build", "--quiet", "--release", "--locked", "--manifest-path"]);
    cargo.arg(root.join("examples/vello_frames/Cargo.toml")).arg("--target-dir").arg(&target);
    cargo.env_remove("CARGO_BUILD_TARGET").ends(0);
    target.join("release/vello_frames")
}

/// Times are asked for no more than that they are there. The paths, counted, have one verdict on a machine of any load.
#[test]
fn frames_of_vello_have_records_and_a_scene_with_more_paths_is_named() {
    let (place, program) = (Place::new(), vello_frames());
    let printed = Command::new(&program).arg(place.path("frames")).answer();
    let records = read(&place.path("frames").join(RECORDS)).expect("they are sound").records;
    let cells = records.iter().filter_map(Record::try_as_cell_ref);
    for (cell, name) in cells.zip(CELLS) {
        let [vello] = &cell.measured().expect("it was sampled").stages[..] else { panic!() };
        assert_eq!(cell.cell, name);
        assert!(vello.stage == "vello" && vello.fenced.is_some(), "{vello:?}");
        holds(&printed, &[&format!("\nvello-frames {name}\n  vello  ")]);
    }
    place.fathom("report frames").ends(0);
    holds(&place.read("frames/cells.csv"), &CELLS);

    let cells = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/vello_frames/cells.toml");
    let compared = |options: &str, [base, head]: [&str; 2]| {
        let mut compare = place.fathom(format!("compare --pairs 2 {options} --cells-file"));
        let worker = format!("'{}' --worker", program.display());
        compare.arg(&cells).args(["--base-cmd", &format!("{worker} {base}")]);
        compare.args(["--head-cmd", &format!("{worker} {head}")]);
        compare
    };
    let more = ["--counted", "--counted --work 1.05"];
    let slower = compared("--launches 10 --out slower", more).ends(1);
    holds(&slower.out, &["scene=forest vello: slower: time +5.0 %", "1 slower, 3 same"]);
    // Two launches are too few for a verdict.
    compared("--launches 2 --out times", ["", "--work 1.05"]).ends(3);
    let stored = Comparison::read(&place.path("times")).unwrap();
    assert!(stored.faults.is_empty() && stored.launches.len() == 2, "{:?}", stored.faults);
}
