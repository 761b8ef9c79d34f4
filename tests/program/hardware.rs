//! `fathom hardware`, killed at several points: its folder is that of one that was left alone, but for times.
#![cfg(target_os = "linux")]

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use crate::common::{Ends, Place, cells, fathom, names, own_experiment, records, wait_until};
use fathom::record::{Outcome, Record};

const LINES: [&str; 2] = ["records.jsonl", "samples.jsonl"];
/// Killed when the folder's files have so many lines more than before: at the header of a run, among samples, between cells.
const KILLED_AFTER: [usize; 4] = [1, 5, 12, 3];

fn hardware(place: &Place, out: &str) -> Command {
    let mut command = place.fathom(format!("hardware -o {out} --steps verify,run"));
    command.args(["--with", "verify voxel/clear"]);
    command.args(["--with", "run own.toml --precision 10 --no-ceilings"]);
    command
}

/// Of all files that are appended to.
fn lines(out: &Path) -> usize {
    let of = |name: &&str| std::fs::read_to_string(out.join(name)).unwrap_or_default();
    LINES.iter().map(|name| of(name).lines().count()).sum()
}

/// Kills the command when it has written so many lines, if it does, and waits for the end of what it has started.
fn killed(place: &Place, out: &Path, more: usize) {
    let before = lines(out);
    let mut command = hardware(place, "killed");
    let mut child = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let mut is_over = false;
    wait_until("another line", || {
        is_over = child.try_wait().unwrap().is_some();
        // A file of samples goes when all cells have records.
        is_over || lines(out) >= before + more
    });
    child.kill().unwrap();
    child.wait().unwrap();
    let lock = std::fs::read_to_string(out.join(".lock")).unwrap_or_default();
    let holder = lock.split(' ').nth(1).map(|id| PathBuf::from(format!("/proc/{id}")));
    wait_until("the end of what it has started", || {
        !holder.as_ref().is_some_and(|holder| holder.exists())
    });
}

/// Names of all files.
fn files(folder: &Path) -> BTreeSet<PathBuf> {
    let mut all = BTreeSet::new();
    for name in names(folder) {
        let path = folder.join(name);
        all.extend(if path.is_dir() { files(&path) } else { [path].into() });
    }
    all
}

/// Files, and cells with what became of them.
fn content(out: &Path) -> (BTreeSet<PathBuf>, BTreeSet<String>) {
    let files = files(out).iter().map(|path| path.strip_prefix(out).unwrap().to_owned()).collect();
    let cell = |cell: &fathom::record::Cell| {
        let became = match &cell.outcome {
            Outcome::Measured(measured) => format!("{} stages", measured.stages.len()),
            other => format!("{other:?}"),
        };
        format!("{} {}: {became}", cell.experiment, cell.cell)
    };
    (files, cells(out).iter().map(cell).collect())
}

#[test]
fn a_folder_that_was_killed_at_several_points_is_that_of_one_left_alone() {
    let place = Place::new();
    place.write("own.toml", own_experiment(1));
    let alone = place.path("alone");
    let told = hardware(&place, "alone").ends(0).out;
    assert!(told.ends_with("all is done: alone is complete\n"), "{told}");
    let out = place.path("killed");
    for more in KILLED_AFTER {
        killed(&place, &out, more);
    }
    hardware(&place, "killed").ends(0);
    assert_eq!(content(&out), content(&alone));
    let runs = records(&out).iter().filter(|record| matches!(record, Record::Run(_))).count();
    assert!(runs > 1, "it was never killed within the run");
    // Nothing is left: it measures nothing more.
    let before = std::fs::read(out.join("records.jsonl")).unwrap();
    hardware(&place, "killed").ends(0);
    assert!(std::fs::read(out.join("records.jsonl")).unwrap() == before);
}

#[test]
fn other_options_and_steps_that_are_not_there_are_refused() {
    let place = Place::new();
    let call = |words: &str| place.fathom(format!("hardware -o out --for 1ns {words}"));
    call("--with run").ends(3);
    call("").refused("begun with other options: run");
    fathom("hardware -o out --steps all").refused("invalid value 'all'");
    let mut command = place.fathom("hardware -o out --with");
    command.arg("walk fast").refused("there is no such step");
}
