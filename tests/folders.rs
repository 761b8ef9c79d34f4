//! Folders of measured data under two processes, kills and damage: nothing that was measured is lost or given to another run.
#![cfg(unix)]

mod common;

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use common::{cells, measured, refused, small, stderr};
use fathom::record::{self, Addition, Cell, FramePair, Record, SampleLine, StageTime};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// How often what depends on chance is tried; more by this variable.
const REPETITIONS: &str = "FATHOM_REPETITIONS";
/// Far more than any wait here takes on a loaded machine.
const PATIENCE: Duration = Duration::from_secs(300);

fn repetitions() -> u64 {
    let asked = std::env::var(REPETITIONS).ok();
    asked.and_then(|text| text.parse().ok()).unwrap_or(1)
}

/// A run of two small cells that never reach their precision.
fn run(out: &Path, arguments: &[&str]) -> Command {
    let mut command = common::fathom();
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

/// Exactly one of two that began at the same time measures; the other names it. Gives what the first said.
#[track_caller]
fn one_of_two(mut commands: [Command; 2]) -> Output {
    let children = [commands[0].spawn().unwrap(), commands[1].spawn().unwrap()];
    let ids = children.each_ref().map(Child::id);
    let [a, b] = children.map(|child| child.wait_with_output().unwrap());
    let (measured, other, id) = if a.status.success() { (a, b, ids[0]) } else { (b, a, ids[1]) };
    stderr(&measured, 0);
    let error = refused(&other, &format!("is in use by process {id} (`"));
    assert!(error.contains(", since 20"), "{error}");
    measured
}

#[test]
fn of_two_runs_in_one_folder_one_measures_all_and_the_other_names_it() {
    for _ in 0..repetitions() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("out");
        // The first must not be done before the second begins.
        let measure = || run(&out, &["--budget", "2"]);
        one_of_two([measure(), measure()]);
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
        std::thread::sleep(Duration::from_millis(random.random_range(0..100)));
        let told = stderr(&run(out, &["--resume"]).output().unwrap(), 2);
        assert!(told.contains(&format!("process {} (", child.id())), "{told}");
        child.kill().unwrap();
        child.wait().unwrap();
        assert_eq!(cells(out), [], "no cell had its record");
        let before = kept(out);
        let report = fathom(&["report", out.to_str().unwrap()]);
        assert!(stderr(&report, 0).contains(" have no record yet; "));
        let resume = || run(out, &["--resume", "--budget", "2"]);
        let resumed = one_of_two([resume(), resume()]);
        let told = String::from_utf8(resumed.stderr).unwrap();
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
        let note = format!("{n} of {all} pairs of frames were measured before");
        assert!(n == 0 || measured.notes.iter().any(|found| found.text.starts_with(&note)));
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
    let interrupt = Command::new("kill").args(["-INT", &child.id().to_string()]).status();
    assert!(interrupt.unwrap().success());
    let told = stderr(&child.wait_with_output().unwrap(), 2);
    assert!(told.contains("was removed or replaced while"), "{told}");
    let rescued = folder.path().join("records.rescued-1.jsonl");
    assert!(told.contains(&rescued.display().to_string()), "{told}");
    let found = record::read(&rescued).unwrap();
    assert!(matches!(found.records[0], Record::Run(_)), "{found:?}");
    assert!(!records.exists());
}

fn fathom(arguments: &[&str]) -> Output {
    common::fathom().args(arguments).output().unwrap()
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
