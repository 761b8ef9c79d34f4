//! The whole of `fathom compare` between builds that are scripts, so that each can fail in its own way.

use std::fs;
use std::io::{BufRead, BufReader};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use fathom::compare::store::StoredComparison;
use fathom::compare::verdict::{CellVerdict, Status, Verdicts};
use fathom::record::comparison::Gate;
use fathom::record::{self, Measured, Outcome, Record};

use super::common::{fathom, refused, small, stderr};
use super::script::{Script, hello, refusal};

const CELLS: &str = r#"
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
pub struct Builds {
    folder: tempfile::TempDir,
}

impl Builds {
    pub fn new() -> Self {
        let builds = Self { folder: tempfile::tempdir().unwrap() };
        fs::write(builds.path("cells.toml"), CELLS).unwrap();
        builds
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub fn build(&self, name: &str, build: &Script<'_>) -> PathBuf {
        build.write(self.folder.path(), name)
    }

    pub fn command(&self, base: &Path, head: &Path) -> Command {
        let mut command = fathom();
        command
            .args(["compare", "--gates", "exact,time", "--launches", "10"])
            .args(["--pairs", "2", "--cells-file"])
            .arg(self.path("cells.toml"))
            .arg("--base-bin")
            .arg(base)
            .arg("--head-bin")
            .arg(head)
            .arg("--out")
            .arg(self.path("out"));
        command
    }

    /// A command of the shell that waits until [`Self::release`], or until the folder is gone.
    pub fn waits(&self) -> String {
        let folder = self.folder.path().display();
        format!("while [ -d '{folder}' ] && [ ! -e '{folder}/released' ]; do sleep 0.05; done")
    }

    pub fn release(&self) {
        fs::write(self.path("released"), "").unwrap();
    }

    pub fn hold(&self) {
        fs::remove_file(self.path("released")).ok();
    }

    /// What two builds print and store, and the exit status.
    fn compare(&self, base: &Script<'_>, head: &Script<'_>) -> (String, StoredComparison, i32) {
        let (base, head) = (self.build("base", base), self.build("head", head));
        let output = self.command(&base, &head).output().unwrap();
        let stored = StoredComparison::read(&self.path("out"));
        let stored = stored.unwrap_or_else(|error| panic!("{error}: {output:?}"));
        (String::from_utf8(output.stdout).unwrap(), stored, output.status.code().unwrap())
    }

    #[track_caller]
    fn refused(&self, base: &Script<'_>, reason: &str) {
        let base = self.build("base", base);
        let head = self.build("head", &Script::default());
        let error = refused(&self.command(&base, &head).output().unwrap(), reason);
        assert!(error.starts_with("error: the base build: "), "{error}");
    }
}

fn verdict(stored: &StoredComparison, cell: &str) -> CellVerdict {
    let cells = Verdicts::of(stored).cells;
    let found = cells.iter().find(|found| found.cell.as_str() == cell);
    found.unwrap().verdict
}

#[test]
fn equal_builds_are_the_same_and_unequal_ones_are_not() {
    let builds = Builds::new();
    let (told, stored, status) = builds.compare(&Script::default(), &Script::default());
    assert_eq!(status, 0, "{told}");
    assert!(told.contains("no regression; 4 cells: 4 same"), "{told}");
    // No more of a path than its last part goes into records.
    assert_eq!((&*stored.header.base.label, &*stored.header.head.label), ("base", "head"));

    let builds = Builds::new();
    let other = Script { bytes: 1001, error: 0.02, ns: 1_500_000, ..Script::default() };
    let (told, stored, status) = builds.compare(&Script::default(), &other);
    assert_eq!(status, 1);
    assert_eq!(verdict(&stored, "one a"), CellVerdict::Faster);
    assert!(told.contains("one: allocated_bytes"), "{told}");
    assert!(told.contains("one: an_error 0.0100 → 0.0200"), "{told}");
    let junit = fs::read_to_string(builds.path("out/junit.xml")).unwrap();
    assert!(junit.contains("type=\"less accurate\""), "{junit}");
}

#[test]
fn bases_that_cannot_be_asked_are_told_apart() {
    let builds = Builds::new();
    let says = |hello: String| Script { hello, ..Script::default() };
    builds.refused(&says(hello(9, "")), "version 9 of the worker protocol, this build version 1");
    builds.refused(&says("echo Hello".to_owned()), "answered garbage to `hello`: `Hello`");
    builds.refused(
        &says("echo \"error: unrecognized subcommand 'worker'\" >&2; exit 2".to_owned()),
        "unrecognized subcommand 'worker'",
    );
}

#[test]
fn a_base_that_lacks_a_part_skips_that_gate_and_says_so() {
    let base = Script { hello: hello(1, "\"time\""), ..Script::default() };
    let (told, _, status) = Builds::new().compare(&base, &Script::default());
    assert_eq!(status, 0, "{told}");
    assert!(told.contains("exact gate skipped: the base build knows no such gate"), "{told}");
}

#[test]
fn only_what_the_base_alone_does_not_know_is_new() {
    let absent = refusal("unknown pipeline", true);
    let failure = refusal("out of memory", false);
    for (name, of_base, of_head, status, expected) in [
        ("new in the head", Some(&absent[..]), None, 0, CellVerdict::New),
        ("gone in the head", None, Some(&absent[..]), 2, CellVerdict::Failed),
        ("the base fails", Some(&failure), None, 2, CellVerdict::Failed),
        ("the head dies", Some(&absent), Some("exit 3"), 2, CellVerdict::Failed),
    ] {
        let [base, head] = [of_base, of_head]
            .map(|does| Vec::from_iter(does.map(|does| ("\"id\":\"two\"", does))));
        let script = |instead| Script { instead, ..Script::default() };
        let (told, stored, found) = Builds::new().compare(&script(&base), &script(&head));
        assert_eq!(found, status, "{name}: {told}");
        for (cell, verdict_of_cell) in [
            ("two a", expected),
            ("two b", expected),
            ("one a", CellVerdict::Same),
            ("one b", CellVerdict::Same),
        ] {
            assert_eq!(verdict(&stored, cell), verdict_of_cell, "{name}: {cell}");
        }
    }
}

#[test]
fn an_error_that_is_no_number_is_a_figure_like_any_other() {
    let null = "echo '{\"message\":\"exact\",\"stages\":[{\"name\":\"a\",\"work\":{},\"counters\":{}},{\"name\":\"b\",\"work\":{},\"counters\":{}}],\
                \"allocated_bytes\":1,\"errors\":{\"an_error\":null},\"quantities\":{},\"notes\":[]}'";
    let head = Script { instead: &[("\"exact\"", null)], ..Script::default() };
    let (told, stored, _) = Builds::new().compare(&Script::default(), &head);
    assert!(stored.faults.is_empty(), "{told}");
}

#[test]
fn a_head_that_dies_or_lies_costs_the_cells_that_it_does_so_at() {
    for (pattern, badly, reason) in [
        ("\"id\":\"two\"", "kill -SEGV $$", "signal: 11"),
        ("\"stage\":\"b\"", "exit 3", "exit status: 3"),
        ("\"stage\":\"b\"", "echo '{\"message\":\"sample\",\"ns\":[-1]}'", "garbage"),
        ("\"stage\":\"b\"", "echo nonsense", "garbage"),
    ] {
        let head = Script { instead: &[(pattern, badly)], ..Script::default() };
        let (told, stored, status) = Builds::new().compare(&Script::default(), &head);
        assert_eq!(status, 2, "{badly}: {told}");
        assert_eq!(verdict(&stored, "two b"), CellVerdict::Failed, "{badly}: {told}");
        assert_eq!(verdict(&stored, "one a"), CellVerdict::Same, "{badly}: {told}");
        assert!(told.contains(reason), "{badly}: {told}");
    }
}

/// A greeting before which a build waits when it was started so often. It is started twice before the launches, and once in each.
const AT_LAUNCH_5: usize = 2 + 5;

fn waits_at_launch_5(builds: &Builds) -> Script<'static> {
    let (log, greeting) = (builds.path("starts"), Script::default().hello);
    let waits = format!(
        "echo >> '{log}'; [ $(wc -l < '{log}') -lt {AT_LAUNCH_5} ] || {{ {}; }}; {greeting}",
        builds.waits(),
        log = log.display()
    );
    Script { hello: waits, ..Script::default() }
}

