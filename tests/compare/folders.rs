//! What an interrupt ends at once.

use std::fs;

use super::bisect::History;
use super::builds::{Builds, spawned};
use super::common::{Place, names, signal};
use super::script::Script;

#[test]
fn a_worker_that_is_stopped_is_told_of_and_an_interrupt_ends_the_wait() {
    let builds = Builds::without_builds();
    let number = builds.path("number");
    let stop = format!("echo $$ > '{}'; kill -STOP $$", number.display());
    builds.build("base", &Script::default());
    let instead = [("\"id\":\"two\"", stop.as_str())];
    builds.build("head", &Script { instead: &instead, ..Script::default() });
    let (mut child, mut told) = spawned(&mut builds.command(""));
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
        let hint = format!("{stopped}`kill -CONT {number}` continues it");
        assert!(waiting.ends_with(&hint), "{waiting}");
    }
    signal("-INT", child.id());
    let rest: Vec<String> = told.collect();
    assert_eq!(child.wait().unwrap().code(), Some(130));
    let waited = |line: &&String| line.contains("no answer to `prepare`");
    assert_eq!(rest.iter().find(waited), None, "it waited for the worker");
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
    let manifest =
        "[package]\nname = \"fathom\"\nversion = \"0.1.0\"\nedition = \"2024\"\n\n[workspace]\n";
    let files = [
        ("Cargo.toml", manifest),
        ("Cargo.lock", "version = 4\n\n[[package]]\nname = \"fathom\"\nversion = \"0.1.0\"\n"),
        (".gitignore", "/target\n"),
        ("src/main.rs", "fn main() {}\n"),
        ("build.rs", ENDLESS),
    ];
    let write =
        |place: &Place, _| files.iter().for_each(|(name, text)| drop(place.write(name, text)));
    History::of(1, write).0
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
