//! Folders of measured data under two processes, kills and damage: nothing that was measured is lost or given to another run.
#![cfg(unix)]

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use crate::common::{cells, measured, refused, small, stderr};
use fathom::record::{self, Addition, Cell, FramePair, Record, SampleLine, StageTime};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use serde_json::Value;

/// How often what depends on chance is tried; more by this variable.
const REPETITIONS: &str = "FATHOM_REPETITIONS";
/// Ends a wait for what never comes, and decides nothing.
const PATIENCE: Duration = Duration::from_secs(600);

fn repetitions() -> u64 {
    let asked = std::env::var(REPETITIONS).ok();
    asked.and_then(|text| text.parse().ok()).unwrap_or(1)
}

/// A run of two small cells that never reach their precision.
fn run(out: &Path, arguments: &[&str]) -> Command {
    let mut command = crate::common::fathom();
    command
        .args(["run", "uw-waves", "--no-ceilings", "--precision", "1e-9"])
        .args(["--axis", "water=circular", "--axis", "water.amplitude_m=0.0,0.1", "--out"])
        .arg(out)
        .args(small())
        .args(arguments)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    command
}

#[track_caller]
fn wait_until(what: &str, child: &mut Child, mut holds: impl FnMut() -> bool) {
    let start = Instant::now();
    while !holds() {
        assert!(start.elapsed() < PATIENCE, "{what}");
        assert!(child.try_wait().unwrap().is_none(), "it ended before {what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

fn kept(out: &Path) -> Vec<SampleLine> {
    match record::read_lines(&out.join("samples.jsonl")) {
        Ok(read) => {
            assert_eq!(read.damaged.count(), 0, "no line is torn");
            read.records
        }
        Err(_) => Vec::new(),
    }
}

/// Exactly one of two that began at the same time measures; the other names it. The first is interrupted after that, and a third
/// run goes on with what it has measured. Gives what the first said.
#[track_caller]
fn one_of_two(out: &Path, arguments: &[&str]) -> String {
    let spawn = || run(out, &[arguments, &["--budget", "600"]].concat()).spawn().unwrap();
    let mut children = [spawn(), spawn()];
    let lock = || fs::read_to_string(out.join(".lock")).unwrap_or_default();
    let start = Instant::now();
    while !lock().starts_with(&format!("process {} ", children[0].id())) {
        assert!(start.elapsed() < PATIENCE, "nobody takes the folder: {}", lock());
        children.reverse();
        std::thread::sleep(Duration::from_millis(5));
    }
    let [first, second] = children;
    // It is not done before the second has begun.
    signal("-STOP", &first);
    let in_use = format!("is in use by process {} (`", first.id());
    let error = refused(&second.wait_with_output().unwrap(), &in_use);
    assert!(error.contains(", since 20"), "{error}");
    signal("-INT", &first);
    signal("-CONT", &first);
    let told = stderr(&first.wait_with_output().unwrap(), 130);
    stderr(&run(out, &["--resume", "--budget", "2"]).output().unwrap(), 0);
    told
}

fn signal(name: &str, child: &Child) {
    let sent = Command::new("kill").args([name, &child.id().to_string()]).status();
    assert!(sent.unwrap().success());
}

#[test]
fn of_two_runs_in_one_folder_one_measures_all_and_the_other_names_it() {
    for _ in 0..repetitions() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("out");
        one_of_two(&out, &[]);
        assert_eq!(cells(&out).len(), 2);
        assert!(!out.join(".lock").exists() && !out.join("samples.jsonl").exists());
    }
}

#[test]
fn a_kill_at_any_moment_loses_no_sample_and_one_of_two_processes_goes_on() {
    let mut random = Pcg64::seed_from_u64(repetitions());
    for _ in 0..repetitions() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path();
        let mut child = run(out, &["--budget", "600"]).spawn().unwrap();
        let lines = random.random_range(1..40);
        wait_until("there were samples", &mut child, || {
            let text = fs::read(out.join("samples.jsonl")).unwrap_or_default();
            text.iter().filter(|byte| **byte == b'\n').count() >= lines
        });
        // It measures no more.
        signal("-STOP", &child);
        let told = stderr(&run(out, &["--resume"]).output().unwrap(), 2);
        assert!(told.contains(&format!("process {} (", child.id())), "{told}");
        child.kill().unwrap();
        child.wait().unwrap();
        if !cells(out).is_empty() {
            println!("killed too late: a cell had its record");
            continue;
        }
        let before = kept(out);
        let report = fathom(&["report", out.to_str().unwrap()]);
        assert!(stderr(&report, 0).contains(" have no record yet; "));
        let told = one_of_two(out, &["--resume"]);
        assert!(told.contains("going on from "), "{told}");
        goes_on(&before, &cells(out));
        assert!(!out.join("samples.jsonl").exists());
    }
}

/// Every pair that was kept stands in its cell's record, at the beginning and in its order.
#[track_caller]
fn goes_on(before: &[SampleLine], cells: &[Cell]) {
    assert_eq!(cells.len(), 2);
    let mut additions = BTreeMap::<&str, Vec<&Addition>>::new();
    for line in before {
        additions.entry(&line.cell).or_default().push(&line.added);
    }
    for cell in cells {
        let measured = measured(cell);
        let added = additions.remove(cell.cell.as_str()).unwrap_or_default();
        let pairs: Vec<&FramePair> = added.iter().filter_map(|added| added.pair.as_ref()).collect();
        let (n, frame) = (pairs.len(), &measured.frame);
        let all = frame.untimed_samples_ns.len();
        // The pairs of the resumed run may all have been rejected.
        assert!(all >= n.max(3) && frame.untimed.n == all && frame.timing_cost.n == all);
        let of =
            |ns: fn(&FramePair) -> f64| pairs.iter().map(|pair| ns(pair)).collect::<Vec<f64>>();
        assert_eq!(frame.envelope_samples_ns[..n], of(|pair| pair.envelope_ns));
        assert_eq!(frame.gap_samples_ns[..n], of(|pair| pair.gaps_ns));
        assert_eq!(frame.untimed_samples_ns[..n], of(|pair| pair.untimed_ns));
        for (place, stage) in measured.stages.iter().enumerate() {
            assert_eq!(stage.samples_ns.len(), all);
            let known = pairs.iter().map(|pair| &pair.stages[place]);
            let read = |stage: &StageTime| stage.ns + stage.submit_cost_ns;
            let [known, as_read]: [Vec<f64>; 2] =
                [known.clone().map(|stage| stage.ns).collect(), known.map(read).collect()];
            match &stage.fenced {
                Some(fenced) => assert_eq!(fenced.wall_samples_ns[..n], as_read),
                None => assert_eq!(stage.samples_ns[..n], known),
            }
        }
        let warm_up: u32 = added.iter().map(|added| added.warm_up_frames).sum();
        assert!(measured.warm_up_frames >= warm_up + 2);
        // More than these, where a resumed run was resumed once more.
        let note = format!(" of {all} pairs of frames were measured before");
        let told = measured.notes.iter().find_map(|found| found.text.split_once(&note));
        let earlier = told.map_or(0, |(earlier, _)| earlier.parse().unwrap());
        assert!((n..=all).contains(&earlier), "{earlier} of {all}, {n} at least");
    }
    assert!(additions.is_empty(), "{:?}", additions.keys());
}

#[test]
fn records_that_vanish_in_mid_run_are_rescued_and_the_run_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let records = folder.path().join("records.jsonl");
    let mut child = run(folder.path(), &["--budget", "600"]).spawn().unwrap();
    wait_until("there were samples", &mut child, || !kept(folder.path()).is_empty());
    fs::remove_file(&records).unwrap();
    signal("-INT", &child);
    let told = stderr(&child.wait_with_output().unwrap(), 2);
    assert!(told.contains("was removed or replaced while"), "{told}");
    let rescued = folder.path().join("records.rescued-1.jsonl");
    assert!(told.contains(&rescued.display().to_string()), "{told}");
    let found = record::read(&rescued).unwrap();
    assert!(matches!(found.records[0], Record::Run(_)), "{found:?}");
    assert!(!records.exists());
}

