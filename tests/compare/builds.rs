//! The whole of `fathom compare` between builds that are scripts, so that each can fail in its own way.

use std::fs;
use std::io::{BufRead, BufReader};
use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::{Child, Command, Output, Stdio};

use fathom::compare::store::Comparison;
use fathom::compare::verdict::{CellVerdict, Status, Verdicts};
use fathom::record::comparison::Gate;
use fathom::record::{Measured, Record};

use super::common::{CommandOutput, Ends, Place, holds, reference_of, wait_until, write_records};
use super::script::{Script, hello, refusal};
use super::stored::cell;

pub const CELLS: &str = r#"
id = "toy"
title = "t"
source = "s"
pipeline = "p"
scene = "s"
stages = ["a", "b"]
control = "one a"
[[sweep]]
id = "one"
[[sweep]]
id = "two"
"#;

/// A folder with builds, the cells to compare and what comes of it.
pub struct Builds(Place);

/// A command in the background, and the lines that it tells.
pub fn spawned(command: &mut Command) -> (Child, impl Iterator<Item = String> + use<>) {
    let mut child = command.stderr(Stdio::piped()).stdout(Stdio::null()).spawn().unwrap();
    let lines = BufReader::new(child.stderr.take().unwrap()).lines();
    (child, lines.map_while(Result::ok))
}

impl Builds {
    /// The builds `base` and `head`.
    pub fn new(base: &Script<'_>, head: &Script<'_>) -> Self {
        let builds = Self::without_builds();
        builds.build("base", base);
        builds.build("head", head);
        builds
    }

    pub fn without_builds() -> Self {
        let builds = Self(Place::new());
        builds.0.write("cells.toml", CELLS);
        builds
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path(name)
    }

    pub fn build(&self, name: &str, build: &Script<'_>) {
        build.write(&self.path(""), name);
    }

    /// A comparison of these two.
    pub fn between(&self, base: &str, head: &str) -> Command {
        let mut command = self.0.fathom("compare --gates exact,time --launches 10 --pairs 2");
        command.args(["--cells-file", "cells.toml", "--out", "out", "--base-bin"]);
        command.arg(self.path(base)).arg("--head-bin").arg(self.path(head));
        command
    }

    pub fn command(&self, options: &str) -> Command {
        let mut command = self.between("base", "head");
        command.args(options.split_whitespace());
        command
    }

    /// A command of the shell that waits until [`Self::release`], or until the folder is gone.
    pub fn waits(&self) -> String {
        let folder = self.path("");
        let folder = folder.display();
        format!("while [ -d '{folder}' ] && [ ! -e '{folder}/released' ]; do sleep 0.05; done")
    }

    pub fn release(&self) {
        self.0.write("released", "");
    }

    pub fn stored(&self) -> Comparison {
        Comparison::read(&self.path("out")).unwrap()
    }

    /// What the builds print and store; the comparison must end with this status.
    #[track_caller]
    fn compare(&self, status: i32) -> (String, Comparison) {
        let output = self.command("").ends(status);
        (output.out, self.stored())
    }
}

fn verdict(stored: &Comparison, cell: &str) -> CellVerdict {
    let cells = Verdicts::judge(stored).cells;
    let found = cells.iter().find(|found| found.cell.as_str() == cell);
    found.unwrap().verdict
}

/// Two equal programs ask the GPU for the same: no gate measures it, and declared work is compared.
#[test]
fn what_is_unchanged_is_not_measured() {
    let place = Place::new();
    let mut compare = place.fathom("compare --out out --cells voxel/alpha");
    let output = compare.args(["--base-bin", env!("CARGO_BIN_EXE_fathom")]).ends(0);
    assert!(output.out.contains("2 unchanged"), "{}", output.out);
    let stored = Comparison::read(&place.path("out")).unwrap();
    assert_eq!(verdict(&stored, "alpha voxel/alpha"), CellVerdict::Unchanged);
    assert_eq!((stored.exact.len(), stored.instructions.len(), stored.pairs.len()), (2, 0, 0));
    assert!(stored.header.notes.is_empty(), "{stored:?}");
    assert_ne!(stored.exact[0].work, fathom::record::Work::default());
}

/// Where a disk is full a trace is cut: what cannot be told is measured. A file may hold 4 KiB here.
#[cfg(unix)]
#[test]
fn what_has_no_whole_trace_is_measured() {
    let place = Place::new();
    let full = "trap '' XFSZ; ulimit -f 8; exec";
    let start = format!("{full} '{}' worker", env!("CARGO_BIN_EXE_fathom"));
    let mut compare = place.fathom("compare --out out --gates exact --cells voxel/alpha");
    let output = compare.args(["--base-cmd", &start, "--head-cmd", &start]).ends(0);
    let stored = Comparison::read(&place.path("out")).unwrap();
    assert_eq!(verdict(&stored, "alpha voxel/alpha"), CellVerdict::Same, "{}", output.out);
    assert!(stored.unchanged.iter().all(|line| line.cells.is_empty() && line.reason.is_some()));
    holds(&output.out, &["alpha: all is measured: no fingerprint: "]);
}

