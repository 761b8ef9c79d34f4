//! `fathom history` from the command line, with both databases.
#![cfg(target_os = "linux")]

mod made;
mod planted;
#[cfg(feature = "postgres")]
mod postgres;
#[cfg(feature = "postgres")]
mod server;

use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::common::hostile::HOSTILE;
use crate::common::{fathom, refused, stderr};
use fathom::record::Record;
use made::{CELLS, FIGURES_OF_A_CELL, Repository};
use nix::sys::signal::Signal;
use serde_json::Value;

/// `fathom history` in a folder, without the variables of a job.
fn history(folder: &Path, place: &str, arguments: &[&str]) -> Command {
    let mut command = fathom();
    for name in
        ["GITHUB_SHA", "GITHUB_REF_NAME", "CI_COMMIT_SHA", "CI_COMMIT_REF_NAME", "FATHOM_HISTORY"]
    {
        command.env_remove(name);
    }
    command.current_dir(folder).arg("history").args(arguments).args(["--db", place]);
    command
}

#[track_caller]
fn done(mut command: Command) -> String {
    let output = command.output().unwrap();
    stderr(&output, 0);
    String::from_utf8(output.stdout).unwrap()
}

fn add<'a>(folder: &'a str, commit: &'a str) -> [&'a str; 8] {
    ["add", folder, "--commit", commit, "--branch", "main", "--machine", "m"]
}

/// Names of the stored runs, in their order.
fn runs(folder: &Path, place: &str) -> Vec<String> {
    let listed = done(history(folder, place, &["list"]));
    listed.lines().skip(1).map(|line| line.split(' ').next().unwrap().to_owned()).collect()
}

fn got(folder: &Path, place: &str, run: &str) -> Vec<u8> {
    let out = tempfile::tempdir().unwrap();
    done(history(folder, place, &["get", run, "--out", out.path().to_str().unwrap()]));
    std::fs::read(out.path().join("records.jsonl")).unwrap()
}

/// What both databases do alike.
fn keeps_runs_whole(folder: &Path, place: &str) {
    let repository = Repository::new(&folder.join("repository"), 2);
    let here = &repository.folder;
    let records = [made::records(1, CELLS, 5e6), made::records(2, CELLS, 5e6)];
    made::folder(folder, "first", &records[0]);
    made::folder(folder, "second", &records[1]);
    // The later commit first: the order is that of the commits.
    let told = done(history(here, place, &["add", "../second", "--machine", "m"]));
    assert!(
        told.contains(&format!("{CELLS} cells with {} figures stored", CELLS * FIGURES_OF_A_CELL)),
        "{told}"
    );
    assert!(told.contains(&repository.commits[1]) && told.contains("on main"), "{told}");
    done(history(here, place, &["add", "../first", "--commit", "HEAD~1"]));
    let stored = runs(here, place);
    assert_eq!(stored.len(), 2);
    for (run, records) in stored.iter().zip(&records) {
        assert_eq!(&got(here, place, run), records);
    }
    // Again, and as another commit's.
    let told = done(history(here, place, &["add", "../second"]));
    assert!(told.contains("stored already, nothing changed"), "{told}");
    let other = history(here, place, &["add", "../first"]).output().unwrap();
    let told = refused(&other, "is stored already, as one of commit");
    assert!(told.contains(&repository.commits[0]), "{told}");
    assert_eq!(runs(here, place), stored);
    let unknown = history(here, place, &["get", "ffffffff", "--out", "x"]).output().unwrap();
    refused(&unknown, "no run `ffffffff`");
}

