//! What an interrupt ends at once.

use super::bisect::{Commits, LOCK, MANIFEST};
use super::builds::{Builds, spawned};
use super::common::{Ends, Place, signal};
use super::script::Script;

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
fn endless_repository() -> Commits {
    let files = [
        ("Cargo.toml", MANIFEST),
        ("Cargo.lock", LOCK),
        (".gitignore", "/target\n"),
        ("main.rs", "fn main() {}\n"),
        ("build.rs", ENDLESS),
    ];
    let write =
        |place: &Place, _| files.iter().for_each(|(name, text)| drop(place.write(name, text)));
    Commits::with_commits(1, write)
}

#[test]
fn a_termination_during_the_build_ends_it() {
    let history = endless_repository();
    let mut compare = history.fathom("compare --base HEAD --out out");
    let (mut child, mut told) = spawned(&mut compare);
    told.find(|line| line.contains("Compiling fathom")).unwrap();
    let in_use = format!("out is in use by process {} (`fathom compare`, since ", child.id());
    history.fathom("compare --base HEAD --out out").refused(&in_use);
    signal("-TERM", child.id());
    let rest: Vec<String> = told.collect();
    assert_eq!(child.wait().unwrap().code(), Some(130), "{rest:?}");
    assert!(rest.iter().any(|line| line.contains("building `HEAD` was interrupted")), "{rest:?}");
    assert!(!history.0.path("out").exists());
}