/// A real gate on the default adapter over one cell.
#[test]
fn equal_builds_execute_equally_many_instructions() {
    let (place, name) = (Place::new(), "alpha voxel/alpha");
    let mut compare = place.fathom("compare --all --gates instructions --out out --cells");
    compare.arg(name).args(["--base-bin", env!("CARGO_BIN_EXE_fathom")]);
    let output = compare.env("GITHUB_STEP_SUMMARY", place.path("page.md")).ends(0);
    let skipped = output.out.contains("instructions gate skipped");
    assert!(!skipped, "`scripts/setup.sh` installs valgrind: {}", output.out);
    holds(&place.read("page.md"), &["no regression"]);
    let comparison = Comparison::read(&place.path("out")).unwrap();
    let ratio = fathom::judge::counts::judge(&comparison)[&cell(name)].ratio;
    let threshold = comparison.header.settings.instruction_threshold;
    assert!((ratio - 1.0).abs() < threshold, "{ratio}");
    // What the stage leaves behind, triangles in a queue, must not make its next frame longer. What else the process does falls into
    // some frames, and not into each more than into the one before.
    for line in &comparison.instructions {
        let counts: Vec<f64> = line.counts.iter().map(|count| *count as f64).collect();
        let grows = |counts: &[f64]| counts.windows(2).all(|pair| pair[1] > 1.01 * pair[0]);
        assert!(counts.len() >= 3 && !grows(&counts), "{counts:?}");
        assert!(grows(&[1.0, 1.02, 1.04]));
    }
    assert_eq!(comparison.instructions.len(), 2);
}

#[test]
fn equal_builds_are_the_same_and_unequal_ones_are_not() {
    let usual = Script::default();
    let (told, stored) = Builds::new(&usual, &usual).compare(0);
    holds(&told, &["no regression; 4 cells: 4 same"]);
    // No more of a path than its last part goes into records.
    assert_eq!((&*stored.header.base.label, &*stored.header.head.label), ("base", "head"));

    let other = Script { bytes: 1001, error: "0.02", ns: 150, ..Script::default() };
    let builds = Builds::new(&usual, &other);
    let (told, stored) = builds.compare(1);
    assert_eq!(verdict(&stored, "one a"), CellVerdict::Faster);
    holds(&told, &["one: allocated_bytes", "one: an_error 0.0100 → 0.0200"]);
    holds(&builds.0.read("out/junit.xml"), &["type=\"less accurate\""]);
}

#[test]
fn bases_that_cannot_be_asked_are_told_apart() {
    let later = "echo '{\"message\":\"hello\",\"protocol\":2,\"adapters\":[]}'";
    let none = "echo \"error: unrecognized subcommand 'worker'\" >&2; exit 2";
    for (greeting, reason) in [
        (&*hello(9, ""), "version 9 of the worker protocol, this build version 1"),
        (&hello(0, "\"time\""), "version 0 of the worker protocol, this build version 1"),
        (later, "version 2 of the worker protocol, this build version 1"),
        ("echo Hello", "answered garbage to `hello`: `Hello`"),
        (none, "exit status: 2: error: unrecognized subcommand 'worker'"),
    ] {
        let base = Script { hello: greeting.to_owned(), ..Script::default() };
        let error = Builds::new(&base, &Script::default()).command("").ends(2);
        let error = error.error(reason);
        assert!(error.starts_with("error: the base build: "), "{error}");
    }
}

/// A gate is skipped, and cells are new. What else a side may lack or fail at, and what that costs, is tested in `fathom_compare::{exact_gate, launches}`.
#[test]
fn what_the_base_does_not_know_is_told() {
    let absent = refusal("unknown pipeline", true);
    let instead = &[("\"id\":\"two\"", absent.as_str())];
    let base = Script { hello: hello(1, "\"time\""), instead, ..Script::default() };
    let (told, stored) = Builds::new(&base, &Script::default()).compare(0);
    holds(&told, &["exact gate skipped: the base build knows no such gate"]);
    let verdicts = ["one a", "one b", "two a", "two b"].map(|cell| verdict(&stored, cell));
    use CellVerdict::{New, Same};
    assert_eq!(verdicts, [Same, Same, New, New]);
}