/// A shard that another machine measured than the night before begins new series.
fn tells_machines_apart(folder: &Path, place: &str) {
    let repository = Repository::new(&folder.join("machines"), 3);
    let here = &repository.folder;
    let nights = [&["n1", "n2"], &["n1", "n2"], &["n2", "n1"]];
    let series = || {
        let told = done(history(here, place, &["changes", "--json"]));
        serde_json::from_str::<Value>(&told).unwrap()["too_short"].as_u64().unwrap() as usize
    };
    let mut counted = Vec::new();
    for (night, (hosts, commit)) in nights.iter().zip(&repository.commits).enumerate() {
        made::folder(here, "run", &made::merged(night, *hosts));
        done(history(here, place, &["add", "run", "--commit", commit]));
        counted.push(series() / FIGURES_OF_A_CELL);
    }
    assert_eq!(counted, [2, 2, 4]);
    let listed = done(history(here, place, &["list"]));
    assert!(listed.contains(" n1, n2 ") && listed.contains(" n2, n1 "), "{listed}");
    // What was said goes before what the records name.
    made::folder(here, "run", &made::merged(nights.len(), &["n3", "n4"]));
    done(history(here, place, &["add", "run", "--machine", "farm"]));
    assert_eq!(series(), 6 * FIGURES_OF_A_CELL);
    assert!(done(history(here, place, &["list"])).contains(" farm "));
}

/// Forty days, cell 0 slower by 10 % from day 25 on.
fn names_the_commits_of_a_change(folder: &Path, place: &str) {
    let repository = Repository::new(&folder.join("days"), 40);
    let here = &repository.folder;
    for (day, commit) in repository.commits.iter().enumerate() {
        let ns = if day >= 25 { 5.5e6 } else { 5e6 };
        made::folder(here, "run", &made::records(day, CELLS, ns));
        done(history(here, place, &add("run", commit)));
    }
    let told: Value =
        serde_json::from_str(&done(history(here, place, &["changes", "--json"]))).unwrap();
    let changes = told["changes"].as_array().unwrap();
    assert_eq!(changes.len(), 2, "{told:#}");
    for change in changes {
        assert_eq!(change["cell"], "own n=0");
        assert_eq!(change["before"]["commit"], repository.commits[24]);
        assert_eq!(change["after"]["commit"], repository.commits[25]);
        assert_eq!((&change["runs_before"], &change["runs_after"]), (&25.into(), &15.into()));
        let [low, high] = ["low", "high"].map(|end| change["change"][end].as_f64().unwrap());
        assert!(low < 0.1 && 0.1 < high && high - low < 0.02, "{change}");
        assert_eq!(change["sure"], true);
    }
    let text = done(history(here, place, &["changes", "caustics/trace"]));
    assert!(
        text.contains(&format!(
            "{} → {}",
            &repository.commits[24][..10],
            &repository.commits[25][..10]
        )),
        "{text}"
    );
    let shown =
        done(history(here, place, &["show", "n=0 caustics", "--since", &repository.commits[20]]));
    assert!(shown.contains("20 runs") && shown.contains("n = 7"), "{shown}");
    done(history(here, place, &["show", "--out", "page"]));
    let page = std::fs::read_to_string(here.join("page/index.html")).unwrap();
    for part in [
        "id=\"history\"",
        "own n=0 caustics/trace",
        &repository.commits[25][..10],
        "class=\"change bad\"",
    ] {
        assert!(page.contains(part), "{part}");
    }
    done(history(here, place, &["export", "--otava", "otava"]));
    otava_reads(&here.join("otava"), 40);
    let nothing = history(here, place, &["show", "nowhere"]).output().unwrap();
    refused(&nothing, "nothing in this history fits `nowhere`");
}

/// The configuration names files that are there, and each has the columns that it says.
fn otava_reads(folder: &Path, runs: usize) {
    let text = std::fs::read_to_string(folder.join("otava.yaml")).unwrap();
    let configuration: Value = serde_json::from_str(&text).unwrap();
    let tests = configuration["tests"].as_object().unwrap();
    assert_eq!(tests.len(), CELLS * FIGURES_OF_A_CELL);
    for test in tests.values() {
        let mut reader = csv::Reader::from_path(test["file"].as_str().unwrap()).unwrap();
        assert_eq!(reader.headers().unwrap(), vec!["time", "commit", "value"]);
        let values = reader.records().map(|row| row.unwrap()[2].parse::<f64>().unwrap());
        assert_eq!(values.count(), runs);
    }
}

