//! `fathom bisect` over a repository of a small program that answers as a worker does. Its times are constants of its source.

use std::process::Command;

use serde_json::Value;

use super::builds::CELLS;
use super::common::{Ends, Place};
use super::script::hello;

const MANIFEST: &str = "[package]\nname = \"fathom\"\nversion = \"0.1.0\"\nedition = \"2024\"\n\n\
    [[bin]]\nname = \"fathom\"\npath = \"main.rs\"\n\n[workspace]\n";
const LOCK: &str = "version = 4\n\n[[package]]\nname = \"fathom\"\nversion = \"0.1.0\"\n";
/// The answers to messages; HELLO and NS are put in.
const MAIN: &str = r##"
fn main() {
    for line in std::io::stdin().lines() {
        let line = line.unwrap();
        let asks = |word: &str| line.contains(&format!("\"message\":\"{word}\""));
        if asks("hello") {
            println!("{}", r#"HELLO"#);
        } else if asks("prepare") {
            println!("{}", r#"{"message":"prepared","stages":[{"name":"a","kind":"compute"},{"name":"b","kind":"compute"}]}"#);
        } else if asks("sample") {
            let ns = if line.contains("\"stage\":\"a\"") { NS } else { 2000000 };
            println!("{{\"message\":\"sample\",\"ns\":[{ns}]}}");
        } else {
            return;
        }
    }
}
"##;

/// Commits of the program; each has the time of stage `a`, or does not build.
struct History(Place);

impl History {
    fn new(times: &[Option<u64>]) -> Self {
        let history = Self(Place::new());
        history.git(&["init", "--quiet"]);
        for (name, text) in [("Cargo.toml", MANIFEST), ("Cargo.lock", LOCK), (".gitignore", "*\n")]
        {
            history.0.write(name, text);
        }
        history.0.write("cells.toml", CELLS);
        let hello = hello(1, r#""time""#);
        let hello = hello.trim_start_matches("echo '").trim_end_matches('\'');
        for (number, ns) in times.iter().enumerate() {
            let text = MAIN.replace("HELLO", hello);
            let ns = ns.map_or("no number".to_owned(), |ns| ns.to_string());
            let text = text.replace("{ NS }", &format!("{{ {ns} }}"));
            history.0.write("main.rs", format!("// {number}\n{text}"));
            history.git(&["add", "--force", "Cargo.toml", "Cargo.lock", "main.rs"]);
            history.git(&["commit", "--quiet", &format!("--message=Change {number}")]);
        }
        history
    }

    fn git(&self, arguments: &[&str]) {
        let mut git = Command::new("git");
        git.args(["-c", "user.name=Someone", "-c", "user.email=someone@example.org"]);
        let status = git.args(arguments).current_dir(self.0.path("")).status().unwrap();
        assert!(status.success(), "{arguments:?}");
    }

    fn bisect(&self, options: &str) -> Command {
        let commits = "bisect --gates time --cells-file cells.toml --launches 10 --json --out out";
        self.0.fathom(format!("{commits} {options}"))
    }
}

const USUAL: Option<u64> = Some(2_000_000);
const SLOWER: Option<u64> = Some(2_100_000);

#[test]
fn the_revision_that_made_a_stage_slower_is_found_past_one_that_does_not_build() {
    let times = [USUAL, USUAL, None, USUAL, USUAL, SLOWER, SLOWER, SLOWER, SLOWER];
    let history = History::new(&times);
    let told = history.bisect("--good HEAD~8").ends(0);
    let found: Value = serde_json::from_str(&told.out).unwrap();
    let answer = &found["answer"];
    assert_eq!(found["count"], 8);
    let commit = answer["first"].as_str().unwrap();
    let mut subject = Command::new("git");
    let subject =
        subject.args(["log", "-1", "--format=%s", commit]).current_dir(history.0.path(""));
    assert_eq!(String::from_utf8(subject.output().unwrap().stdout).unwrap(), "Change 5\n");
    assert!(answer["probability"].as_f64().unwrap() >= 0.95, "{answer}");
    assert!(answer["cell"].as_str().unwrap().ends_with(" a"), "{answer}");
    assert!((answer["change"].as_f64().unwrap() - 0.05).abs() < 1e-3, "{answer}");
    // The same again from its folder, which asks for no build.
    let again = history.bisect("--good HEAD~8 --resume").ends(0);
    assert_eq!(again.out, told.out);
    for other in ["--good HEAD~7 --resume", "--good HEAD~8 --cells two --resume"] {
        let told = history.bisect(other).ends(2);
        assert!(told.err.contains("other revisions or cells"), "{}", told.err);
    }
    let taken = history.bisect("--good HEAD~8").ends(2);
    assert!(taken.err.contains("--resume"), "{}", taken.err);
}

#[test]
fn neighbours_of_a_revision_that_does_not_build_are_not_told_apart() {
    let history = History::new(&[USUAL, USUAL, None, SLOWER, SLOWER]);
    let told = history.bisect("--good HEAD~4").ends(3);
    let answer: Value = serde_json::from_str(&told.out).unwrap();
    let answer = &answer["answer"];
    assert_eq!(answer["candidates"].as_array().unwrap().len(), 2, "{answer}");
    assert_eq!(answer["skipped"].as_array().unwrap().len(), 1, "{answer}");
    assert!(answer["skipped"][0]["reason"].as_str().unwrap().contains("does not build"));
}

#[test]
fn equal_ends_leave_nothing_to_find() {
    let history = History::new(&[USUAL, SLOWER, USUAL]);
    let told = history.bisect("--good HEAD~2").ends(1);
    let found: Value = serde_json::from_str(&told.out).unwrap();
    assert!(found["answer"].is_null() && found["ends"] == "no regression", "{found}");
    // An end without times, and one that does not build.
    for (bad, reason) in [(Some(0), "could not measure"), (None, "does not build")] {
        let told = History::new(&[USUAL, bad]).bisect("--good HEAD~1").ends(2);
        assert!(format!("{}{}", told.out, told.err).contains(reason), "{}", told.err);
    }
    let backwards = history.bisect("--good HEAD --bad HEAD~1").output().unwrap();
    assert_eq!(backwards.status.code(), Some(2));
}
