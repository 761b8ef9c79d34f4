//! What tests of the program share: the command, a small run, its records, its errors.
#![allow(dead_code, reason = "no test uses all of it")]

pub mod hostile;

use std::path::Path;
use std::process::{Command, Output};
use std::sync::OnceLock;

use fathom::experiments::parse_set;
use fathom::npy;
use fathom::record::schema::LineKind;
use fathom::record::{self, Cell, Measured, Record};
use jsonschema::Validator;
use serde_json::Value;

/// The program, for which no job has a page.
pub fn fathom() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_fathom"));
    command.env_remove("GITHUB_STEP_SUMMARY");
    command
}

/// A dump.
pub fn array(path: &Path) -> npy::Array {
    npy::read(std::fs::File::open(path).unwrap(), usize::MAX).unwrap()
}

/// Small enough for a second per run on a software driver.
pub fn small() -> impl Iterator<Item = &'static str> {
    let sets = [
        "view.width=64",
        "view.height=64",
        "shadow.size=64",
        "surface.cells=16",
        "caustics.grid=16",
        "godrays.grid=8",
        "caustics.buffer=[32,32]",
        "godrays.buffer=[16,16]",
    ];
    sets.into_iter().flat_map(|set| ["--set", set])
}

/// Files of experiments that nothing compares, each of two cells that take a moment.
pub fn experiment_files(folder: &Path, count: usize) -> Vec<String> {
    let file = |number: usize| {
        let text = format!(
            r#"
            id = "own-{number}"
            title = "Own"
            source = "none"
            pipeline = "underwater"
            scene = "tank"
            params = {{ view = {{ width = 64, height = 64 }}, shadow.size = 64, caustics = {{ grid = 16, buffer = [32, 32] }}, godrays = {{ grid = 8, buffer = [16, 16] }} }}
            [[sweep]]
            [[sweep.axis]]
            name = "surface.cells"
            values = [16, {}]
            "#,
            17 + number
        );
        let path = folder.join(format!("own-{number}.toml"));
        std::fs::write(&path, text).unwrap();
        path.display().to_string()
    };
    (1..=count).map(file).collect()
}

/// Parameters as the command line takes them, with spaces between.
pub fn sets(text: &str) -> Vec<(String, Value)> {
    text.split_whitespace().map(|set| parse_set(set).unwrap()).collect()
}

/// The records of a run's folder, of which none is damaged and all are as the schema has them.
#[track_caller]
pub fn records(out: &Path) -> Vec<Record> {
    let path = out.join("records.jsonl");
    let reading = record::read(&path).unwrap();
    assert_eq!(reading.damaged.count(), 0);
    follow_the_schema(&path);
    reading.records
}

/// Every line of a file of records is as `fathom schema` says.
#[track_caller]
pub fn follow_the_schema(path: &Path) {
    static RECORD: OnceLock<Validator> = OnceLock::new();
    let schema = || jsonschema::draft202012::new(&LineKind::Record.schema()).unwrap();
    for line in std::fs::read_to_string(path).unwrap().lines() {
        let line: Value = serde_json::from_str(line).unwrap();
        if let Err(error) = RECORD.get_or_init(schema).validate(&line) {
            panic!("{error} at {}: {line}", error.instance_path());
        }
    }
}

#[track_caller]
pub fn cells(out: &Path) -> Vec<Cell> {
    let cell = |record| match record {
        Record::Cell(cell) => Some(*cell),
        _ => None,
    };
    records(out).into_iter().filter_map(cell).collect()
}

#[track_caller]
pub fn measured(cell: &Cell) -> &Measured {
    cell.measured().unwrap_or_else(|| panic!("{:?}", cell.outcome))
}

/// The same command, which the system kills with SIGXFSZ when it writes to a file beyond so many blocks of 512 bytes. So it dies at
/// a moment that rests on no clock.
pub fn killed_beyond(blocks: u64, command: &Command) -> Command {
    let mut limited = Command::new("sh");
    limited.args(["-c", "ulimit -c 0; ulimit -f \"$0\"; exec \"$@\""]).arg(blocks.to_string());
    limited.arg(command.get_program()).args(command.get_args());
    for (name, value) in command.get_envs() {
        match value {
            Some(value) => limited.env(name, value),
            None => limited.env_remove(name),
        };
    }
    if let Some(folder) = command.get_current_dir() {
        limited.current_dir(folder);
    }
    limited
}

/// What a command says on standard error, which must end with this status.
#[track_caller]
pub fn stderr(output: &Output, status: i32) -> String {
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(status), "{text}");
    text
}

/// The error of a command that must end with status 2: the only line that begins with `error: `, but for what Mesa's
/// device-select layer prints without a Wayland display, and the only one that holds `reason`.
#[track_caller]
pub fn refused(output: &Output, reason: &str) -> String {
    let told = stderr(output, 2);
    let of_driver = |line: &str| line.starts_with("error: XDG_RUNTIME_DIR");
    let is_error = |line: &str| line.starts_with("error: ") && !of_driver(line);
    let lines: Vec<&str> =
        told.lines().filter(|line| is_error(line) || line.contains(reason)).collect();
    assert_eq!(lines.len(), 1, "{reason}: {told}");
    assert!(lines[0].starts_with("error: ") && lines[0].contains(reason), "{reason}: {told}");
    lines[0].to_owned()
}
