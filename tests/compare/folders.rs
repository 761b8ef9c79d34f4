//! Folders of comparisons under two processes and damage, and what an interrupt ends at once.

use std::fs;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

use fathom::compare::store::StoredComparison;

use super::builds::Builds;
use super::common::{fathom, refused, stderr};
use super::script::Script;

/// A head that prepares nothing before it may, so that two processes are sure to meet.
fn held(builds: &Builds) -> [PathBuf; 2] {
    let waits = Script { first: builds.waits(), ..Script::default() };
    [builds.build("base", &Script::default()), builds.build("head", &waits)]
}

fn signal(name: &str, process: u32) {
    let sent = Command::new("kill").args([name, &process.to_string()]).status();
    assert!(sent.unwrap().success());
}

/// Exactly one of two that began at the same time measures; the other names it, and ends before the first may go on.
#[track_caller]
fn one_of_two(builds: &Builds, mut command: impl FnMut() -> Command) {
    builds.hold();
    let mut spawn = || {
        let mut command = command();
        command.stdout(Stdio::piped()).stderr(Stdio::piped());
        command.spawn().unwrap()
    };
    let mut children = [spawn(), spawn()];
    let ids = children.each_ref().map(std::process::Child::id);
    while children.iter_mut().all(|child| child.try_wait().unwrap().is_none()) {
        std::thread::sleep(Duration::from_millis(10));
    }
    builds.release();
    let outputs = children.map(|child| child.wait_with_output().unwrap());
    let measured = outputs.iter().position(|output| output.status.success());
    let measured = measured.unwrap_or_else(|| panic!("{outputs:?}"));
    refused(&outputs[1 - measured], &format!("is in use by process {} (`", ids[measured]));
}

#[track_caller]
fn is_whole(builds: &Builds) {
    let stored = StoredComparison::read(&builds.path("out")).unwrap();
    assert_eq!((stored.launches.len(), stored.exact.len()), (10, 8));
    // Four cells and the control, two pairs of each in every launch.
    assert_eq!(stored.pairs.len(), 10 * 5 * 2);
    assert!(stored.faults.is_empty() && stored.came_to_its_end());
}

#[test]
fn of_two_comparisons_in_one_folder_one_measures_all_and_the_other_names_it() {
    let repetitions = std::env::var("FATHOM_REPETITIONS").ok();
    for _ in 0..repetitions.and_then(|text| text.parse().ok()).unwrap_or(1) {
        let builds = Builds::new();
        let [base, head] = held(&builds);
        one_of_two(&builds, || builds.command(&base, &head));
        is_whole(&builds);
        let lines = builds.path("out/records.jsonl");
        // As if it had been killed after its exact figures.
        let text = fs::read_to_string(&lines).unwrap();
        let kept = text.lines().take_while(|line| !line.contains("\"kind\":\"pair\""));
        fs::write(&lines, kept.map(|line| format!("{line}\n")).collect::<String>()).unwrap();
        one_of_two(&builds, || {
            let mut command = builds.command(&base, &head);
            command.arg("--resume");
            command
        });
        is_whole(&builds);
        assert!(!builds.path("out/.lock").exists());
    }
}

#[test]
fn damage_in_a_comparison_is_named_and_kept_aside_and_no_comparison_is_not_resumed() {
    let builds = Builds::new();
    let [base, head] = ["base", "head"].map(|name| builds.build(name, &Script::default()));
    let resume = |status: i32| {
        let output = builds.command(&base, &head).arg("--resume").output().unwrap();
        (stderr(&output, status), String::from_utf8(output.stdout).unwrap())
    };
    assert!(resume(2).0.contains("no comparison to resume in "));
    assert!(!builds.path("out").exists());
    assert!(builds.command(&base, &head).output().unwrap().status.success());
    let lines = builds.path("out/records.jsonl");
    let sound = fs::read_to_string(&lines).unwrap();
    let damaged = format!("{sound}nonsense\n{{\"kind\":\"launch\",\"lau");
    fs::write(&lines, &damaged).unwrap();
    let (told, tables) = resume(0);
    assert!(told.contains(": not JSON") && told.contains(": torn off"), "{told}");
    let aside = builds.path("out/records.damaged-1.jsonl");
    assert!(told.contains(&aside.display().to_string()), "{told}");
    assert_eq!(fs::read_to_string(&aside).unwrap(), damaged);
    assert!(fs::read_to_string(&lines).unwrap().starts_with(&sound));
    assert!(tables.contains("records.damaged-1.jsonl"), "{tables}");
    is_whole(&builds);
    for garbage in ["nonsense\n", "{\"record\":\"comparison\",\"kind\":\"header\",\"sch"] {
        fs::write(&lines, garbage).unwrap();
        assert!(resume(2).0.contains("holds no sound record"));
        assert_eq!(fs::read_to_string(&lines).unwrap(), garbage);
    }
}

