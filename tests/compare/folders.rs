//! Folders of comparisons under two processes and damage, and what an interrupt ends at once.

use std::fs;
use std::process::Command;

use super::builds::{Builds, spawned};
use super::common::{Ends, Place, holds, names, repetitions, signal, wait_until};
use super::script::Script;

/// While one comparison measures, another in the same folder names it, and ends before the first may go on.
#[track_caller]
fn one_of_two(builds: &Builds, options: &str) {
    builds.hold();
    let first = builds.command(options).spawn().unwrap();
    let begin = format!("process {} ", first.id());
    let lock = || fs::read_to_string(builds.path("out/.lock")).unwrap_or_default();
    wait_until("a holder of the folder", || lock().starts_with(&begin));
    builds.command(options).refused(&format!("is in use by {begin}(`"));
    builds.release();
    assert!(first.wait_with_output().unwrap().status.success());
}

#[track_caller]
fn is_whole(builds: &Builds) {
    let stored = builds.stored();
    assert_eq!((stored.launches.len(), stored.exact.len()), (10, 8));
    // Four cells and the control, two pairs of each in every launch.
    assert_eq!(stored.pairs.len(), 10 * 5 * 2);
    assert!(stored.faults.is_empty() && stored.came_to_its_end());
}

#[test]
fn of_two_comparisons_in_one_folder_one_measures_all_and_the_other_names_it() {
    for _ in 0..repetitions() {
        let builds = Builds::without_builds();
        builds.build("base", &Script::default());
        // It prepares nothing before it may, so that two processes are sure to meet.
        builds.build("head", &Script { first: builds.waits(), ..Script::default() });
        one_of_two(&builds, "");
        is_whole(&builds);
        let lines = builds.path("out/records.jsonl");
        // As if it had been killed after its exact figures.
        let text = fs::read_to_string(&lines).unwrap();
        let kept = text.lines().take_while(|line| !line.contains("\"kind\":\"pair\""));
        fs::write(&lines, kept.map(|line| format!("{line}\n")).collect::<String>()).unwrap();
        one_of_two(&builds, "--resume");
        is_whole(&builds);
        assert!(!builds.path("out/.lock").exists());
    }
}

#[test]
fn damage_in_a_comparison_is_counted_and_no_comparison_is_not_resumed() {
    let builds = Builds::new(&Script::default(), &Script::default());
    let resume = || builds.command("--resume");
    resume().refused("no comparison to resume in ");
    assert!(!builds.path("out").exists());
    builds.command("").ends(0);
    let lines = builds.path("out/records.jsonl");
    let sound = fs::read_to_string(&lines).unwrap();
    fs::write(&lines, format!("{sound}nonsense\n{{\"kind\":\"launch\",\"lau")).unwrap();
    let told = resume().ends(0);
    holds(&told.err, &[": not JSON", "(and 1 more): skipped"]);
    // The torn line is cut off.
    let begin = format!("{sound}nonsense\n{{\"record\":\"comparison\",\"kind\":\"end\"");
    assert!(fs::read_to_string(&lines).unwrap().starts_with(&begin));
    holds(&told.out, &["left out: line "]);
    is_whole(&builds);
    for garbage in ["nonsense\n", "{\"record\":\"comparison\",\"kind\":\"header\",\"sch"] {
        fs::write(&lines, garbage).unwrap();
        resume().refused("holds no sound record");
        assert_eq!(fs::read_to_string(&lines).unwrap(), garbage);
    }
}

#[test]
fn an_interrupt_ends_the_wait_for_a_worker_that_is_told_of() {
    let builds = Builds::without_builds();
    let waits = builds.waits();
    builds.build("base", &Script::default());
    let instead = [("\"id\":\"two\"", waits.as_str())];
    builds.build("head", &Script { instead: &instead, ..Script::default() });
    let (mut child, mut told) = spawned(&mut builds.command(""));
    let waited = |line: &String| {
        line.contains("waiting for the head worker (process ")
            && line.ends_with("to answer `prepare`, for at most 180 s")
    };
    told.find(waited).unwrap();
    signal("-INT", child.id());
    let rest: Vec<String> = told.collect();
    assert_eq!(child.wait().unwrap().code(), Some(130), "{rest:?}");
    let stored = builds.stored();
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
fn endless_repository() -> Place {
    let place = Place::new();
    let manifest =
        "[package]\nname = \"fathom\"\nversion = \"0.1.0\"\nedition = \"2024\"\n\n[workspace]\n";
    for (name, text) in [
        ("Cargo.toml", manifest),
        ("Cargo.lock", "version = 4\n\n[[package]]\nname = \"fathom\"\nversion = \"0.1.0\"\n"),
        (".gitignore", "/target\n"),
        ("src/main.rs", "fn main() {}\n"),
        ("build.rs", ENDLESS),
    ] {
        place.write(name, text);
    }
    let someone = ["-c", "user.name=Someone", "-c", "user.email=someone@example.org"];
    for words in ["init --quiet", "add --all", "commit --quiet --message=Change"] {
        let mut git = Command::new("git");
        git.current_dir(place.path("")).args(someone).args(words.split(' ')).ends(0);
    }
    place
}

#[test]
fn a_termination_during_the_build_ends_it_and_leaves_no_worktree() {
    let place = endless_repository();
    let mut compare = place.fathom("compare --base HEAD --out out");
    let (mut child, mut told) = spawned(&mut compare);
    told.find(|line| line.contains("Compiling fathom")).unwrap();
    signal("-TERM", child.id());
    let rest: Vec<String> = told.collect();
    assert_eq!(child.wait().unwrap().code(), Some(130), "{rest:?}");
    assert!(rest.iter().any(|line| line.contains("building `HEAD` was interrupted")), "{rest:?}");
    assert_eq!(names(&place.path("target/compare")), ["target"], "no worktree is left");
    assert!(!place.path("out").exists());
}