/// Names that mean something to SQL, terminals and file systems, and NUL.
fn takes_hostile_names_as_text(folder: &Path, place: &str) {
    let repository = Repository::new(&folder.join("hostile"), 1);
    let here = &repository.folder;
    let path = made::folder(here, "run", crate::common::hostile::records().as_bytes())
        .join("records.jsonl");
    let mut records = fathom::record::read_good(&path).unwrap().records;
    let text = |records: &[Record]| -> String {
        records.iter().map(|record| serde_json::to_string(record).unwrap() + "\n").collect()
    };
    assert!(text(&records).contains("\\u0000"));
    std::fs::write(&path, text(&records)).unwrap();
    let sql = "x'); DROP TABLE fathom_run; --\" ../../up \u{1b}[31m";
    done(history(here, place, &["add", "run", "--branch", sql, "--machine", sql]));
    // Commits that git does not know are placed by the start of the run.
    for (second, commit) in [sql, "--output=../x"].into_iter().enumerate() {
        let Record::Run(run) = &mut records[0] else { panic!("{:?}", records[0]) };
        run.started_at = format!("2026-02-03T04:05:0{second}Z");
        let again = text(&records);
        std::fs::write(&path, &again).unwrap();
        let commit = format!("--commit={commit}");
        done(history(here, place, &["add", "run", &commit, "--branch", "b", "--machine", "m"]));
        let stored = runs(here, place);
        assert!(stored.iter().any(|run| got(here, place, run) == again.as_bytes()));
    }
    assert_eq!(runs(here, place).len(), 3);
    let shown = done(history(here, place, &["show"]));
    let hidden = shown.chars().find(|c| c.is_control() && *c != '\n');
    assert_eq!(hidden, None);
    let by_branch = history(here, place, &["show", "--branch", "b' OR '1'='1"]).output().unwrap();
    refused(&by_branch, "nothing in this history fits");
    done(history(here, place, &["show", "--out", "page"]));
    let page = std::fs::read_to_string(here.join("page/index.html")).unwrap();
    assert_eq!(page.matches("<script").count(), 2);
    assert!(HOSTILE.iter().all(|name| !name.starts_with("<script") || !page.contains(name)));
    done(history(here, place, &["export", "--otava", "otava"]));
    let mut names: Vec<String> = std::fs::read_dir(here)
        .unwrap()
        .map(|e| e.unwrap().file_name().into_string().unwrap())
        .collect();
    names.retain(|name| !name.starts_with("history.sqlite"));
    names.sort();
    assert_eq!(names, [".git", "otava", "page", "run"]);
}

/// Kills `history add` after each of some shares of what it writes. A run whose end was not written is not stored, what was stored
/// stays, and what is there is whole.
fn survives_kills(folder: &Path, place: &str, target: &mut dyn Target) {
    const MOMENTS: usize = 30;
    const MANY: usize = 150;
    const FIGURES: i64 = (MANY * FIGURES_OF_A_CELL) as i64;
    let commit = "c".repeat(40);
    let adding = |place: &str, records: &[u8]| {
        let run = made::folder(folder, "run", records);
        history(folder, place, &add(run.to_str().unwrap(), &commit))
    };
    // The first makes the tables.
    for second in [3_000, 3_001] {
        target.add_whole(adding(&target.place(), &made::records(second, MANY, 5e6)));
    }
    let stored = runs(folder, place);
    assert_eq!(stored.len(), 2);
    let sources: Vec<Vec<u8>> =
        (0..MOMENTS).map(|second| made::records(second, MANY, 5e6)).collect();
    for (moment, source) in sources.iter().enumerate() {
        let share = (moment as f64 + 0.5) / MOMENTS as f64;
        target.add_and_kill(adding(&target.place(), source), share);
        assert_eq!(runs(folder, place), stored, "moment {moment}");
        assert_eq!(target.figures(), [(FIGURES, FIGURES); 2], "moment {moment}");
    }
    for source in &sources {
        done(adding(place, source));
    }
    assert_eq!(target.figures(), [(FIGURES, FIGURES); MOMENTS + 2]);
    let stored = runs(folder, place);
    assert!(sources.contains(&got(folder, place, &stored[MOMENTS / 2])));
}

/// A database, and how a program is killed that writes to it.
trait Target {
    /// Where the runs are added that are killed.
    fn place(&self) -> String;
    /// Takes note of how much a command writes.
    fn add_whole(&mut self, command: Command);
    /// Kills a command that would write as much, after this share of it.
    fn add_and_kill(&mut self, command: Command, share: f64);
    /// Figures of each run: how many it should have, and how many there are.
    fn figures(&mut self) -> Vec<(i64, i64)>;
}

