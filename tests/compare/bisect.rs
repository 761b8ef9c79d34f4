//! `fathom bisect` over a repository of a small program that answers as a worker does. Its times are constants of its source.

use std::path::Path;
use std::process::Command;

use serde_json::Value;

use super::builds::CELLS;
use super::common::{Ends, Place, holds};
use super::script::{Script, hello};

const MANIFEST: &str = "[package]\nname = \"fathom\"\nversion = \"0.1.0\"\nedition = \"2024\"\n\n\
    [[bin]]\nname = \"fathom\"\npath = \"main.rs\"\n\n[workspace]\n";
const LOCK: &str = "version = 4\n\n[[package]]\nname = \"fathom\"\nversion = \"0.1.0\"\n";
/// The answers to messages; HELLO and NS are put in.
const MAIN: &str = r##"
static LAUNCH: std::sync::OnceLock<u64> = std::sync::OnceLock::new();

/// A worker of one configuration is steady; others are faster and slower by a fifth in turn.
#[allow(dead_code)]
fn wild(prepared: u32) -> u64 {
    use std::io::Write;
    if prepared < 2 {
        return 2_100_000;
    }
    let count = || {
        let mut file = std::fs::OpenOptions::new().create(true).append(true).open("launches").unwrap();
        file.write_all(b".").unwrap();
        file.metadata().unwrap().len()
    };
    1_600_000 + *LAUNCH.get_or_init(count) % 2 * 800_000
}

