//! Folders of measured data under two processes, kills and damage: nothing that was measured is lost or given to another run.
#![cfg(unix)]

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::{Child, Command, Stdio};

use crate::common::{
    Ends, Place, SMALL, Told, cells, ended, holds, measured, names, own_experiment, records,
    repetitions, signal, skipped_cell, wait_until, write_records,
};
use fathom::record::{self, Addition, Cell, FramePair, Record, Run, SCHEMA, SampleLine};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// A run of two small cells that never reach their precision.
const RUN: &str = "run uw-waves --no-ceilings --precision 1e-9 --axis water=circular --axis water.amplitude_m=0.0,0.1";

/// The same into the folder `out`.
fn run(place: &Place, options: &str) -> Command {
    let mut command = place.fathom(format!("{RUN} {SMALL} --out out {options}"));
    command.stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

/// Waits for samples of a run that goes on.
#[track_caller]
fn wait_for_lines(place: &Place, child: &mut Child, lines: usize) {
    wait_until("a sample", || {
        assert_eq!(child.try_wait().unwrap(), None, "it ended before there were samples");
        let text = fs::read(place.path("out/samples.jsonl")).unwrap_or_default();
        text.iter().filter(|byte| **byte == b'\n').count() >= lines
    });
}

fn kept(place: &Place) -> Vec<SampleLine> {
    let read = record::read_lines(&place.path("out/samples.jsonl")).unwrap();
    assert_eq!(read.damaged.count(), 0, "no line is torn");
    read.records
}

/// Exactly one of two that began at the same time measures; the other names it. The first is interrupted after that, and a third
/// run goes on with what it has measured. Gives what the first said.
#[track_caller]
fn one_of_two(place: &Place, options: &str) -> String {
    let spawn = || run(place, &format!("--budget 600 {options}")).spawn().unwrap();
    let mut children = [spawn(), spawn()];
    wait_until("a holder of the folder", || {
        children.reverse();
        let lock = fs::read_to_string(place.path("out/.lock")).unwrap_or_default();
        lock.starts_with(&format!("process {} ", children[0].id()))
    });
    let [first, second] = children;
    // It is not done before the second has begun.
    signal("-STOP", first.id());
    let in_use = format!("is in use by process {} (`", first.id());
    let second = Told::of(second.wait_with_output().unwrap(), 2);
    holds(second.error(&in_use), &[", since 20"]);
    signal("-INT", first.id());
    signal("-CONT", first.id());
    let told = Told::of(first.wait_with_output().unwrap(), 130);
    assert!(
        matches!(records(&place.path("out")).last(), Some(Record::End(end)) if end.interrupted)
    );
    run(place, "--resume --budget 10m").ends(0);
    told.err
}

#[test]
fn a_kill_at_any_moment_loses_no_sample_and_one_of_two_processes_goes_on() {
    let mut random = Pcg64::seed_from_u64(repetitions());
    for _ in 0..repetitions() {
        let place = Place::new();
        let out = &place.path("out");
        let mut child = run(&place, "--budget 600").spawn().unwrap();
        wait_for_lines(&place, &mut child, random.random_range(1..40));
        // It measures no more.
        signal("-STOP", child.id());
        run(&place, "--resume").refused(&format!("process {} (", child.id()));
        child.kill().unwrap();
        child.wait().unwrap();
        if !cells(out).is_empty() {
            println!("killed too late: a cell had its record");
            continue;
        }
        let before = kept(&place);
        holds(&place.fathom("report out").ends(0).err, &[" have no record yet; "]);
        holds(&one_of_two(&place, "--resume"), &["continuing from "]);
        goes_on(&before, &cells(out));
        assert!(!out.join("samples.jsonl").exists());
    }
}

/// Every pair that was kept stands in its cell's record, at the beginning and in its order. `harness::sample` has the rest of the law.
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
            |ns: fn(&FramePair) -> f64| -> Vec<f64> { pairs.iter().map(|pair| ns(pair)).collect() };
        assert_eq!(frame.envelope_samples_ns[..n], of(|pair| pair.envelope_ns));
        assert_eq!(frame.untimed_samples_ns[..n], of(|pair| pair.untimed_ns));
        let warm_up: u32 = added.iter().map(|added| added.warm_up_frames).sum();
        assert!(measured.warm_up_frames >= warm_up + 2);
    }
    assert!(additions.is_empty(), "{:?}", additions.keys());
}