/// What each fault costs is tested in `fathom_compare::rounds`.
#[test]
fn what_a_worker_does_wrong_is_told_in_a_line() {
    let refused = refusal("too hot", false);
    for (message, answer, reason) in [
        ("sample", "echo fish", "it answered garbage to `sample`: `fish`"),
        (
            "sample",
            "echo '{\"message\":\"sample\",\"ns\":[-1]}'",
            "it answered garbage to `sample`",
        ),
        ("sample", &refused, "too hot"),
        ("sample", "exit 3", "it ended with exit status: 3"),
        (
            "exact",
            "echo '{\"message\":\"prepared\",\"stages\":[]}'",
            "it answered garbage to `exact`",
        ),
    ] {
        let pattern = format!("\"{message}\"");
        let head = Script { instead: &[(&pattern, answer)], ..Script::default() };
        let (_, stored) = Builds::new(&Script::default(), &head).compare(2);
        let mut reasons = stored.faults.iter().map(|fault| &fault.reason).peekable();
        assert!(reasons.peek().is_some(), "{reason}");
        reasons.for_each(|found| holds(found, &[reason]));
    }
}

/// A head waits before its greeting when it was started so often. It is started twice before the launches, once in each, and twice more in
/// each second one for the control.
const AT_LAUNCH_5: usize = 2 + 5 + 4;

/// A comparison in a process group of its own, after three launches; the fifth cannot begin before [`Builds::release`].
fn begun() -> (Builds, Child, impl Iterator<Item = String>) {
    let builds = Builds::without_builds();
    let (log, greeting) = (builds.path("starts"), Script::default().hello);
    let waits = format!(
        "echo >> '{log}'; [ $(wc -l < '{log}') -lt {AT_LAUNCH_5} ] || {{ {}; }}; {greeting}",
        builds.waits(),
        log = log.display()
    );
    builds.build("base", &Script::default());
    builds.build("head", &Script { hello: waits, ..Script::default() });
    let (child, mut told) = spawned(builds.command("").process_group(0));
    told.find(|line| line.contains("3 of 4 launches")).unwrap();
    (builds, child, told)
}

#[test]
fn ctrl_c_in_a_terminal_costs_no_cell() {
    let (builds, mut child, told) = begun();
    let group = format!("-{}", child.id());
    let sent = Command::new("kill").args(["-INT", "--", &group]).status();
    assert!(sent.unwrap().success());
    // What it says in the end must not block it.
    told.for_each(drop);
    assert_eq!(child.wait().unwrap().code(), Some(130));
    let stored = builds.stored();
    assert!(stored.faults.is_empty(), "{:?}", stored.faults);
}

#[test]
fn a_killed_comparison_goes_on_where_it_ended() {
    let (builds, mut child, _told) = begun();
    child.kill().unwrap();
    child.wait().unwrap();

    let stored = builds.stored();
    let before = stored.launches.len();
    assert!((3..10).contains(&before) && stored.end.is_none(), "{before}");
    builds.release();
    // A worker that the kill met at its start holds the folder until it sees that nobody is there.
    let mut tries = std::iter::repeat_with(|| builds.command("").output().unwrap());
    let held = |output: &Output| String::from_utf8_lossy(&output.stderr).contains("is in use by");
    CommandOutput::check(tries.find(|output| !held(output)).unwrap(), 2).error("--resume");
    builds.command("--seed 7 --resume").refused("`seed` was ");
    let changed = CELLS.replace("id = \"one\"", "id = \"one\"\nparams.turns = 2");
    builds.0.write("cells.toml", changed);
    let named = "`cells.one.configuration.params.turns` was absent and is now 2";
    builds.command("--resume").refused(named);
    builds.0.write("cells.toml", CELLS);

    builds.command("--resume").ends(0);
    let stored = builds.stored();
    assert_eq!(stored.launches.len(), 10);
    assert_eq!(stored.exact.len(), 2 * 4, "exact figures are not asked for again");
    assert_eq!(Verdicts::judge(&stored).status, Status::NoRegression);
    assert_eq!(stored.header.settings.gates, [Gate::Exact, Gate::Time]);
}

/// Workers that hang have started others, which ignore what a terminal sends.
#[test]
fn nothing_is_left_of_a_comparison_that_is_killed() {
    let builds = Builds::without_builds();
    let log = builds.path("started");
    let start = format!("trap '' HUP INT TERM; sleep 3600 & echo $! >> '{}'", log.display());
    let hangs = format!(
        "for n in 1 2 3 4 5 6 7 8 9; do {start}; done; echo $$ >> '{}'; wait",
        log.display()
    );
    builds.build("base", &Script::default());
    builds.build("head", &Script { instead: &[("\"prepare\"", &hangs)], ..Script::default() });
    let (mut child, _told) = spawned(&mut builds.command(""));
    let started = || fs::read_to_string(&log).unwrap_or_default();
    wait_until("the head's worker", || started().lines().count() == 10);
    child.kill().unwrap();
    child.wait().unwrap();
    let is_left = |process: &str| {
        let stat = fs::read_to_string(format!("/proc/{process}/stat"));
        stat.is_ok_and(|stat| !stat.contains(") Z "))
    };
    wait_until("the end of all", || !started().lines().any(is_left));
}

