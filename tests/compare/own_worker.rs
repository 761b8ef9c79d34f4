//! Programs that are not fathom as workers: `examples/own_worker`.

use std::path::{Path, PathBuf};

use super::common::{Ends, Place, holds};

fn example() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/own_worker")
}

#[test]
fn a_command_whose_program_was_replaced_is_not_resumed() {
    let place = Place::new();
    let script = std::fs::read_to_string(example().join("worker.py")).unwrap();
    place.write("worker.py", &script);
    let mut compare = place.fathom("compare --gates time --launches 1 --pairs 1 --out out");
    compare.arg("--cells-file").arg(example().join("cells.toml"));
    let worker = "python3 worker.py --counted";
    compare.args(["--base-cmd", worker, "--head-cmd", worker]).ends(3);
    compare.arg("--resume");
    place.write("worker.py", script.clone() + "# Another.\n");
    compare.refused("`base.program` was ");
    place.write("worker.py", script);
    compare.ends(3);
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
    compare.arg(example().join("cells.toml"));
    compare.args(["--base-cmd", &command, "--head-cmd", &command]);
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
}
