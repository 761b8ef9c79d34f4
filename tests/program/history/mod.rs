//! `fathom history` from the command line.
#![cfg(target_os = "linux")]

mod made;

use std::path::Path;
use std::process::Command;

use crate::common::{Ends, Place, fathom, git, holds};
use made::{CELLS, FIGURES_OF_A_CELL, Repository, records, with_limit};
use serde_json::Value;

/// What a job of continuous integration says to `fathom history`.
const OF_A_JOB: [&str; 5] =
    ["GITHUB_SHA", "GITHUB_REF_NAME", "CI_COMMIT_SHA", "CI_COMMIT_REF_NAME", "FATHOM_HISTORY"];

/// `fathom history` with these words in a folder, over a database, without the variables of a job.
fn history(folder: &Path, db: &str, words: impl AsRef<str>) -> Command {
    let mut command = fathom(format!("history {} --db", words.as_ref()));
    command.arg(db).current_dir(folder);
    for name in OF_A_JOB {
        command.env_remove(name);
    }
    command
}

fn add(folder: &str, commit: &str) -> String {
    format!("add {folder} --commit {commit} --branch main --machine m")
}

/// Names of the stored runs, in their order.
fn runs(folder: &Path, db: &str) -> Vec<String> {
    let listed = history(folder, db, "list").answer();
    listed.lines().skip(1).map(|line| line.split(' ').next().unwrap().to_owned()).collect()
}

/// What changed, as JSON.
fn changes(folder: &Path, db: &str) -> Value {
    history(folder, db, "changes --json").ends(0).json()
}

#[test]
fn runs_are_kept_once_in_the_order_of_their_commits() {
    let (place, db) = (Place::new(), "../history.sqlite");
    let repository = Repository::new(place.path("repository"), [5, 3]);
    let here = &repository.folder;
    let history = |words: &str| history(here, db, words);
    let records = [records(1, CELLS, 5e6), records(2, CELLS, 5e6)];
    place.write("first/records.jsonl", &records[0]);
    place.write("second/records.jsonl", &records[1]);
    // The later commit first, which has the earlier date: the order is that of the commits.
    let output = history("add ../second --machine m").answer();
    let figures = CELLS * FIGURES_OF_A_CELL;
    let stored = format!("{CELLS} cells with {figures} figures stored");
    holds(&output, &[&stored, &repository.commits[1], "on main"]);
    history("add ../first --commit HEAD~1").ends(0);
    let stored = runs(here, db);
    let listed = history("list").answer();
    let [first, second] =
        [&repository.commits[0], &repository.commits[1]].map(|c| listed.find(&c[..10]).unwrap());
    assert!(first < second && stored.len() == 2, "{listed}");
    git(here).args(["clone", "--quiet", "--no-local", "--depth=1", ".", "shallow"]).ends(0);
    let listed = self::history(&here.join("shallow"), "../../history.sqlite", "list").answer();
    holds(&listed, &["Not in the order of commits: 1 runs stand by date"]);
    // Again, and as another commit's.
    holds(&history("add ../second").answer(), &["stored already, nothing changed"]);
    let output = history("add ../first").refused("is stored already, as one of commit");
    holds(&output, &[&repository.commits[0]]);
    assert_eq!(runs(here, db), stored);
}

/// A shard that another machine measured than the night before begins new series.
#[test]
fn machines_are_told_apart() {
    let (place, db) = (Place::new(), "../history.sqlite");
    let repository = Repository::new(place.path("machines"), 0..3);
    let here = &repository.folder;
    let run = "machines/run/records.jsonl";
    let nights = [["n1", "n2"], ["n1", "n2"], ["n2", "n1"]];
    let series = || changes(here, db)["too_short"].as_u64().unwrap() as usize / FIGURES_OF_A_CELL;
    let mut counted = Vec::new();
    for (night, (hosts, commit)) in nights.iter().zip(&repository.commits).enumerate() {
        place.write(run, made::merged(night, hosts));
        history(here, db, format!("add run --commit {commit}")).ends(0);
        counted.push(series());
    }
    assert_eq!(counted, [2, 2, 4]);
    holds(&history(here, db, "list").answer(), &[" n1, n2 ", " n2, n1 "]);
    // What was said goes before what the records name.
    place.write(run, made::merged(nights.len(), &["n3", "n4"]));
    history(here, db, "add run --machine farm").ends(0);
    assert_eq!(series(), 6);
    holds(&history(here, db, "list").answer(), &[" farm "]);
}

