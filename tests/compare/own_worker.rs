//! Programs that are not fathom as workers: `examples/own_worker`.

use std::path::{Path, PathBuf};
use std::process::Command;

use fathom::record::schema::LineKind;
use itertools::Itertools as _;
use serde_json::{Value, json};

use super::common::{Ends, Place, Told, holds, names};

fn example() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/own_worker")
}

/// A comparison of the example with itself, by the work that it counts.
fn compared(place: &Place, head: &str) -> Command {
    let worker = format!("python3 '{}'", example().join("worker.py").display());
    let mut command = place.fathom("compare --launches 10 --pairs 2 --out out --cells-file");
    command.arg(example().join("cells.toml"));
    command.args(["--base-cmd", &format!("{worker} --counted")]);
    command.args(["--head-cmd", &format!("{worker} {head}")]);
    command
}

#[test]
fn a_program_of_another_language_is_compared_by_its_times_alone() {
    let place = Place::new();
    let Told { out, .. } = compared(&place, "--counted").ends(0);
    holds(&out, &["no regression", "2 same", "knows no such gate"]);
    let place = Place::new();
    let Told { out, .. } = compared(&place, "--counted --turns 1.05").ends(1);
    holds(&out, &["regression", "2 slower", "+5.0 %"]);
}

/// What both sides hear and say in a whole comparison, one object per request or reply.
fn exchange(place: &Place) -> Vec<Value> {
    let mut compare = place.fathom("compare --launches 2 --pairs 2 --out out --cells-file");
    compare.arg(example().join("cells.toml"));
    let worker = example().join("worker.py");
    // Workers that run at once have files of their own.
    let heard = format!("tee heard.$$ | python3 '{}' --counted | tee said.$$", worker.display());
    // Two launches are too few for a verdict.
    compare.args(["--base-cmd", &heard, "--head-cmd", &heard]).ends(3);
    let lines = |of: &str| -> Vec<Value> {
        let files = names(&place.path("")).into_iter().filter(|name| name.starts_with(of));
        // The last line of a worker that was killed may be cut short.
        let whole = |line: &&str| line.ends_with('\n');
        let parsed = |line: &str| serde_json::from_str(line).unwrap();
        files
            .flat_map(|name| {
                place.read(name).split_inclusive('\n').filter(whole).map(parsed).collect_vec()
            })
            .collect()
    };
    let heard = lines("heard").into_iter().map(|request| json!({ "request": request }));
    let quit = json!({ "message": "quit" });
    heard
        .chain(lines("said").into_iter().map(|reply| json!({ "request": quit, "reply": reply })))
        .collect()
}

#[test]
fn what_the_example_hears_and_says_is_as_the_schema_has_it() {
    let schema = jsonschema::draft202012::new(&LineKind::Worker.schema()).unwrap();
    let exchange = exchange(&Place::new());
    for message in ["hello", "prepare", "sample", "quit"] {
        assert!(exchange.iter().any(|line| line["request"]["message"] == message), "{message}");
    }
    assert!(exchange.iter().any(|line| line["reply"]["message"] == "sample"));
    for line in &exchange {
        schema.validate(line).unwrap_or_else(|error| panic!("{error}: {line}"));
    }
}

/// A worker of another language that has one exact figure has no errors, counters, checks or instructions.
#[test]
fn what_a_program_lacks_is_told_and_fails_nothing() {
    let exact = r#"{"message":"exact","stages":[{"name":"sum","work":{},"counters":{}}],"allocated_bytes":8,"errors":{},"quantities":{},"notes":[]}"#;
    let worker = example().join("worker.py");
    let parts = r#"s/"parts": \["time"\]/"parts": ["time","exact","instructions"]/"#;
    let instead = format!(r#"s/^{{"message": "unsupported", "request": "exact"}}$/{exact}/"#);
    let command =
        format!("python3 '{}' --counted | sed -u -e '{parts}' -e '{instead}'", worker.display());
    let place = Place::new();
    let mut compare = place.fathom("compare --launches 10 --pairs 2 --out out --cells-file");
    compare.arg(example().join("cells.toml")).args([
        "--base-cmd",
        &command,
        "--head-cmd",
        &command,
    ]);
    let told = [
        "no regression",
        "2 same",
        "exact gate: ",
        "instructions gate skipped: callgrind would count the shell that starts a command",
        "the base build knows no checks: none are compared",
    ];
    holds(&compare.ends(0).out, &told);
    holds(&place.read("out/summary.md"), &told[3..]);
    holds(&place.read("out/junit.xml"), &["skipped"]);
    // Without that figure a summary tells of two gates.
    let place = Place::new();
    compared(&place, "--counted").ends(0);
    let told = ["exact", "instructions"]
        .map(|gate| format!("{gate} gate skipped: the base build knows no such gate"));
    holds(&place.read("out/summary.md"), &told.each_ref().map(String::as_str));
}
