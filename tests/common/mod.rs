//! What tests of the program share: a folder to run it in, what it says, a small run, its records.
#![allow(dead_code, reason = "no test uses all of it")]

pub mod hostile;
pub mod variants;

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::{Duration, Instant};

use fathom::experiments::parse_set;
use fathom::gpu::{Gpu, Options};
use fathom::record::{self, Cell, Measured, Outcome, Record};
use serde_json::Value;
use tempfile::TempDir;

/// The program with these words as arguments, for which no job has a page.
pub fn fathom(words: impl AsRef<str>) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_fathom"));
    command.env_remove("GITHUB_STEP_SUMMARY").args(words.as_ref().split_whitespace());
    command
}

/// A folder of a test's own.
pub struct Place(TempDir);

impl Place {
    pub fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    pub fn path(&self, name: impl AsRef<Path>) -> PathBuf {
        self.0.path().join(name)
    }

    /// Writes a file, in folders that are made where they are not there.
    pub fn write(&self, name: impl AsRef<Path>, content: impl AsRef<[u8]>) -> PathBuf {
        let path = self.path(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, content).unwrap();
        path
    }

    #[track_caller]
    pub fn read(&self, name: impl AsRef<Path>) -> String {
        let path = self.path(name);
        std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
    }

    /// The program in this folder, with these words as arguments.
    pub fn fathom(&self, words: impl AsRef<str>) -> Command {
        let mut command = fathom(words);
        command.current_dir(&self.0);
        command
    }
}

pub fn gpu() -> Gpu {
    Gpu::open(&Options::default())
        .expect("a Vulkan driver: `make test` installs lavapipe where there is none")
}

/// An ignored test of this program, to be run in a process of its own.
pub fn this_program(test: &str) -> Command {
    let mut program = Command::new(std::env::current_exe().unwrap());
    program.args(["--exact", test, "--ignored", "--nocapture"]);
    program
}

/// Git in a folder, as someone.
pub fn git(folder: impl AsRef<Path>) -> Command {
    let mut git = Command::new("git");
    git.args(["-c", "user.name=n", "-c", "user.email=n@example.org", "-c", "commit.gpgsign=false"]);
    git.current_dir(folder);
    git
}

/// Names of what a folder holds, sorted.
pub fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap();
    let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut names: Vec<String> = names.collect();
    names.sort();
    names
}

/// What a command said.
pub struct CommandOutput {
    pub out: String,
    pub err: String,
}

impl CommandOutput {
    /// What a command said that must end by itself with this status, and not by a panic or a signal.
    #[track_caller]
    pub fn check(output: Output, status: i32) -> Self {
        let [out, err] =
            [output.stdout, output.stderr].map(|text| String::from_utf8(text).unwrap());
        assert_eq!(output.status.code(), Some(status), "{out}{err}");
        assert!(!err.contains("panicked"), "{err}");
        Self { out, err }
    }

    /// The only line that begins with `error: `, but for what Mesa's device-select layer prints without a Wayland display, and the
    /// only one that holds `reason`.
    #[track_caller]
    pub fn error(&self, reason: &str) -> &str {
        let of_driver = |line: &str| line.starts_with("error: XDG_RUNTIME_DIR");
        let is_error = |line: &str| line.starts_with("error: ") && !of_driver(line);
        let lines = self.err.lines().filter(|line| is_error(line) || line.contains(reason));
        let lines: Vec<&str> = lines.collect();
        assert_eq!(lines.len(), 1, "{reason}: {}", self.err);
        assert!(lines[0].starts_with("error: "), "{reason}: {}", self.err);
        holds(lines[0], &[reason]);
        lines[0]
    }

    pub fn json(&self) -> Value {
        serde_json::from_str(&self.out).unwrap_or_else(|error| panic!("{error}: {}", self.err))
    }
}

/// Runs a command to its end.
pub trait Ends {
    /// What it says; it must end with this status.
    fn ends(&mut self, status: i32) -> CommandOutput;

    /// Its answer on standard output.
    #[track_caller]
    fn answer(&mut self) -> String {
        self.ends(0).out
    }

    /// Its error, with which it must end, and with no answer.
    #[track_caller]
    fn refused(&mut self, reason: &str) -> String {
        let output = self.ends(2);
        assert_eq!(output.out, "", "{reason}");
        output.error(reason).to_owned()
    }
}

impl Ends for Command {
    #[track_caller]
    fn ends(&mut self, status: i32) -> CommandOutput {
        CommandOutput::check(self.output().unwrap(), status)
    }
}

/// Panics unless a text holds each of these.
#[track_caller]
pub fn holds(text: &str, parts: &[&str]) {
    for part in parts {
        assert!(text.contains(part), "no `{part}` in {text}");
    }
}

/// Ends a wait for what never comes, and decides nothing: the longest takes half a minute.
pub const HANGS: Duration = Duration::from_secs(600);