#[test]
fn each_side_has_its_own_environment_and_the_control_has_one_sides() {
    let builds = Builds::without_builds();
    let (log, greeting) = (builds.path("log"), Script::default().hello);
    // Writes down the variable `MARK` whenever it is greeted.
    let hello = format!(
        r#"echo "hello $MARK${{MESA_SHADER_CACHE_DIR:+, shaders apart}}" >> '{}'; {greeting}"#,
        log.display()
    );
    builds.build("both", &Script { hello, ..Script::default() });
    let given = |options: &[&str]| {
        let mut command = builds.between("both", "both");
        command.env_remove("MARK").env_remove("MESA_SHADER_CACHE_DIR").args(options);
        command
    };
    let output = given(&["--base-env", "MARK=of base"]).answer();
    holds(output.lines().next().unwrap(), &["(0) with MARK → "]);
    let log = builds.0.read("log");
    let count = |line: &str| log.lines().filter(|found| *found == line).count();
    // Survey, first look of the time gate and ten launches; two workers of one side more in each launch for the control.
    let counted = (count("hello of base, shaders apart"), count("hello "));
    assert_eq!(counted, (2 + 10 + 10, 2 + 10 + 10), "{log}");

    let stored = builds.stored();
    assert_eq!(stored.header.base.environment.variables["MARK"], None);
    assert!(stored.header.head.environment.is_empty() && stored.header.base_adapter.is_none());
    assert_eq!(builds.0.fathom("compare --replay out").answer(), output);
    given(&["--base-env", "MARK=another", "--resume"]).refused("base.environment.values_digest");
    given(&["--base-env", "MARK=of base", "--resume"]).ends(0);
}

/// A build whose adapter is named by the variable `NAME`.
#[test]
fn sides_on_different_adapters_are_told_only_where_they_were_given_different_things() {
    let named = |name: &str| {
        let hello = hello(1, r#""exact","checks","time""#).replace("\"toy\"", "\"'$NAME'\"");
        Script { hello, ns: if name == "slow" { 300 } else { 200 }, ..Script::default() }
    };
    let builds = Builds::new(&named(""), &named("slow"));
    let output = builds.command("--base-env NAME=one --head-env NAME=two --env-values").ends(4).out;
    holds(
        &output,
        &["times not judged; 4 cells: 4 not judged", "+50.0 % (50.0 … 50.0), different adapters"],
    );
    assert_eq!(output.lines().nth(1), Some("one → two"));
    assert!(output.lines().next().unwrap().ends_with(" with NAME=two"), "{output}");

    let hello = hello(1, "\"time\"").replace("\"toy\"", "\"another\"");
    let builds = Builds::new(&Script::default(), &Script { hello, ..Script::default() });
    let reason = "the sides run on different adapters: the base on toy";
    builds.command("").ends(2).error(reason);
}

#[test]
fn files_of_records_are_judged_by_what_is_exact() {
    let place = Place::new();
    let mut base = reference_of("uw-default");
    base.retain(|record| record.try_as_cell_ref().is_none_or(|cell| cell.cell == "base"));
    write_records(&place.path("base"), &base);
    // The base against itself with a change; what is printed.
    let compare = |name: &str, status: i32, change: &dyn Fn(&mut Record)| {
        let mut records = base.clone();
        records.iter_mut().for_each(change);
        write_records(&place.path(name), &records);
        let output = place.fathom(format!("compare base/records.jsonl {name}")).ends(status);
        output.out + &output.err
    };
    let of_cell = |change: fn(&mut Measured)| {
        move |record: &mut Record| {
            record.try_as_cell_mut().and_then(|cell| cell.measured_mut()).map(change);
        }
    };
    let output = compare("same", 4, &|_| ());
    let first = "times not judged (status 4): exact figures of 1 cell: same; times of 1 cell not judged: two runs share no pairs\n";
    assert!(output.starts_with(first), "{output}");
    let exact = "compare base/records.jsonl same/records.jsonl --gates exact";
    holds(&place.fathom(exact).ends(0).out, &["no regression (status 0): exact figures"]);

    compare("costlier", 1, &of_cell(|measured| measured.allocated_bytes += 1));
    let other = compare("other", 2, &|record| {
        if let Some(cell) = record.try_as_cell_mut() {
            cell.scene = "port".to_owned();
        }
    });
    holds(&other, &["no measured cell in common"]);
}
