//! `fathom bisect` over a repository of a small program that answers as a worker does.

use std::path::Path;
use std::process::Command;

use tempfile::TempDir;

use super::builds::CELLS;
use super::common::{Ends, Place, git, holds, names};
use super::script::{Script, hello, sample};

pub const MANIFEST: &str = "[package]\nname = \"fathom\"\nversion = \"0.1.0\"\nedition = \"2024\"\n\n\
    [[bin]]\nname = \"fathom\"\npath = \"main.rs\"\n\n[workspace]\n";
pub const LOCK: &str = "version = 4\n\n[[package]]\nname = \"fathom\"\nversion = \"0.1.0\"\n";
/// A program that is a script.
const MAIN: &str = "fn main() {
    let script = include_str!(\"worker.sh\");
    std::process::Command::new(\"sh\").args([\"-c\", script]).status().unwrap();
}
";

/// Commits of a program, and a cache for its builds.
pub struct Commits(pub Place, pub TempDir);

impl Commits {
    /// Two of a crate whose program greets so.
    pub fn built(hello: &str) -> Self {
        let files = [
            ("Cargo.toml", MANIFEST),
            ("Cargo.lock", LOCK),
            (".gitignore", "*\n"),
            ("main.rs", MAIN),
            ("cells.toml", CELLS),
        ];
        Self::with_commits(2, |place, _| {
            files.iter().for_each(|(name, text)| drop(place.write(name, text)));
            Script { hello: hello.to_owned(), ..Script::default() }
                .write(&place.path(""), "worker.sh");
        })
    }

    /// A repository whose commits each write something.
    pub fn with_commits(commits: usize, write: impl Fn(&Place, usize)) -> Self {
        let history = Self(Place::new(), tempfile::tempdir().unwrap());
        history.git(&["init", "--quiet", "--initial-branch=master"]);
        for number in 0..commits {
            write(&history.0, number);
            history.commit(number);
        }
        history
    }

    /// The program in its folder.
    pub fn fathom(&self, words: impl AsRef<str>) -> Command {
        let mut command = self.0.fathom(words);
        command.env("XDG_CACHE_HOME", self.1.path());
        command
    }

    fn commit(&self, number: usize) {
        self.git(&["add", "--force", "."]);
        self.git(&["commit", "--quiet", "--allow-empty", &format!("--message=Change {number}")]);
    }

    /// First line of a commit's message.
    fn subject(&self, commit: &str) -> String {
        git(self.0.path("")).args(["log", "-1", "--format=%s", commit]).answer().trim().to_owned()
    }

    pub fn git(&self, arguments: &[&str]) {
        git(self.0.path("")).args(arguments).ends(0);
    }
}

#[test]
fn equal_ends_leave_nothing_to_find() {
    let history = Commits::built(&hello(1, r#""time""#));
    let bisect = "bisect --gates time --cells-file cells.toml --launches 10 --json --out";
    let found = history.fathom(format!("{bisect} out --good HEAD~1")).ends(1).json();
    assert!(found["answer"].is_null() && found["ends"] == "no regression", "{found}");
    let mut turned = history.fathom(format!("{bisect} other --good HEAD --bad HEAD~1"));
    turned.refused("the good revision must come before the bad one");
}

#[test]
fn a_program_of_another_language_is_searched_in_its_checkouts() {
    let example = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/own_worker");
    let history = Commits::with_commits(6, |place, number| {
        let text = std::fs::read_to_string(example.join("worker.py")).unwrap();
        let turns = if number < 4 { "1.0" } else { "1.05" };
        let text = text.replace("default=1.0", &format!("default={turns}"));
        place.write("worker.in", text);
        // One revision does not build.
        place.write("build.sh", if number == 2 { "exit 1" } else { "mv worker.in worker.py" });
        place.write(".gitignore", "/out\n");
    });
    let mut command =
        history.fathom("bisect --good HEAD~5 --gates time --launches 10 --out out --json");
    command.arg("--cells-file").arg(example.join("cells.toml"));
    command.args(["--build-cmd", "sh build.sh", "--cmd", "python3 worker.py --counted"]);
    let found = command.ends(0).json();
    let answer = &found["answer"];
    assert_eq!(history.subject(answer["first"].as_str().unwrap()), "Change 4", "{found}");
    assert!(found["count"] == 5 && answer["probability"].as_f64().unwrap() >= 0.95, "{answer}");
    assert!((answer["change"].as_f64().unwrap() - 0.05).abs() < 1e-3, "{found}");
    let checkouts = history.1.path().join("fathom/searches");
    let checkouts = checkouts.join(&names(&checkouts)[0]);
    assert_eq!(names(&checkouts), [""; 0], "checkouts are removed in the end");
    let settings = history.0.read("out/settings.json");
    assert!(!settings.contains("--counted"), "a command may hold secrets: {settings}");
    // What a search leaves that is killed.
    let left = checkouts.join("left").display().to_string();
    history.git(&["worktree", "add", "--quiet", "--detach", &left, "HEAD"]);
    holds(&command.ends(2).err, &["--resume"]);
    assert_eq!(command.arg("--resume").ends(0).json(), found);
    let worktrees = git(history.0.path("")).args(["worktree", "list"]).answer();
    assert_eq!(worktrees.lines().count(), 1, "{worktrees}");
    let other = command.args(["--batch", "8"]).ends(2);
    holds(&other.err, &["was begun with other settings: ", "`batch` was 4 and is now 8"]);
}

/// The good revision is a release of another branch: what it has in common with the bad one is good. A cell that became less accurate is searched
/// by bisection, with a launch for each revision.
#[test]
fn a_good_revision_of_another_branch_begins_the_search_where_they_part() {
    let history = Commits::with_commits(9, |place, number| {
        let error = if number < 5 { "0.01" } else { "0.02" };
        Script { error, ..Script::default() }.write(&place.path(""), "worker.sh");
        place.write("cells.toml", CELLS);
    });
    history.git(&["checkout", "--quiet", "-b", "release", "HEAD~8"]);
    history.git(&["commit", "--quiet", "--allow-empty", "--message=Release"]);
    let words =
        "bisect --good release --bad master --gates exact --cells-file cells.toml --out out";
    let mut command = history.fathom(words);
    let output = command.args(["--build-cmd", ":", "--cmd", "./worker.sh"]).ends(0);
    holds(&output.out, &["first revision: ", "Change 5 ", "an_error", "8 revisions, 4 launches"]);
    holds(&output.err, &[" is of another branch: the search begins where they part, at "]);
}

#[test]
fn lines_of_a_file_are_searched_by_a_command_past_one_that_cannot_be_measured() {
    let place = Place::new();
    let hello = format!("test -e \"$CANDIDATE/ns\" && {} || exit 1", hello(1, r#""time""#));
    let answer = format!("read -r ns < \"$CANDIDATE/ns\" && {{ {}; }}", sample("$ns"));
    let instead = [("\"sample\"", answer.as_str())];
    Script { hello, instead: &instead, ..Script::default() }.write(&place.path(""), "worker");
    place.write("cells.toml", CELLS);
    let times = ["200", "200", "", "210", "210", "210"];
    for (number, ns) in times.iter().enumerate().filter(|(_, ns)| !ns.is_empty()) {
        place.write(format!("mesa 2{number}/time"), format!("{ns}\n"));
    }
    let list = (0..times.len()).map(|number| format!("mesa 2{number}\n"));
    place.write("list.txt", list.collect::<String>());
    let words = "bisect --candidates list.txt --cells-file cells.toml --gates time --launches 10 --json --out out";
    let build = "test ! -e \"$CANDIDATE/time\" || cp \"$CANDIDATE/time\" \"$CANDIDATE/ns\"";
    let mut command = place.fathom(words);
    command.args(["--build-cmd", build, "--cmd", "./worker"]);
    let found = command.ends(3).json();
    let answer = &found["answer"];
    let candidates = answer["candidates"].as_array().unwrap();
    let names: Vec<&str> = candidates.iter().map(|of| of["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["mesa 22", "mesa 23"], "{found}");
    holds(&answer["skipped"][0]["reason"].to_string(), &["it ended with exit status: 1"]);
}

/// A build that says of which commit it is: another than was asked for would be compared in silence.
#[test]
fn a_base_of_another_commit_is_refused_and_one_that_does_not_say_is_noted() {
    let build = |text: &str| {
        let greeting = hello(1, r#""time""#).replace("\"notes\"", &format!("{text}\"notes\""));
        let history = Commits::built(&greeting);
        Script::default().write(&history.0.path(""), "head");
        history
    };
    let compare = "compare --base HEAD~1 --head-bin ./head --cells-file cells.toml --gates time --launches 10 --pairs 2 --out out";
    let output = build("").fathom(compare).ends(0);
    holds(&output.out, &["the base build does not say of which commit it was built"]);
    let other = build(r#""build":{"commit":"0123","dirty":true},"#);
    let reason = "the base build: it was built of 0123 with changed files and not of ";
    other.fathom(compare).ends(2).error(reason);
}

#[test]
fn what_keeps_git_from_a_revision_is_told_in_its_words() {
    let history =
        Commits::with_commits(2, |place, number| drop(place.write("a", number.to_string())));
    let here = format!("file://{}", history.0.path("").display());
    history.git(&["clone", "--quiet", "--depth", "1", &here, "clone"]);
    for (folder, name, value, reason) in [
        ("", "GIT_TEST_ASSUME_DIFFERENT_OWNER", "1", "fatal: detected dubious ownership in"),
        ("", "PATH", "/nowhere", "git: it cannot be started: "),
        ("clone", "A", "", ": fatal: "),
    ] {
        for words in ["compare --base", "bisect --good"] {
            let mut command = history.fathom(format!("{words} HEAD~1"));
            command.env("GIT_CONFIG_GLOBAL", "/dev/null").env(name, value);
            let output = command.current_dir(history.0.path(folder)).refused(reason);
            let is_shallow = folder == "clone";
            assert_eq!(output.contains("the clone is shallow: "), is_shallow, "{output}");
        }
    }
}

#[test]
fn checkouts_have_their_submodules() {
    let worker =
        |place: &Place, _: usize| drop(Script::default().write(&place.path(""), "worker.sh"));
    let module = Commits::with_commits(1, worker);
    let history = Commits::with_commits(1, |place, _| drop(place.write("cells.toml", CELLS)));
    let from = format!("file://{}", module.0.path("").display());
    let add = "-c protocol.file.allow=always submodule --quiet add";
    git(history.0.path("")).args(add.split(' ')).args([from.as_str(), "module"]).ends(0);
    history.commit(1);
    history.commit(2);
    let words = "bisect --good HEAD~1 --gates exact --cells-file cells.toml --out out --build-cmd : --cmd ./module/worker.sh";
    let mut command = history.fathom(words);
    let allowed = history.0.write(".git/allowed", "[protocol \"file\"]\nallow = always\n");
    command.env("GIT_CONFIG_GLOBAL", allowed);
    holds(&command.ends(1).out, &["nothing to find"]);
}