/// Looks until something holds.
#[track_caller]
pub fn wait_until(what: &str, mut holds: impl FnMut() -> bool) {
    let start = Instant::now();
    while !holds() {
        assert!(start.elapsed() < HANGS, "{what} did not come");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Sends a process a signal by its name.
#[track_caller]
pub fn signal(name: &str, process: u32) {
    let sent = Command::new("kill").args([name, &process.to_string()]).status();
    assert!(sent.unwrap().success());
}

/// How often what depends on chance is tried: once, or as `FATHOM_REPETITIONS` says.
pub fn repetitions() -> u64 {
    let asked = std::env::var("FATHOM_REPETITIONS").ok();
    asked.and_then(|text| text.parse().ok()).unwrap_or(1)
}

/// An array of a dump, in C order.
pub struct Array {
    pub shape: Vec<usize>,
    pub values: Vec<f64>,
}

/// A dump.
pub fn array(path: &Path) -> Array {
    let bytes = std::fs::read(path).unwrap();
    let (header, data) = bytes.split_at(10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]])));
    let header = String::from_utf8_lossy(&header[10..]);
    assert!(header.starts_with("{'descr': '<f4', 'fortran_order': False, 'shape': ("), "{header}");
    let sides = header.split(['(', ')']).nth(1).unwrap().split_terminator(',');
    let shape: Vec<usize> = sides.map(|side| side.trim().parse().unwrap()).collect();
    let (values, rest) = data.as_chunks();
    assert_eq!((values.len(), rest.len()), (shape.iter().product(), 0));
    Array { shape, values: values.iter().map(|v| f32::from_le_bytes(*v).into()).collect() }
}

/// Small enough for a second per run on a software driver.
pub const SMALL: &str = "--set view.width=64 --set view.height=64 --set shadow.size=64 --set surface.cells=16 \
    --set caustics.grid=16 --set godrays.grid=8 --set caustics.buffer=[32,32] --set godrays.buffer=[16,16]";

/// Text of an experiment that nothing compares, of two cells that take a moment.
pub fn own_experiment(number: usize) -> String {
    format!(
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
    )
}

/// A cell of the experiment `own`.
pub fn own_cell(name: &str, outcome: Outcome) -> Cell {
    Cell {
        experiment: "own".to_owned(),
        cell: name.to_owned(),
        pipeline: "underwater".to_owned(),
        scene: "tank".to_owned(),
        outcome,
        ..Cell::default()
    }
}

/// A record of such a cell, which needed no adapter.
pub fn skipped_cell(name: &str) -> Record {
    let outcome = Outcome::Skipped { reason: "too large".to_owned() };
    Record::Cell(Box::new(own_cell(name, outcome)))
}

/// Records of a run of 29 cells on a software driver, stored for tests.
pub fn reference() -> String {
    include_str!("../golden/run/records.jsonl").to_owned()
}

/// The same of the experiments whose names begin so.
pub fn reference_of(experiments: &str) -> Vec<Record> {
    let records = reference();
    let mut records: Vec<Record> =
        records.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    records.retain(|record| match record {
        Record::Cell(cell) => cell.experiment.starts_with(experiments),
        Record::Experiment(definition) => definition.id.starts_with(experiments),
        _ => true,
    });
    records
}

/// The lines of a file of records.
pub fn lines(records: impl IntoIterator<Item = Record>) -> String {
    let records = records.into_iter();
    records.map(|record| serde_json::to_string(&record).unwrap() + "\n").collect()
}

/// Writes a folder's records.
pub fn write_records(folder: &Path, records: &[Record]) {
    std::fs::create_dir_all(folder).unwrap();
    std::fs::write(folder.join("records.jsonl"), lines(records.to_vec())).unwrap();
}

/// Parameters as the command line takes them, with spaces between.
pub fn sets(text: &str) -> Vec<(String, Value)> {
    text.split_whitespace().map(|set| parse_set(set).unwrap()).collect()
}

/// The records of a run's folder, of which none is damaged.
#[track_caller]
pub fn records(out: &Path) -> Vec<Record> {
    let reading = record::read(&out.join("records.jsonl")).unwrap();
    assert_eq!(reading.damaged.count(), 0);
    reading.records
}

#[track_caller]
pub fn cells(out: &Path) -> Vec<Cell> {
    records(out).into_iter().filter_map(|record| Some(*record.try_as_cell()?)).collect()
}

#[track_caller]
pub fn measured(cell: &Cell) -> &Measured {
    cell.measured().unwrap_or_else(|| panic!("{:?}", cell.outcome))
}

/// The same command, which can write no file beyond so many blocks of 512 bytes. So it fails at a moment that rests on no clock.
pub fn failing_beyond(blocks: u64, command: &Command) -> Command {
    let mut shell = Command::new("sh");
    shell.args(["-c", &format!("ulimit -f {blocks}; exec \"$0\" \"$@\"")]);
    shell.arg(command.get_program()).args(command.get_args());
    for (name, value) in command.get_envs() {
        match value {
            Some(value) => shell.env(name, value),
            None => shell.env_remove(name),
        };
    }
    shell.current_dir(command.get_current_dir().unwrap_or(Path::new(".")));
    shell
}
