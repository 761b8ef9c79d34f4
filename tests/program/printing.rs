//! Standard streams that cannot be written to: nothing is lost but what was printed, and nothing panics.
#![cfg(unix)]

use std::fs::OpenOptions;
use std::io::Read;
use std::process::{Command, Output, Stdio};

use crate::common::{cells, refused, small};

fn fathom(arguments: &[&str]) -> Command {
    let mut command = crate::common::fathom();
    command.args(arguments);
    command
}

type Stream = fn() -> Stdio;

/// A stream on a device that is always full.
fn full() -> Stdio {
    let device = OpenOptions::new().write(true).open("/dev/full");
    Stdio::from(device.expect("Linux and the BSDs have /dev/full"))
}

/// A stream into a pipe that nobody reads.
fn unread() -> Stdio {
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    Stdio::from(writer)
}

/// Ended by itself, and not by a panic (101) or a signal.
#[track_caller]
fn ended(output: &Output, status: i32) {
    let told = String::from_utf8_lossy(&output.stderr);
    assert!(!told.contains("panicked"), "{told}");
    assert_eq!(output.status.code(), Some(status), "{told}");
}

/// A folder with the records of two cells that were skipped, so that no adapter is needed.
fn recorded() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let cell = |name: &str| {
        serde_json::json!({
            "record": "cell", "experiment": "own", "cell": name, "axes": {}, "pipeline": "underwater", "scene": "tank",
            "stand_ins": [], "params": {}, "outcome": { "status": "skipped", "reason": "too large" },
        })
    };
    let lines = format!("{}\n{}\n", cell("n=1"), cell("n=2"));
    std::fs::write(folder.path().join("records.jsonl"), lines).unwrap();
    folder
}

#[test]
fn an_answer_on_a_full_disk_is_an_error() {
    for arguments in [&["list", "stages"][..], &["list"], &["--help"], &["list", "--help"]] {
        let output = fathom(arguments).stdout(full()).output().unwrap();
        ended(&output, 2);
        let told = refused(&output, "cannot write to standard output: ");
        assert!(told.starts_with("error: cannot write to standard output: "), "{told}");
        // And where that cannot be told either.
        let output = fathom(arguments).stdout(full()).stderr(full()).output();
        ended(&output.unwrap(), 2);
    }
}

#[test]
fn a_reader_that_has_had_enough_is_no_error() {
    for arguments in [&["list", "stages"][..], &["list", "experiments"], &["--help"]] {
        let output = fathom(arguments).stdout(unread()).output().unwrap();
        ended(&output, 0);
        assert!(output.stderr.is_empty());
    }
    let mut child = fathom(&["list", "scenes"]).stdout(Stdio::piped()).spawn().unwrap();
    let mut start = [0; 8];
    let mut stream = child.stdout.take().unwrap();
    stream.read_exact(&mut start).unwrap();
    drop(stream);
    assert_eq!(child.wait().unwrap().code(), Some(0));
}

#[test]
fn reports_are_written_whatever_can_be_printed() {
    let streams: [(&str, Stream); 2] = [("full", full), ("unread", unread)];
    for (name, stream) in streams {
        let folder = recorded();
        let path = folder.path().to_str().unwrap();
        let mut report = fathom(&["report", path]);
        let output = report.stdout(stream()).stderr(stream()).output();
        ended(&output.unwrap(), 0);
        for file in ["summary.md", "cells.csv"] {
            assert!(folder.path().join(file).exists(), "{name}: {file}");
        }
    }
    // An error keeps its status where it cannot be told.
    let missing = fathom(&["report", "no/such/folder"]).stderr(full()).output();
    ended(&missing.unwrap(), 2);
    let unknown = fathom(&["fetch", "no-such-asset"]).stdout(full()).stderr(full()).output();
    ended(&unknown.unwrap(), 2);
}