/// Forty days, cell 0 slower by 10 % from day 25 on.
#[test]
fn the_commits_of_a_change_are_named() {
    let (place, db) = (Place::new(), "../history.sqlite");
    let Repository { folder: here, commits } = &Repository::new(place.path("days"), 0..40);
    for (day, commit) in commits.iter().enumerate() {
        let ns = if day >= 25 { 5.5e6 } else { 5e6 };
        place.write("days/run/records.jsonl", records(day, CELLS, ns));
        history(here, db, add("run", commit)).ends(0);
    }
    let output = changes(here, db);
    let changes = output["changes"].as_array().unwrap();
    assert_eq!(changes.len(), 2, "{output:#}");
    for change in changes {
        assert_eq!(change["cell"], "own n=0");
        assert_eq!(change["before"]["commit"], commits[24]);
        assert_eq!(change["after"]["commit"], commits[25]);
        assert_eq!((&change["runs_before"], &change["runs_after"]), (&25.into(), &15.into()));
        let [low, high] = ["low", "high"].map(|end| change["change"][end].as_f64().unwrap());
        assert!(low < 0.1 && 0.1 < high && high - low < 0.02, "{change}");
        assert_eq!(change["sure"], true);
    }
    let [before, after] = [24, 25].map(|day| &commits[day][..10]);
    let text = history(here, db, "changes caustics/trace").answer();
    holds(&text, &[&format!("{before} → {after}")]);
    let since = format!("show --out page --since {}", commits[20]);
    history(here, db, since).arg("n=0 caustics").ends(0);
    let page = std::fs::read_to_string(here.join("page/index.html")).unwrap();
    holds(&page, &["20 runs", "n = 7"]);
    history(here, db, "show --out page").ends(0);
    let page = std::fs::read_to_string(here.join("page/index.html")).unwrap();
    let parts = ["id=\"history\"", "own n=0 caustics/trace", after, "class=\"chip bad\""];
    holds(&page, &parts);
    history(here, db, "show nowhere --out x").refused("nothing in this history fits `nowhere`");
}