const FIGURES: &str =
    "SELECT figures, (SELECT COUNT(*) FROM fathom_figure WHERE run = id) FROM fathom_run";

#[test]
fn a_file_of_sqlite_is_a_history() {
    let folder = tempfile::tempdir().unwrap();
    let place =
        |name: &str| folder.path().join(name).join("history.sqlite").to_str().unwrap().to_owned();
    keeps_runs_whole(folder.path(), &place("whole"));
    tells_machines_apart(folder.path(), &place("machines"));
    names_the_commits_of_a_change(folder.path(), &place("change"));
    takes_hostile_names_as_text(folder.path(), &place("names"));
}

/// A file, its size and by how much a run makes it grow, bytes.
struct SqliteFile {
    path: PathBuf,
    bytes: u64,
    growth: u64,
}

impl Target for SqliteFile {
    fn place(&self) -> String {
        self.path.to_str().unwrap().to_owned()
    }

    fn add_whole(&mut self, command: Command) {
        done(command);
        let bytes = std::fs::metadata(&self.path).unwrap().len();
        (self.growth, self.bytes) = (bytes - self.bytes, bytes);
    }

    /// Neither the file nor its journal can grow beyond the limit. A tenth less than the growth: pages of runs are not filled alike.
    fn add_and_kill(&mut self, command: Command, share: f64) {
        let bytes = share * (self.bytes as f64 + 0.9 * self.growth as f64);
        let killed = crate::common::killed_beyond(bytes as u64 / 512, &command).output().unwrap();
        assert_eq!(killed.status.signal(), Some(Signal::SIGXFSZ as i32), "{share}: {killed:?}");
    }

    fn figures(&mut self) -> Vec<(i64, i64)> {
        let connection = rusqlite::Connection::open(&self.path).unwrap();
        let mut statement = connection.prepare(FIGURES).unwrap();
        let rows = statement.query_map([], |row| Ok((row.get(0)?, row.get(1)?))).unwrap();
        rows.map(Result::unwrap).collect()
    }
}

#[test]
fn a_killed_add_leaves_no_half_run_in_sqlite() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("history.sqlite");
    let mut file = SqliteFile { path, bytes: 0, growth: 0 };
    survives_kills(folder.path(), &file.place(), &mut file);
}