/// Runs with both standard streams closed from the start.
fn closed(arguments: &[&str]) -> Output {
    let mut shell = Command::new("sh");
    shell.args(["-c", "\"$0\" \"$@\" >&- 2>&-"]);
    shell.arg(env!("CARGO_BIN_EXE_fathom")).args(arguments);
    shell.output().unwrap()
}

/// A file that gets the number of a closed stream would be written into by whatever prints.
#[test]
fn closed_streams_write_into_no_file() {
    let folder = recorded();
    let records = folder.path().join("records.jsonl");
    let before = std::fs::read(&records).unwrap();
    ended(&closed(&["report", folder.path().to_str().unwrap()]), 0);
    assert_eq!(std::fs::read(&records).unwrap(), before);
    let open = tempfile::tempdir().unwrap();
    let copy = open.path().join("records.jsonl");
    std::fs::write(&copy, before).unwrap();
    ended(&fathom(&["report", open.path().to_str().unwrap()]).output().unwrap(), 0);
    for file in ["summary.md", "cells.csv"] {
        let [closed, open] =
            [&folder, &open].map(|folder| std::fs::read(folder.path().join(file)).unwrap());
        assert_eq!(closed, open, "{file}");
    }
    ended(&closed(&["list"]), 0);
}

#[test]
fn pictures_and_dumps_are_written_whatever_can_be_printed() {
    let folder = tempfile::tempdir().unwrap();
    let picture = folder.path().join("plane.png");
    let mut command = fathom(&["render", "plane", "-o"]);
    command.arg(&picture).args(small());
    ended(&command.stdout(full()).stderr(full()).output().unwrap(), 0);
    assert!(picture.exists());
    let mut command = fathom(&["dump", "caustics/trace", "--scene", "plane", "-o"]);
    command.arg(folder.path()).args(small());
    ended(&command.stdout(full()).stderr(full()).output().unwrap(), 0);
    assert!(folder.path().join("caustics-trace-photons.npy").exists());
}

#[test]
fn answers_that_need_an_adapter_are_errors_on_a_full_disk_too() {
    let folder = tempfile::tempdir().unwrap();
    let points = folder.path().join("points.csv");
    std::fs::write(&points, "x,y,z,nx,ny,nz\n0,-2.4,0,0,1,0\n").unwrap();
    let query = || {
        let mut command = fathom(&["query", "ao", "--scene", "ball", "--points"]);
        command.arg(&points);
        command.args(["--set", "voxel.resolution=16", "--set", "ao.rays=4"]);
        command
    };
    ended(&query().stdout(full()).output().unwrap(), 2);
    ended(&query().stdout(unread()).output().unwrap(), 0);
    let verify = fathom(&["verify", "water/reflection"]).stdout(full()).output();
    ended(&verify.unwrap(), 2);
}

/// Records before progress, tables before the one that is printed.
#[test]
fn runs_and_comparisons_keep_everything_whatever_can_be_printed() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("run");
    let mut command =
        fathom(&["run", "uw-waves", "--profile", "quick", "--budget", "0.2", "--no-ceilings"]);
    command.args(["--axis", "water=circular", "--axis"]);
    command.args(["water.amplitude_m=0.0,0.1", "--out"]);
    command.arg(&out).args(small());
    let output = command.stdout(full()).stderr(unread()).output().unwrap();
    ended(&output, 0);
    assert_eq!(cells(&out).len(), 2);
    assert!(out.join("summary.md").exists());

    let records = out.join("records.jsonl");
    let compare = |stream: Stream, name: &str| {
        let tables = folder.path().join(name);
        let mut command = fathom(&["compare"]);
        command.args([&records, &records]).arg("--out").arg(&tables);
        let output = command.stdout(stream()).stderr(stream()).output().unwrap();
        assert!(tables.join("summary.md").exists() && tables.join("junit.xml").exists());
        output
    };
    ended(&compare(full, "full"), 2);
    ended(&compare(unread, "unread"), 0);
}