#[test]
fn ctrl_c_in_a_terminal_costs_no_cell() {
    let builds = Builds::new();
    let base = builds.build("base", &Script::default());
    let head = builds.build("head", &waits_at_launch_5(&builds));
    let mut child = builds
        .command(&base, &head)
        .process_group(0)
        .stderr(Stdio::piped())
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    let mut told = BufReader::new(child.stderr.take().unwrap()).lines();
    told.by_ref().map_while(Result::ok).find(|line| line.contains("3 of 10 launches")).unwrap();
    let group = format!("-{}", child.id());
    // The fifth launch cannot have begun.
    let sent = Command::new("kill").args(["-INT", "--", &group]).status();
    assert!(sent.unwrap().success());
    // What it says in the end must not block it.
    told.map_while(Result::ok).for_each(drop);
    assert_eq!(child.wait().unwrap().code(), Some(130));
    let stored = StoredComparison::read(&builds.path("out")).unwrap();
    assert!(stored.faults.is_empty(), "{:?}", stored.faults);
    builds.release();
    let mut resumed = builds.command(&base, &head);
    let resumed = resumed.arg("--resume").output().unwrap();
    assert_eq!(resumed.status.code(), Some(0), "{resumed:?}");
    let stored = StoredComparison::read(&builds.path("out")).unwrap();
    assert_eq!(stored.launches.len(), 10);
    assert_eq!(verdict(&stored, "two b"), CellVerdict::Same);
}

