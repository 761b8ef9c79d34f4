//! Programs that are not fathom as workers: `examples/own_worker`.

use std::path::{Path, PathBuf};
use std::process::Command;

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