#[test]
fn what_may_hold_a_password_is_neither_shown_nor_a_file() {
    let folder = tempfile::tempdir().unwrap();
    for (place, reason) in [
        ("Postgres://user:secret@h/d", "not understood"),
        (" postgres://user:secret@h/d", "not understood"),
        ("jdbc:postgresql://h/d?password=secret", "not understood"),
        ("mysql://user:secret@h/d", "not understood"),
        #[cfg(not(feature = "postgres"))]
        (
            "postgres://user:secret@localhost/d",
            "build it with `cargo build --release --locked --features postgres`",
        ),
    ] {
        refused_and_not_shown(folder.path(), place, reason);
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

/// The place is refused as an option and as a variable, and its password is not in the message.
#[track_caller]
fn refused_and_not_shown(folder: &Path, place: &str, reason: &str) {
    let as_option = history(folder, place, &["list"]).output().unwrap();
    let mut by_variable = fathom();
    by_variable.current_dir(folder).args(["history", "list"]);
    let by_variable = by_variable.env("FATHOM_HISTORY", place).output().unwrap();
    for output in [as_option, by_variable] {
        refused(&output, reason);
        let told = [output.stdout, output.stderr].concat();
        assert!(!String::from_utf8_lossy(&told).contains("secret"), "{place}");
    }
}

/// Views in the place of tables: one gives rows without end, one looks for them without end.
#[test]
fn views_without_end_end_in_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("history.sqlite");
    let place = path.to_str().unwrap();
    let run = made::folder(folder.path(), "run", &made::records(1, CELLS, 5e6));
    done(history(folder.path(), place, &add(run.to_str().unwrap(), "c")));
    let connection = rusqlite::Connection::open(&path).unwrap();
    connection.execute_batch("DROP TABLE fathom_figure").unwrap();
    for condition in ["1", "x < 0"] {
        let view = format!(
            "DROP VIEW IF EXISTS fathom_figure; CREATE VIEW fathom_figure AS \
             WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c) \
             SELECT x AS series, 1 AS run, 1.0 AS median, NULL AS low, NULL AS high, 1 AS n FROM c WHERE {condition}"
        );
        connection.execute_batch(&view).unwrap();
        let output = history(folder.path(), place, &["show"]).output().unwrap();
        refused(&output, "no history holds so much");
    }
}

#[test]
fn damaged_runs_are_named_and_not_stored() {
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path().join("history.sqlite").to_str().unwrap().to_owned();
    let good = made::records(1, CELLS, 5e6);
    let text = String::from_utf8(good.clone()).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    let cases: [(&str, Vec<u8>, &str); 5] = [
        ("torn", good[..good.len() - 40].to_vec(), "torn off while it was written"),
        ("nothing", b"not json\n".to_vec(), "holds no sound record"),
        ("empty", Vec::new(), "holds no sound record"),
        ("headless", lines[1..].join("\n").into_bytes(), "does not begin with a run's header"),
        ("between", [lines[0], "{\"record\":", lines[1], ""].join("\n").into_bytes(), "line 2"),
    ];
    made::folder(folder.path(), "good", &good);
    for (name, records, reason) in cases {
        let run = made::folder(folder.path(), name, &records);
        let both = ["add", "good", run.to_str().unwrap(), "--commit", "c", "--branch", "b"];
        let told = refused(&history(folder.path(), &place, &both).output().unwrap(), reason);
        assert!(told.contains(name), "{told}");
    }
    let missing = history(folder.path(), &place, &add("nowhere", "c")).output().unwrap();
    refused(&missing, "nowhere holds no run");
    // The good one beside them was not stored either.
    refused(&history(folder.path(), &place, &["list"]).output().unwrap(), "there is no history in");
    let nobody =
        history(folder.path(), &place, &["add", "good"]).env("GIT_DIR", "/nowhere").output();
    refused(&nobody.unwrap(), "of which commit is this run?");
}

#[test]
fn packed_records_are_the_same_run() {
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path().join("history.sqlite").to_str().unwrap().to_owned();
    let records = made::records(1, CELLS, 5e6);
    made::folder(folder.path(), "plain", &records);
    let packed = made::folder(folder.path(), "packed", &records).join("records.jsonl");
    assert!(Command::new("gzip").arg(&packed).status().unwrap().success());
    done(history(folder.path(), &place, &add("packed", "c")));
    let told = done(history(folder.path(), &place, &add("plain", "c")));
    assert!(told.contains("stored already"), "{told}");
    let run = &runs(folder.path(), &place)[0];
    assert_eq!(got(folder.path(), &place, run), records);
}

#[test]
fn other_databases_are_left_as_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let run = made::folder(folder.path(), "run", &made::records(1, CELLS, 5e6));
    let [other, newer, text] =
        ["other.sqlite", "newer.sqlite", "text"].map(|name| folder.path().join(name));
    rusqlite::Connection::open(&other)
        .unwrap()
        .execute_batch("CREATE TABLE notes (t TEXT)")
        .unwrap();
    std::fs::write(&text, "no database at all").unwrap();
    let connection = rusqlite::Connection::open(&newer).unwrap();
    connection
        .execute_batch(
            "CREATE TABLE fathom_history (format BIGINT); INSERT INTO fathom_history VALUES (2)",
        )
        .unwrap();
    drop(connection);
    let damaged = folder.path().join("damaged.sqlite");
    let mut bytes = std::fs::read(&other).unwrap();
    bytes[16..].fill(0xff);
    std::fs::write(&damaged, bytes).unwrap();
    for (path, reason) in [
        (&other, "is the database of another program"),
        (&newer, "has history format 2, but this build reads format 1"),
        (&text, "is no database of SQLite"),
        (&damaged, "damaged.sqlite: "),
        (&folder.path().to_owned(), "is no database of SQLite"),
    ] {
        let before = std::fs::read(path).ok();
        for arguments in [&["changes"][..], &add(run.to_str().unwrap(), "c")] {
            let output =
                history(folder.path(), path.to_str().unwrap(), arguments).output().unwrap();
            refused(&output, reason);
        }
        assert_eq!(std::fs::read(path).ok(), before);
    }
}