#[test]
fn a_killed_comparison_goes_on_where_it_ended() {
    let builds = Builds::new();
    let base = builds.build("base", &Script::default());
    let head = builds.build("head", &waits_at_launch_5(&builds));
    let mut child =
        builds.command(&base, &head).stderr(Stdio::piped()).stdout(Stdio::null()).spawn().unwrap();
    let told = BufReader::new(child.stderr.take().unwrap());
    let third = told.lines().map_while(Result::ok).find(|line| line.contains("3 of 10 launches"));
    assert!(third.is_some());
    child.kill().unwrap();
    child.wait().unwrap();

    let stored = StoredComparison::read(&builds.path("out")).unwrap();
    let before = stored.launches.len();
    assert!((3..10).contains(&before) && stored.end.is_none(), "{before}");
    builds.release();
    // A worker that the kill met at its start holds the folder until it sees that nobody is there.
    let again = || builds.command(&base, &head).output().unwrap();
    let mut tries = std::iter::repeat_with(again);
    let held = |output: &Output| String::from_utf8_lossy(&output.stderr).contains("is in use by");
    refused(&tries.find(|output| !held(output)).unwrap(), "--resume");
    let other = builds.build("other", &Script { bytes: 7, ..Script::default() });
    let another = builds.command(&base, &other).arg("--resume").output().unwrap();
    refused(&another, "was begun with another head");

    let resumed = builds.command(&base, &head).arg("--resume").output().unwrap();
    assert_eq!(resumed.status.code(), Some(0), "{resumed:?}");
    let stored = StoredComparison::read(&builds.path("out")).unwrap();
    assert_eq!(stored.launches.len(), 10);
    assert_eq!(stored.exact.len(), 2 * 4, "exact figures are not asked for again");
    assert_eq!(Verdicts::of(&stored).status, Status::NoRegression);
    assert_eq!(stored.header.settings.gates, [Gate::Exact, Gate::Time]);
}