fn main() {
    let mut prepared = 0;
    for line in std::io::stdin().lines() {
        let line = line.unwrap();
        let asks = |word: &str| line.contains(&format!("\"message\":\"{word}\""));
        if asks("hello") {
            println!("{}", r#"HELLO"#);
        } else if asks("prepare") {
            prepared += 1;
            println!("{}", r#"{"message":"prepared","stages":[{"name":"a","kind":"compute"},{"name":"b","kind":"compute"}]}"#);
        } else if asks("sample") {
            let ns = if line.contains("\"stage\":\"a\"") { NS } else { 2000000 };
            println!("{{\"message\":\"sample\",\"ns\":[{ns}]}}");
        } else {
            let _ = prepared;
            return;
        }
    }
}
"##;

/// Commits of the program; each has the time of stage `a` as an expression.
struct History(Place);

impl History {
    fn new(times: &[&str]) -> Self {
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
            let text = text.replace("{ NS }", &format!("{{ {ns} }}"));
            history.0.write("main.rs", format!("// {number}\n{text}"));
            history.commit(number, &["Cargo.toml", "Cargo.lock", "main.rs"]);
        }
        history
    }

    /// A repository whose commits each write something.
    fn of(commits: usize, write: impl Fn(&Path, usize)) -> Self {
        let history = Self(Place::new());
        history.git(&["init", "--quiet"]);
        for number in 0..commits {
            write(&history.0.path(""), number);
            history.commit(number, &[":!home", "."]);
        }
        history
    }

    fn commit(&self, number: usize, paths: &[&str]) {
        self.git(&[&["add", "--force"], paths].concat());
        self.git(&["commit", "--quiet", "--allow-empty", &format!("--message=Change {number}")]);
    }

    /// First line of a commit's message.
    fn subject(&self, commit: &str) -> String {
        let mut git = Command::new("git");
        git.args(["log", "-1", "--format=%s", commit]).current_dir(self.0.path(""));
        String::from_utf8(git.output().unwrap().stdout).unwrap().trim().to_owned()
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

const USUAL: &str = "2_000_000";
const SLOWER: &str = "2_100_000";
const WILD: &str = "wild(prepared)";
const BROKEN: &str = "no number";

#[test]
fn the_revision_that_made_a_stage_slower_is_found_past_one_that_does_not_build() {
    let times = [USUAL, USUAL, BROKEN, USUAL, USUAL, SLOWER, SLOWER, SLOWER, SLOWER];
    let history = History::new(&times);
    let told = history.bisect("--good HEAD~8").ends(0);
    let found: Value = serde_json::from_str(&told.out).unwrap();
    let answer = &found["answer"];
    assert_eq!(found["count"], 8);
    let commit = answer["first"].as_str().unwrap();
    assert_eq!(history.subject(commit), "Change 5");
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
    let history = History::new(&[USUAL, USUAL, BROKEN, SLOWER, SLOWER]);
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
    for (bad, reason) in [("0", "could not measure"), (BROKEN, "does not build")] {
        let told = History::new(&[USUAL, bad]).bisect("--good HEAD~1").ends(2);
        assert!(format!("{}{}", told.out, told.err).contains(reason), "{}", told.err);
    }
    let backwards = history.bisect("--good HEAD --bad HEAD~1").output().unwrap();
    assert_eq!(backwards.status.code(), Some(2));
}

#[test]
fn ends_that_noise_leaves_open_are_measured_cell_by_cell() {
    let history = History::new(&[USUAL, SLOWER, SLOWER, WILD]);
    let told = history.bisect("--good HEAD~3").ends(0);
    assert!(told.err.contains("open between the ends"), "{}", told.err);
    let found: Value = serde_json::from_str(&told.out).unwrap();
    let answer = &found["answer"];
    assert_eq!(history.subject(answer["first"].as_str().unwrap()), "Change 1", "{found}");
    assert!((answer["change"].as_f64().unwrap() - 0.05).abs() < 1e-3, "{found}");
}

#[test]
fn a_program_of_another_language_is_searched_in_its_checkouts() {
    let example = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/own_worker");
    let history = History::of(10, |folder, number| {
        let text = std::fs::read_to_string(example.join("worker.py")).unwrap();
        let turns = if number < 6 { "1.0" } else { "1.05" };
        let text = text.replace("default=1.0", &format!("default={turns}"));
        std::fs::write(folder.join("worker.in"), text).unwrap();
        // One revision does not build.
        std::fs::write(
            folder.join("build.sh"),
            if number == 3 { "exit 1" } else { "mv worker.in worker.py" },
        )
        .unwrap();
        std::fs::write(folder.join(".gitignore"), "/out\n").unwrap();
    });
    let mut command =
        history.0.fathom("bisect --good HEAD~9 --gates time --launches 10 --out out --json");
    command.arg("--cells-file").arg(example.join("cells.toml"));
    command.args(["--build-cmd", "sh build.sh", "--cmd", "python3 worker.py --counted"]);
    let found = command.ends(0).json();
    let answer = &found["answer"];
    assert_eq!(history.subject(answer["first"].as_str().unwrap()), "Change 6", "{found}");
    assert!((answer["change"].as_f64().unwrap() - 0.05).abs() < 1e-3, "{found}");
    let left = std::fs::read_dir(history.0.path("out/checkouts")).unwrap().count();
    assert_eq!(left, 0, "checkouts are removed in the end");
    assert_eq!(command.arg("--resume").ends(0).json(), found);
}

#[test]
fn a_cell_that_became_less_accurate_or_needs_more_memory_is_searched_by_bisection() {
    for (error, bytes, figure) in [("0.02", 1000, "an_error"), ("0.01", 3000, "allocated_bytes")] {
        let history = History::of(17, |folder, number| {
            let usual = Script::default();
            let worse = Script { error, bytes, ..Script::default() };
            (if number < 11 { usual } else { worse }).write(folder, "worker.sh");
            std::fs::write(folder.join("cells.toml"), CELLS).unwrap();
        });
        let words = "bisect --good HEAD~16 --gates exact --cells-file cells.toml --out out";
        let mut command = history.0.fathom(words);
        command.args(["--build-cmd", ":", "--cmd", "./worker.sh"]);
        let told = command.ends(0).out;
        holds(&told, &["first revision: ", "Change 11 ", figure, "16 revisions, 5 launches"]);
        let found = command.args(["--json", "--resume"]).ends(0).json();
        let answer = &found["answer"];
        assert_eq!((&answer["gate"], &answer["figure"]), (&"exact".into(), &figure.into()));
        assert!(answer["head"].as_f64() > answer["base"].as_f64() && answer["change"].is_null());
    }
}

#[test]
fn the_driver_that_made_a_stage_slower_is_found_past_one_that_cannot_be_loaded() {
    let place = Place::new();
    let hello = hello(1, r#""time""#).replace(r#""backend":"""#, r#""backend":"vulkan""#);
    // The manifest's folder has the time, which a driver without one does not give.
    let sample = r#"read -r ns < "${VK_DRIVER_FILES%/*}/ns" && echo "{\"message\":\"sample\",\"ns\":[$ns]}""#;
    let broken = format!(r#"test -e "${{VK_DRIVER_FILES%/*}}/ns" && {hello} || exit 1"#);
    let instead = [("\"sample\"", sample)];
    Script { hello: broken, instead: &instead, ..Script::default() }
        .write(&place.path(""), "program");
    place.write("cells.toml", CELLS);
    let mut list = String::new();
    for (number, ns) in
        [2_000_000, 2_000_000, 0, 2_100_000, 2_100_000, 2_100_000].iter().enumerate()
    {
        place.write(format!("{number}/icd.json"), r#"{"ICD": {"library_path": "driver.so"}}"#);
        if *ns > 0 {
            place.write(format!("{number}/ns"), format!("{ns}\n"));
        }
        list += &format!("{number}/icd.json\n");
    }
    place.write("drivers.txt", list);
    let words = "bisect --drivers drivers.txt --program ./program --cells-file cells.toml --gates time --launches 10 --json --out out";
    let found = place.fathom(words).ends(3).json();
    let answer = &found["answer"];
    let names: Vec<String> =
        answer["candidates"].as_array().unwrap().iter().map(|of| of["name"].to_string()).collect();
    assert!(
        names.len() == 2 && names[0].contains("/2/icd") && names[1].contains("/3/icd"),
        "{found}"
    );
    holds(&answer["skipped"][0]["reason"].to_string(), &["gives no Vulkan adapter"]);
}

/// A crate in a registry of files, whose number is the time of stage `a`, and a program that depends on it.
#[test]
fn the_version_of_a_crate_that_made_a_stage_slower_is_found_past_one_that_does_not_fit() {
    let history = History::of(1, |folder, _| {
        let write = |name: String, text: &str| {
            let path = folder.join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        };
        let versions = [
            ("1.0.0", USUAL),
            ("1.1.0", USUAL),
            ("1.2.0", SLOWER),
            ("1.3.0", SLOWER),
            ("2.0.0", USUAL),
        ];
        for (version, ns) in versions {
            let manifest = format!(
                "[package]\nname = \"small\"\nversion = \"{version}\"\nedition = \"2024\"\n"
            );
            write(format!("registry/small-{version}/Cargo.toml"), &manifest);
            let source = format!("pub const NS: u64 = {};\n", ns);
            write(format!("registry/small-{version}/src/lib.rs"), &source);
            let pack = format!(
                r#"tar czf small-{version}.crate small-{version} && mkdir -p index/sm/al &&
                sum=$(sha256sum small-{version}.crate) && cat >> index/sm/al/small <<END
{{"name":"small","vers":"{version}","deps":[],"cksum":"${{sum%% *}}","features":{{}},"yanked":false}}
END"#
            );
            let mut shell = Command::new("sh");
            shell.args(["-c", &pack]).current_dir(folder.join("registry"));
            assert!(shell.status().unwrap().success());
        }
        let source = "[source.crates-io]\nreplace-with = \"here\"\n[source.here]\nlocal-registry = \"registry\"\n";
        write(".cargo/config.toml".into(), source);
        write("Cargo.toml".into(), &format!("{MANIFEST}\n[dependencies]\nsmall = \"1\"\n"));
        write("main.rs".into(), "");
        let mut cargo = Command::new(env!("CARGO"));
        cargo.args(["generate-lockfile", "--offline"]).current_dir(folder);
        assert!(cargo.env("CARGO_HOME", folder.join("home")).status().unwrap().success());
        let hello = hello(1, r#""time""#);
        let hello = hello.trim_start_matches("echo '").trim_end_matches('\'');
        write("main.rs".into(), &MAIN.replace("HELLO", hello).replace("{ NS }", "{ small::NS }"));
        write("cells.toml".into(), CELLS);
        write(".gitignore".into(), "/target\n/out\n/home\n");
    });
    let words = "bisect --crate small --versions 1.0.0,2.0.0,1.1.0,1.2.0,1.3.0 --cells-file cells.toml --gates time --launches 10 --json --out out";
    let home = history.0.path("home");
    let found = history.0.fathom(words).env("CARGO_HOME", &home).ends(0).json();
    let answer = &found["answer"];
    assert_eq!(
        (&answer["first"], &found["good"]),
        (&"1.2.0".into(), &"small 1.0.0".into()),
        "{found}"
    );
    for skipped in answer["skipped"].as_array().unwrap() {
        let reason = skipped["reason"].as_str().unwrap();
        holds(reason, &["small 2.0.0 cannot be chosen; cargo says: error: "]);
        assert_eq!(reason.lines().count(), 1, "{reason}");
    }
    let refused = history
        .0
        .fathom("bisect --crate small --versions 2.0.0,1.0.0 --out other")
        .env("CARGO_HOME", &home)
        .ends(2);
    holds(&refused.err, &["small 2.0.0 cannot be chosen"]);
}