#[test]
fn records_that_vanish_in_mid_run_are_rescued_and_the_run_says_so() {
    let place = Place::new();
    let mut child = run(&place, "--budget 600").spawn().unwrap();
    wait_for_lines(&place, &mut child, 1);
    let records = place.path("out/records.jsonl");
    fs::remove_file(&records).unwrap();
    signal("-INT", child.id());
    let told = Told::of(child.wait_with_output().unwrap(), 2);
    holds(&told.err, &["was removed or replaced while", "out/records.rescued-1.jsonl"]);
    let found = record::read(&place.path("out/records.rescued-1.jsonl")).unwrap();
    assert!(matches!(found.records[0], Record::Run(_)), "{found:?}");
    assert!(!records.exists());
}

#[test]
fn what_is_no_run_is_not_resumed_and_what_is_garbage_is_not_reported() {
    let place = Place::new();
    run(&place, "--resume").refused("no run to resume in ");
    assert!(!place.path("out").exists());
    place.write("out/summary.md", "a good summary");
    for garbage in ["", "{\"record\":\"run\",\"sche", "one\ntwo\n", "\0\0\0\0"] {
        place.write("out/records.jsonl", garbage);
        place.fathom("report out").refused("holds no sound record");
        if !garbage.is_empty() {
            run(&place, "--resume").refused("holds no sound record");
        }
        assert_eq!(place.read("out/records.jsonl"), garbage);
        assert_eq!(place.read("out/summary.md"), "a good summary");
    }
}

fn pipe(path: &Path) {
    assert!(Command::new("mkfifo").arg(path).status().unwrap().success());
}

/// A folder `out` with records of one cell.
fn recorded(place: &Place) {
    let run = Run { schema: SCHEMA, ..Run::default() };
    write_records(&place.path("out"), &[Record::Run(Box::new(run)), skipped_cell("n=1")]);
}

/// What a link, a pipe or a folder in the way comes to is tested in `base::folder`.
#[test]
fn reports_and_what_a_user_names_are_written_through_no_link_and_no_pipe() {
    let place = Place::new();
    recorded(&place);
    let precious = place.write("precious", "keep");
    for name in ["out/index.html", "link"] {
        std::os::unix::fs::symlink(&precious, place.path(name)).unwrap();
    }
    pipe(&place.path("pipe.png"));
    for (words, reason) in [
        ("report out", "`index.html` is a symbolic link"),
        ("export csv out -o link", "`link` is a symbolic link"),
        (&format!("render tank -o pipe.png {SMALL}"), "`pipe.png` is a pipe or a device"),
        ("compare --base-bin pipe.png --out compared", "it is a pipe or a device"),
    ] {
        ended(place.fathom(words), 2).error(reason);
    }
    assert_eq!(place.read("precious"), "keep");
    place.write("old.csv", "old");
    ended(place.fathom("export csv out -o old.csv"), 0);
    holds(&place.read("old.csv"), &["own"]);
}

#[test]
fn a_folder_whose_name_is_no_text_can_be_used_and_locked() {
    use std::os::unix::ffi::OsStrExt;
    let place = Place::new();
    let out = place.path(std::ffi::OsStr::from_bytes(b"o\xffut"));
    let run = RUN.replace("1e-9", "1");
    place.fathom(format!("{run} {SMALL} --budget 10m --out")).arg(&out).ends(0);
    assert_eq!(cells(&out).len(), 2);
    place.fathom("report").arg(&out).ends(0);
}

/// The folders, the user and the host bear marks: none of them stands in what is written, but for the name of the file and of the folder
/// that the command line names last.
#[test]
fn nothing_that_is_written_tells_the_host_the_user_or_where_files_are_kept() {
    let place = Place::new();
    let home = place.path("home of jo");
    fs::create_dir_all(home.join("work")).unwrap();
    let experiment = place.write("home of jo/own-1.toml", own_experiment(1));
    let out = home.join("runs/first");
    let mut command = place.fathom("run --no-ceilings --budget 10m --precision 1");
    command.arg(experiment).arg("--out").arg(&out).env("HOME", &home).env("USER", "jo-the-user");
    command.env("MARK", "value-of-mark").current_dir(home.join("work")).ends(0);
    let host = fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    let folder = place.path("");
    let folder = folder.file_name().unwrap().to_str().unwrap();
    for name in names(&out).into_iter().filter(|name| out.join(name).is_file()) {
        let text = String::from_utf8_lossy(&fs::read(out.join(&name)).unwrap()).into_owned();
        for private in ["home of jo", "jo-the-user", "value-of-mark", folder] {
            assert!(!text.contains(private), "{name}: {private}");
        }
        let mut words = text.split(|c: char| !c.is_alphanumeric() && c != '-' && c != '.');
        assert!(host.trim().is_empty() || words.all(|word| word != host.trim()), "{name}");
    }
    let all = records(&out);
    let run = all[0].try_as_run_ref().unwrap();
    assert_eq!(run.conditions.host, Some(fathom::private::machine().unwrap()));
    assert!(["own-1.toml", "first"].iter().all(|part| run.command.iter().any(|word| word == part)));
}