/// A build that writes down the variable `MARK` whenever it is greeted or sampled.
fn marking(log: &Path) -> Script<'static> {
    let greeting = hello(1, r#""exact","checks","time""#);
    let hello = format!(
        r#"echo "hello $MARK${{MESA_SHADER_CACHE_DIR:+, shaders apart}}" >> '{}'; {greeting}"#,
        log.display()
    );
    Script { hello, ..Script::default() }
}

#[test]
fn each_side_has_its_own_environment_and_the_control_has_the_bases() {
    let builds = Builds::new();
    let log = builds.path("log");
    let program = builds.build("both", &marking(&log));
    let given = |arguments: &[&str]| {
        let mut command = builds.command(&program, &program);
        command.env_remove("MARK").env_remove("MESA_SHADER_CACHE_DIR").args(arguments);
        command
    };
    let output = given(&["--base-env", "MARK=of base"]).output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let told = String::from_utf8(output.stdout).unwrap();
    assert!(told.lines().next().unwrap().contains("(0) with MARK → "), "{told}");
    let log = fs::read_to_string(&log).unwrap();
    let count = |line: &str| log.lines().filter(|found| *found == line).count();
    // Survey, first look of the time gate and ten launches; two of the base's workers more in each launch for the control.
    assert_eq!(
        (count("hello of base, shaders apart"), count("hello ")),
        (2 + 3 * 10, 2 + 10),
        "{log}"
    );

    let stored = StoredComparison::read(&builds.path("out")).unwrap();
    assert_eq!(stored.header.base.environment.variables["MARK"], None);
    for file in fs::read_dir(builds.path("out")).unwrap().flatten().map(|entry| entry.path()) {
        let written = fs::read(&file).unwrap();
        assert!(!String::from_utf8_lossy(&written).contains("of base"), "{}", file.display());
    }
    assert!(stored.header.head.environment.is_empty() && stored.header.base_adapter.is_none());
    let again = fathom().args(["compare", "--replay"]).arg(builds.path("out")).output().unwrap();
    assert_eq!(String::from_utf8(again.stdout).unwrap(), told);
    for other in [&["--base-env", "MARK=another"][..], &["--head-env", "MARK=of base"]] {
        let resumed = given(other).arg("--resume").output().unwrap();
        refused(&resumed, "was begun with another environment or driver of the base");
    }
    let more = ["--base-env", "MARK=of base", "--head-env", "MARK=x", "--resume"];
    refused(&given(&more).output().unwrap(), "another environment or driver of the head");
    let same = given(&["--base-env", "MARK=of base", "--resume"]).output().unwrap();
    assert_eq!(same.status.code(), Some(0), "{same:?}");
}