fn fathom(arguments: &[&str]) -> Output {
    crate::common::fathom().args(arguments).output().unwrap()
}

#[test]
fn what_is_no_run_is_not_resumed_and_what_is_garbage_is_not_reported() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("typo");
    let resume = || run(&out, &["--resume"]).output().unwrap();
    assert!(stderr(&resume(), 2).contains("no run to resume in "));
    assert!(!out.exists());
    fs::create_dir(&out).unwrap();
    let (records, summary) = (out.join("records.jsonl"), out.join("summary.md"));
    fs::write(&summary, "a good summary").unwrap();
    for garbage in ["", "{\"record\":\"run\",\"sche", "one\ntwo\n", "\0\0\0\0"] {
        fs::write(&records, garbage).unwrap();
        let report = fathom(&["report", out.to_str().unwrap()]);
        assert!(stderr(&report, 2).contains("holds no sound record"), "{garbage:?}");
        if !garbage.is_empty() {
            assert!(stderr(&resume(), 2).contains("holds no sound record"), "{garbage:?}");
        }
        assert_eq!(fs::read_to_string(&records).unwrap(), garbage);
        assert_eq!(fs::read_to_string(&summary).unwrap(), "a good summary");
    }
}

/// Gives what a command says, which ends by itself. Far longer than it takes: only a hang ends otherwise.
#[track_caller]
fn ended(command: &mut Command) -> Output {
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let start = Instant::now();
    while child.try_wait().unwrap().is_none() {
        if start.elapsed() > PATIENCE {
            child.kill().unwrap();
            panic!("it hangs: {command:?}");
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    child.wait_with_output().unwrap()
}

fn pipe(path: &Path) {
    assert!(Command::new("mkfifo").arg(path).status().unwrap().success());
}

/// A folder of records of one skipped cell, as they were when records still told the host's name.
fn recorded(out: &Path) {
    let lines = [
        r#"{"record":"run","schema":3,"fathom_version":"0.1.0","started_at":"2026-01-01T00:00:00Z","profile":"quick","command":["fathom"],"adapter":{"name":"a","backend":"vulkan","device_type":"Cpu","driver":"d","driver_info":"1","vendor_id":1,"device_id":0,"software":true,"timestamp_period_ns":1.0,"host_threads":2},"shader_checks":"checked","conditions":{"cores":[0],"rasterizer_threads":null,"randomized":false,"host":"old-name"},"clocks":{},"audit":[],"submit_cost_ns":{},"notes":[]}"#,
        r#"{"record":"cell","experiment":"uw-waves","cell":"n=1","axes":{"n":1},"pipeline":"underwater","scene":"tank","stand_ins":[],"params":{},"outcome":{"status":"skipped","reason":"too large"}}"#,
    ];
    fs::create_dir_all(out).unwrap();
    fs::write(out.join("records.jsonl"), lines.join("\n") + "\n").unwrap();
}

fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap().flatten();
    let mut names: Vec<String> =
        entries.map(|entry| entry.file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn reports_are_written_through_no_link_and_no_pipe() {
    let place = tempfile::tempdir().unwrap();
    let out = place.path().join("out");
    recorded(&out);
    let report = || ended(crate::common::fathom().arg("report").arg(&out));
    stderr(&report(), 0);
    let written = names(&out);
    assert!(
        ["index.html", "summary.md", "cells.csv"].iter().all(|n| written.iter().any(|w| w == n))
    );
    let precious = place.path().join("precious");
    fs::write(&precious, "keep").unwrap();
    for name in written.iter().filter(|name| *name != "records.jsonl") {
        let path = out.join(name);
        fs::remove_file(&path).unwrap();
        std::os::unix::fs::symlink(&precious, &path).unwrap();
        refused(&report(), &format!("`{name}` is a symbolic link"));
        assert!(path.is_symlink() && fs::read_to_string(&precious).unwrap() == "keep");
        fs::remove_file(&path).unwrap();
        pipe(&path);
        refused(&report(), &format!("`{name}` is a pipe or a device"));
        fs::remove_file(&path).unwrap();
    }
    // The folder that the user names may be a link; what it holds may not.
    let link = place.path().join("link");
    std::os::unix::fs::symlink(&out, &link).unwrap();
    stderr(&fathom(&["report", link.to_str().unwrap()]), 0);
    assert_eq!(names(&out), written);
    let records = out.join("records.jsonl");
    fs::rename(&records, place.path().join("elsewhere.jsonl")).unwrap();
    std::os::unix::fs::symlink(place.path().join("elsewhere.jsonl"), &records).unwrap();
    refused(&report(), "`records.jsonl` is a symbolic link");
}

#[test]
fn files_that_a_user_names_are_replaced_only_if_they_are_regular() {
    let place = tempfile::tempdir().unwrap();
    let path = |name: &str| place.path().join(name);
    recorded(&path("out"));
    let precious = path("precious");
    fs::write(&precious, "keep").unwrap();
    std::os::unix::fs::symlink(&precious, path("link")).unwrap();
    pipe(&path("pipe"));
    fs::write(path("old.csv"), "old").unwrap();
    let export = |to: &str| {
        let mut export = crate::common::fathom();
        export.args(["export", "csv"]).arg(path("out")).arg("-o").arg(path(to));
        ended(&mut export)
    };
    refused(&export("link"), "`link` is a symbolic link");
    refused(&export("pipe"), "`pipe` is a pipe or a device");
    stderr(&export("old.csv"), 0);
    assert!(fs::read_to_string(path("old.csv")).unwrap().contains("uw-waves"));
    assert_eq!(fs::read_to_string(&precious).unwrap(), "keep");
    pipe(&path("pipe.png"));
    let mut render = crate::common::fathom();
    render.args(["render", "tank"]).args(small()).arg("-o").arg(path("pipe.png"));
    refused(&ended(&mut render), "`pipe.png` is a pipe or a device");
    let mut compare = crate::common::fathom();
    compare.arg("compare").arg("--base-bin").arg(path("pipe")).arg("--out").arg(path("compared"));
    refused(&ended(&mut compare), "it is a pipe or a device");
}

#[test]
fn a_folder_whose_name_is_no_text_can_be_used_and_locked() {
    use std::os::unix::ffi::OsStrExt;
    let place = tempfile::tempdir().unwrap();
    let out = place.path().join(std::ffi::OsStr::from_bytes(b"o\xffut"));
    let measured = run(&out, &["--budget", "2"]).output().unwrap();
    stderr(&measured, 0);
    assert_eq!(cells(&out).len(), 2);
    stderr(&crate::common::fathom().arg("report").arg(&out).output().unwrap(), 0);
}

/// Every text of a run's records by its place in them: what the machine or its user says, and what fathom says itself.
/// The text of an experiment and the values of its axes and parameters are the user's own words.
const OF_THE_MACHINE: [&str; 9] = [
    "run.command",
    "run.adapter.name",
    "run.adapter.backend",
    "run.adapter.device_type",
    "run.adapter.driver",
    "run.adapter.driver_info",
    "run.conditions.rasterizer_threads",
    "run.conditions.host",
    "run.started_at",
];
const OF_FATHOM: [&str; 17] = [
    "run.fathom_version",
    "run.profile",
    "run.shader_checks",
    "run.clocks",
    "run.audit.",
    "run.notes.",
    "run.ceilings.",
    "experiment.id",
    "experiment.toml",
    "cell.experiment",
    "cell.cell",
    "cell.axes.",
    "cell.pipeline",
    "cell.scene",
    "cell.stand_ins",
    "cell.params.",
    "cell.outcome.",
];

fn texts(place: &str, value: &Value, found: &mut Vec<(String, String)>) {
    match value {
        Value::String(text) => found.push((place.to_owned(), text.clone())),
        Value::Array(values) => values.iter().for_each(|value| texts(place, value, found)),
        Value::Object(map) => {
            for (name, value) in map.iter().filter(|(name, _)| *name != "record") {
                texts(&format!("{place}.{name}"), value, found);
            }
        }
        _ => {}
    }
}

#[test]
fn records_tell_neither_the_host_nor_where_the_user_keeps_files() {
    let place = tempfile::tempdir().unwrap();
    let home = place.path().join("home of jo");
    let (work, out) = (home.join("work"), home.join("runs/first"));
    fs::create_dir_all(&work).unwrap();
    let experiments = crate::common::experiment_files(&home, 1);
    let mut command = crate::common::fathom();
    command.current_dir(&work).env("HOME", &home);
    command.arg("run").args(&experiments).args(["--no-ceilings", "--budget", "2"]);
    command.arg("--out").arg(&out);
    stderr(&ended(&mut command), 0);
    let mut found = Vec::new();
    for line in fs::read_to_string(out.join("records.jsonl")).unwrap().lines() {
        let line: Value = serde_json::from_str(line).unwrap();
        texts(line["record"].as_str().unwrap(), &line, &mut found);
    }
    let known = |place: &str| {
        OF_THE_MACHINE.contains(&place) || OF_FATHOM.iter().any(|known| place.starts_with(known))
    };
    let unknown: Vec<_> = found.iter().filter(|(place, _)| !known(place)).collect();
    assert!(unknown.is_empty(), "does the machine say these? {unknown:?}");
    let host = fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    let temporary = place.path().file_name().unwrap().to_str().unwrap();
    for (place, text) in &found {
        for private in ["home of jo", temporary] {
            assert!(!text.contains(private), "{place}: {text}");
        }
        let mut words = text.split(|c: char| !c.is_alphanumeric() && c != '-' && c != '.');
        assert!(host.trim().is_empty() || words.all(|word| word != host.trim()), "{place}: {text}");
    }
    let of = |place: &str| -> Vec<&str> {
        found.iter().filter(|(found, _)| found == place).map(|(_, text)| text.as_str()).collect()
    };
    assert_eq!(of("run.conditions.host"), [fathom::private::machine().unwrap()]);
    let command = of("run.command");
    assert!(command.contains(&"own-1.toml") && command.contains(&"first"), "{command:?}");
}
