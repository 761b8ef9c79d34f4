//! Programs that are not fathom as workers: `examples/own_worker`.

use std::path::{Path, PathBuf};
use std::process::Command;

use fathom::record::schema::LineKind;
use serde_json::{Value, json};

use super::common::{Ends, Place, Told, holds};

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
    let heard = format!("tee -a heard | python3 '{}' --counted | tee -a said", worker.display());
    // Two launches are too few for a verdict.
    compare.args(["--base-cmd", &heard, "--head-cmd", &heard]).ends(3);
    let lines = |name: &str| -> Vec<Value> {
        place.read(name).lines().map(|line| serde_json::from_str(line).unwrap()).collect()
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

#[test]
fn a_command_that_is_no_worker_is_told_in_one_line() {
    let other = r#"read -r line; echo '{"message":"hello","protocol":7}'; read -r line"#;
    for (command, reason) in
        [("true", "it ended with"), ("read -r line; echo fish", "garbage"), (other, "version 7")]
    {
        let place = Place::new();
        let mut compare = place.fathom("compare --launches 2 --out out --cells-file");
        compare.arg(example().join("cells.toml"));
        let Told { err, .. } = compare.args(["--base-cmd", command, "--head-cmd", command]).ends(2);
        assert!(err.contains(reason), "{command}: {err}");
        assert_eq!(err.lines().count(), 1, "{err}");
    }
}