/// A build whose adapter is named by the variable `NAME`.
#[test]
fn sides_on_different_adapters_are_told_only_where_they_were_given_different_things() {
    let named = |name: &str| {
        let hello = hello(1, r#""exact","checks","time""#).replace("\"toy\"", "\"'$NAME'\"");
        Script {
            hello,
            ns: if name == "slow" { 3_000_000 } else { 2_000_000 },
            ..Script::default()
        }
    };
    let builds = Builds::new();
    let (base, head) = (builds.build("base", &named("")), builds.build("head", &named("slow")));
    let mut command = builds.command(&base, &head);
    let output = command.args(["--base-env", "NAME=one", "--head-env", "NAME=two", "--env-values"]);
    let output = output.output().unwrap();
    let told = String::from_utf8(output.stdout).unwrap();
    assert_eq!(output.status.code(), Some(0), "{told}");
    assert!(told.contains("no regression; 4 cells: 4 not judged"), "{told}");
    assert!(told.contains("+50.0 % (50.0 … 50.0), different adapters"), "{told}");
    assert_eq!(told.lines().nth(1), Some("one → two"));
    assert!(told.lines().next().unwrap().ends_with(" with NAME=two"), "{told}");

    let builds = Builds::new();
    let other = hello(1, "\"time\"").replace("\"toy\"", "\"another\"");
    let base = builds.build("base", &Script::default());
    let head = builds.build("head", &Script { hello: other, ..Script::default() });
    let output = builds.command(&base, &head).output().unwrap();
    refused(&output, "the sides run on different adapters: the base on toy");
}

#[test]
fn environments_and_drivers_that_cannot_be_had_are_refused_before_anything_is_measured() {
    let builds = Builds::new();
    let library = builds.path("library.so");
    fs::write(&library, "no library").unwrap();
    let manifest = builds.path("icd.json");
    fs::write(&manifest, r#"{"ICD": {"library_path": "./library.so"}}"#).unwrap();
    let manifest = manifest.to_str().unwrap();
    for (arguments, reason) in [
        (&["--base-env", "A"][..], "give NAME=VALUE"),
        (&["--head-env", "LP_NUM_THREADS=2"], "LP_NUM_THREADS is fathom's own"),
        (&["--head-env", "VK_ICD_FILENAMES=x"], "give --head-driver"),
        (&["--head-driver", "/no/such.json"], "--head-driver /no/such.json: No such file"),
        (&["--base-driver", manifest], "it gives no Vulkan adapter here, as"),
        (&[], "nothing to compare with"),
    ] {
        let mut command = fathom();
        command.args(["compare", "--cells", "compose", "--out"]).arg(builds.path("out"));
        refused(&command.args(arguments).output().unwrap(), reason);
        assert!(!builds.path("out").exists(), "{arguments:?}");
    }
}

#[test]
fn files_of_records_are_judged_by_what_is_exact() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    let mut measure = fathom();
    measure
        .args(["run", "uw-default", "--no-ceilings", "--budget", "1", "--out"])
        .arg(&run)
        .args(small());
    stderr(&measure.output().unwrap(), 0);
    let base = run.join("records.jsonl");
    let changed = |name: &str, change: &dyn Fn(&mut Record)| {
        let path = folder.path().join(name);
        let mut writer = record::Writer::create(&path).unwrap();
        for mut record in record::read(&base).unwrap().records {
            change(&mut record);
            writer.write(&record).unwrap();
        }
        path
    };
    let compare = |head: &Path, status: i32| {
        let out = head.with_extension("out");
        let output = fathom().arg("compare").args([&base, head]).arg("--out").arg(out).output();
        let output = output.unwrap();
        assert_eq!(output.status.code(), Some(status), "{output:?}");
        [output.stdout, output.stderr].map(|text| String::from_utf8(text).unwrap())
    };
    let [told, _] = compare(&base, 0);
    assert!(told.contains("times are unpaired") && told.contains("+0.0 %, unpaired"), "{told}");
    let same = base.with_extension("out");
    let again = fathom().args(["compare", "--replay"]).arg(same).output().unwrap();
    assert_eq!(String::from_utf8(again.stdout).unwrap(), told);

    let remeasured = |name: &str, change: &dyn Fn(&mut Measured)| {
        changed(name, &|record| {
            if let Record::Cell(cell) = record
                && let Outcome::Measured(measured) = &mut cell.outcome
            {
                change(measured);
            }
        })
    };
    let slower = remeasured("slower.jsonl", &|measured| {
        let stages = measured.stages.iter_mut();
        stages.flat_map(|stage| &mut stage.samples_ns).for_each(|ns| *ns *= 1.5);
    });
    // Unpaired times raise no alarm.
    let [told, _] = compare(&slower, 0);
    assert!(told.contains("+50.0 %, unpaired"), "{told}");

    compare(&remeasured("costlier.jsonl", &|measured| measured.allocated_bytes += 1), 1);

    let elsewhere = changed("elsewhere.jsonl", &|record| {
        if let Record::Run(run) = record {
            run.adapter.driver_info = "another driver".to_owned();
        }
    });
    let [told, _] = compare(&elsewhere, 0);
    assert!(told.contains("time gate skipped: times of different adapters or drivers"), "{told}");

    let other = changed("other.jsonl", &|record| {
        if let Record::Cell(cell) = record {
            cell.scene = "port".to_owned();
        }
    });
    let [_, told] = compare(&other, 2);
    assert!(told.contains("no measured cell in common"), "{told}");
}