#[test]
fn the_records_say_of_which_commit_they_are() {
    let (place, db) = (Place::new(), "../history.sqlite");
    let Repository { folder: here, commits } = &Repository::new(place.path("here"), 0..2);
    let history = |words: &str| history(here, db, words);
    let of = |commit: &str| {
        let build = format!(r#""build":{{"commit":"{commit}","dirty":true}},"started_at":"#);
        records(1, CELLS, 5e6).replace("\"started_at\":", &build)
    };
    place.write("two/records.jsonl", of("c0ffee") + &of(&commits[0]));
    place.write("other/records.jsonl", of("c0ffee"));
    place.write("dirty/records.jsonl", of(&commits[0]));
    history("add ../two").refused("was measured by several builds");
    history("add ../other").refused("of which branch is this run?");
    history("add ../dirty --commit HEAD").refused("leave out --commit");
    let mut of_a_job = history("add ../dirty --commit HEAD~1");
    let stored = of_a_job.env("GITHUB_SHA", &commits[1]).answer();
    holds(&stored, &[&format!("{}-dirty on main", commits[0])]);
    holds(&history("list").answer(), &[&format!(" {}-dirty ", &commits[0][..10])]);
}

const FIGURES: &str =
    "SELECT figures, (SELECT COUNT(*) FROM fathom_figure WHERE run = id) FROM fathom_run";

/// `history add` finds the disk full after each of some shares of what it writes. A run whose end was not written is not stored, what
/// was stored stays, and what is there is whole.
#[test]
fn a_full_disk_leaves_no_half_run() {
    const MOMENTS: usize = 5;
    const MANY: usize = 150;
    const OF_A_RUN: i64 = (MANY * FIGURES_OF_A_CELL) as i64;
    let place = Place::new();
    let (folder, db) = (place.path(""), "history.sqlite");
    let adding = |records: &str| {
        place.write("run/records.jsonl", records);
        history(&folder, db, add("run", "c0ffee"))
    };
    let bytes = || std::fs::metadata(place.path(db)).unwrap().len() as f64;
    let mut sizes = Vec::new();
    // The first makes the tables.
    for second in [3_000, 3_001] {
        adding(&records(second, MANY, 5e6)).ends(0);
        sizes.push(bytes());
    }
    let stored = runs(&folder, db);
    let sources: Vec<String> = (0..MOMENTS).map(|second| records(second, MANY, 5e6)).collect();
    for (moment, source) in sources.iter().enumerate() {
        // Neither the file nor its journal can grow beyond the limit. A tenth less than the growth: pages of runs are not filled alike.
        let share = (moment as f64 + 0.5) / MOMENTS as f64;
        let limit = share * (sizes[1] + 0.9 * (sizes[1] - sizes[0]));
        crate::common::failing_beyond(limit as u64 / 512, &adding(source)).ends(2);
        assert_eq!(runs(&folder, db), stored, "moment {moment}");
        assert_eq!(figures(&place.path(db)), [(OF_A_RUN, OF_A_RUN); 2], "moment {moment}");
    }
    for source in &sources {
        adding(source).ends(0);
    }
    assert_eq!(figures(&place.path(db)), [(OF_A_RUN, OF_A_RUN); MOMENTS + 2]);
}

/// Figures of each run: how many it should have, and how many there are.
fn figures(path: &Path) -> Vec<(i64, i64)> {
    let connection = rusqlite::Connection::open(path).unwrap();
    let mut statement = connection.prepare(FIGURES).unwrap();
    let rows = statement.query_map([], |row| Ok((row.get(0)?, row.get(1)?))).unwrap();
    rows.map(Result::unwrap).collect()
}

/// Where the tests below keep a history, and a run of few cells.
fn sqlite() -> (Place, impl Fn(&str) -> Command) {
    let place = Place::new();
    place.write("run/records.jsonl", records(1, CELLS, 5e6));
    let folder = place.path("");
    (place, move |words| history(&folder, "history.sqlite", words))
}

#[test]
fn damaged_runs_are_named_and_not_stored() {
    let (place, history) = sqlite();
    let good = place.read("run/records.jsonl");
    let lines: Vec<&str> = good.lines().collect();
    for (name, records, reason) in [
        ("torn", good[..good.len() - 40].to_owned(), "torn off while it was written"),
        ("nothing", "not json\n".to_owned(), "holds no sound record"),
        ("empty", String::new(), "holds no sound record"),
        ("headless", lines[1..].join("\n"), "does not begin with a run's header"),
        ("between", [lines[0], "{\"record\":", lines[1], ""].join("\n"), "line 2"),
    ] {
        place.write(format!("{name}/records.jsonl"), records);
        let both = format!("add run {name} --commit c0ffee --branch b");
        holds(&history(&both).refused(reason), &[name]);
    }
    history(&add("nowhere", "c0ffee")).refused("nowhere holds no run");
    // The good one beside them was not stored either.
    history("list").refused("there is no history in");
    history("add run").env("GIT_DIR", "/nowhere").refused("of which commit is this run?");
}

#[test]
fn packed_records_are_the_same_run() {
    let (place, history) = sqlite();
    let records = place.read("run/records.jsonl");
    let packed = place.write("packed/records.jsonl", &records);
    assert!(Command::new("gzip").arg(packed).status().unwrap().success());
    history(&add("packed", "c0ffee")).ends(0);
    holds(&history(&add("run", "c0ffee")).answer(), &["stored already"]);
}

#[test]
fn other_databases_are_left_as_they_are() {
    let (place, _) = sqlite();
    let tables = |name: &str, statements: &str| {
        let connection = rusqlite::Connection::open(place.path(name)).unwrap();
        connection.execute_batch(statements).unwrap();
    };
    tables("other.sqlite", "CREATE TABLE notes (t TEXT)");
    let made = |format: i32, other: &str| {
        let table = "CREATE TABLE fathom_history (format INTEGER NOT NULL)";
        format!("{table}; INSERT INTO fathom_history VALUES ({format}); {other}")
    };
    tables("newer.sqlite", &made(9, ""));
    // Reading these would not end, or would take gigabytes.
    let endless = "WITH RECURSIVE n(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM n) SELECT x FROM n";
    tables("view.sqlite", &made(2, &format!("CREATE VIEW Fathom_Run AS {endless}")));
    tables("virtual.sqlite", &made(2, "CREATE VIRTUAL TABLE fathom_run USING fts4 (id)"));
    let computed = "CREATE TABLE fathom_run (digest, id AS (hex(zeroblob(900000000))))";
    tables("computed.sqlite", &made(2, computed));
    let trigger = "CREATE TRIGGER t AFTER INSERT ON fathom_history BEGIN";
    let trigger = format!("{trigger} DELETE FROM fathom_history WHERE format IN ({endless}); END");
    tables("trigger.sqlite", &made(2, &trigger));
    place.write("text", "no database at all");
    let mut bytes = std::fs::read(place.path("other.sqlite")).unwrap();
    bytes[16..].fill(0xff);
    place.write("damaged.sqlite", bytes);
    for (db, reason) in [
        ("other.sqlite", "is the database of another program"),
        ("newer.sqlite", "has history format 9, but this build reads format 2"),
        ("view.sqlite", "`Fathom_Run` in it was not made by this build"),
        ("virtual.sqlite", "`fathom_run` in it was not made by this build"),
        ("computed.sqlite", "`fathom_run` in it was not made by this build"),
        ("trigger.sqlite", "`t` in it was not made by this build"),
        ("text", "file is not a database"),
        ("damaged.sqlite", "damaged.sqlite: "),
        (".", "is no regular file"),
    ] {
        let before = std::fs::read(place.path(db)).ok();
        for words in ["changes", &add("run", "c0ffee")] {
            history(&place.path(""), db, words).refused(reason);
        }
        assert_eq!(std::fs::read(place.path(db)).ok(), before);
    }
}

/// From the records of each night to what is told: the machine is slower from the 12th night on, and the program makes cell 0 slower in
/// the same night. `history::findings` has the law.
#[test]
fn what_the_limits_of_the_adapter_share_is_drift_of_the_machine() {
    let place = Place::new();
    let history = |words: &str| history(&place.path(""), "h.sqlite", words);
    for night in 0..24 {
        let slower = if night < 12 { 1.0 } else { 1.1 };
        let own = if night < 12 { 1.0 } else { 1.5 };
        let rate = 1e10 / slower * (1.0 + 1e-3 * (night % 5) as f64);
        let records = records(night, CELLS, 5e6 * slower * own);
        place.write("run/records.jsonl", with_limit(&records, rate));
        history(&add("run", &format!("{night:040}"))).ends(0);
    }
    let of = |told: &Value, cell: &str| -> Vec<Value> {
        let all = told["changes"].as_array().unwrap().iter();
        all.filter(|change| change["cell"] == cell && change["unit"] == "ns").cloned().collect()
    };
    // Cell 0 did more than the machine: what is left is its own.
    let own = of(&history("changes --json").ends(0).json(), "own n=0");
    assert_eq!(own.len(), 2, "{own:?}");
    for change in &own {
        let size = change["change"]["value"].as_f64().unwrap();
        assert!((size - 0.5).abs() < 0.01 && change["sure"] == true, "{change}");
        assert!((change["machine"].as_f64().unwrap() - 0.1).abs() < 0.01, "{change}");
    }
    holds(&history("changes").answer(), &["+50", "without +10.0 % of drift"]);
    // A stage that never changes as the control: the change is as it is.
    let output = history("changes --json --control n=1").ends(0).json();
    let size = of(&output, "own n=0")[0]["change"]["value"].as_f64().unwrap();
    assert!((size - 0.65).abs() < 0.01, "{output}");
    history("changes --control nothing").refused("no time in this history is a control `nothing`");
}