#[test]
fn a_worker_that_is_stopped_is_told_of_and_an_interrupt_ends_the_wait() {
    let builds = Builds::new();
    let number = builds.path("number");
    let stop = format!("echo $$ > '{}'; kill -STOP $$", number.display());
    let stops = Script { instead: &[("\"id\":\"two\"", &stop)], ..Script::default() };
    let (base, head) = (builds.build("base", &Script::default()), builds.build("head", &stops));
    let mut child =
        builds.command(&base, &head).stderr(Stdio::piped()).stdout(Stdio::null()).spawn().unwrap();
    let mut told = BufReader::new(child.stderr.take().unwrap()).lines().map_while(Result::ok);
    // On a busy machine it is told of slow greetings, too, and of this one before it is stopped.
    let (ending, stopped) = ("to answer `prepare`, for at most 180 s", "; it is stopped, ");
    let awaited = ["", stopped][usize::from(cfg!(target_os = "linux"))];
    let all = format!("{ending}{awaited}");
    let mut before = Vec::new();
    let waiting = told.find(|line| {
        before.push(line.clone());
        line.contains(&all)
    });
    let waiting = waiting.unwrap_or_else(|| panic!("{before:#?}"));
    let number = fs::read_to_string(number).unwrap();
    let number = number.trim();
    let of_whom = format!("waiting for the head worker (process {number}) {ending}");
    assert!(waiting.contains(&of_whom), "{waiting}");
    if cfg!(target_os = "linux") {
        let hint = format!("{stopped}`kill -CONT {number}` lets it go on");
        assert!(waiting.ends_with(&hint), "{waiting}");
    }
    signal("-INT", child.id());
    let rest: Vec<String> = told.collect();
    assert_eq!(child.wait().unwrap().code(), Some(130));
    let waited = |line: &&String| line.contains("no answer to `prepare`");
    assert_eq!(rest.iter().find(waited), None, "it waited for the worker");
    let stored = StoredComparison::read(&builds.path("out")).unwrap();
    assert!(stored.faults.is_empty(), "{:?}", stored.faults);
}

/// Its working directory is a worktree of the repository.
const ENDLESS: &str = "fn main() {
    let folder = std::env::current_dir().unwrap();
    while folder.exists() {
        std::thread::sleep(std::time::Duration::from_millis(50));
    }
}
";

/// A crate whose build begins, and ends only when its worktree is gone.
fn endless_repository(folder: &Path) {
    let manifest =
        "[package]\nname = \"fathom\"\nversion = \"0.1.0\"\nedition = \"2024\"\n\n[workspace]\n";
    let files = [
        ("Cargo.toml", manifest),
        ("Cargo.lock", "version = 4\n\n[[package]]\nname = \"fathom\"\nversion = \"0.1.0\"\n"),
        (".gitignore", "/target\n"),
        ("src/main.rs", "fn main() {}\n"),
        ("build.rs", ENDLESS),
    ];
    fs::create_dir(folder.join("src")).unwrap();
    for (name, text) in files {
        fs::write(folder.join(name), text).unwrap();
    }
    let someone = ["-c", "user.name=Someone", "-c", "user.email=someone@example.org"];
    for arguments in
        [&["init", "--quiet"][..], &["add", "--all"], &["commit", "--quiet", "--message=Change"]]
    {
        let git = Command::new("git").current_dir(folder).args(someone).args(arguments).status();
        assert!(git.unwrap().success());
    }
}

#[test]
fn a_termination_during_the_build_ends_it_and_leaves_no_worktree() {
    let repository = tempfile::tempdir().unwrap();
    endless_repository(repository.path());
    let mut child = fathom()
        .current_dir(repository.path())
        .args(["compare", "--base", "HEAD", "--out", "out"])
        .stderr(Stdio::piped())
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    let mut told = BufReader::new(child.stderr.take().unwrap()).lines().map_while(Result::ok);
    let compiling = told.find(|line| line.contains("Compiling fathom"));
    assert!(compiling.is_some());
    signal("-TERM", child.id());
    let rest: Vec<String> = told.collect();
    assert_eq!(child.wait().unwrap().code(), Some(130), "{rest:?}");
    assert!(rest.iter().any(|line| line.contains("building `HEAD` was interrupted")), "{rest:?}");
    let cache = fs::read_dir(repository.path().join("target/compare")).unwrap();
    let names: Vec<_> = cache.flatten().map(|entry| entry.file_name()).collect();
    assert_eq!(names, ["target"], "no worktree is left");
    assert!(!repository.path().join("out").exists());
}
