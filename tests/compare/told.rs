//! `fathom compare` on comparisons that were stored before: nothing here opens a device. What is told of them is held
//! against files in `tests/golden/compare`, which `FATHOM_BLESS=1 cargo test --test compare` writes anew.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use fathom::compare::store::{self, StoredComparison};
use fathom::harness::output::{Kind, Taken};
use fathom::record::ErrorFigure;
use fathom::record::comparison::{
    CellId, CheckFigure, Compared, ComparedBuild, ComparisonEnd, ComparisonHeader,
    ConfigurationFigures, ExactFigures, Fault, Gate, GateSettings, InstructionCounts, Launch, Pair,
    Side, Skip,
};
use fathom::record::{Adapter, Work};
use predicates::str::contains;

use super::fathom;

const LAUNCHES: u32 = 10;
const PAIRS: u32 = 2;
const BASE_NS: f64 = 2e6;

fn cell(name: &str) -> CellId {
    let (configuration, stage) = name.split_once(' ').unwrap();
    CellId::new(configuration, stage)
}

fn build(label: &str) -> ComparedBuild {
    ComparedBuild {
        label: label.to_owned(),
        version: "0.1.0".to_owned(),
        protocol: Some(1),
        digest: format!("digest of {label}"),
    }
}

/// A stored comparison under construction.
struct Stored {
    header: ComparisonHeader,
    lines: Vec<Compared>,
    /// How measuring ended: interrupted or not; none if it was killed.
    interrupted: Option<bool>,
}

impl Stored {
    fn new(cells: &[&str]) -> Self {
        let header = ComparisonHeader {
            base: build("origin/main"),
            head: build("target/release/fathom"),
            adapter: Adapter {
                name: "llvmpipe (LLVM 15.0.6, 256 bits)".to_owned(),
                driver_info: "Mesa 22.3.6".to_owned(),
                software: true,
                ..Adapter::default()
            },
            settings: GateSettings { launches: LAUNCHES, pairs: PAIRS, ..GateSettings::default() },
            cells: cells.iter().map(|name| cell(name)).collect(),
            ..ComparisonHeader::default()
        };
        let launches = (0..LAUNCHES).map(|launch| {
            Compared::Launch(Launch {
                launch,
                wall_s: 3.5,
                second: false,
                core: Some(0),
                notes: Vec::new(),
            })
        });
        Self { header, lines: launches.collect(), interrupted: Some(false) }
            .configuration(1_000_000, 0.01)
            .times(cells[0], true, 1.0, 0.004)
    }

    fn configuration(mut self, head_bytes: u64, head_error: f64) -> Self {
        self.lines.retain(|line| !matches!(line, Compared::Configuration(_)));
        for (side, allocated_bytes, error) in
            [(Side::Base, 1_000_000, 0.01), (Side::Head, head_bytes, head_error)]
        {
            self.lines.push(Compared::Configuration(ConfigurationFigures {
                side,
                configuration: "tank".to_owned(),
                allocated_bytes,
                errors: BTreeMap::from([("caustics_photon_error_median_m".to_owned(), error)]),
                judged: vec![ErrorFigure::new(
                    "caustics_photon_error_median_m",
                    error,
                    "m",
                    "caustics/trace",
                )],
                quantities: BTreeMap::new(),
                notes: Vec::new(),
            }));
        }
        self
    }

    /// Pairs whose ratio is `ratio` up to `spread` between launches, which lies evenly about it.
    fn times(mut self, name: &str, control: bool, ratio: f64, spread: f64) -> Self {
        for launch in 0..LAUNCHES {
            let place = f64::from(launch) / f64::from(LAUNCHES - 1) - 0.5;
            for round in 0..PAIRS {
                self.lines.push(Compared::Pair(Pair {
                    launch,
                    round,
                    cell: cell(name),
                    control,
                    second: false,
                    first: if round % 2 == 0 { Side::Base } else { Side::Head },
                    base_ns: BASE_NS,
                    head_ns: BASE_NS * ratio * (1.0 + 2.0 * spread * place),
                }));
            }
        }
        self
    }

    /// Launches of a second measurement, with pairs of the control and of a cell.
    fn second(self, name: &str, ratio: f64, spread: f64, launches: u32) -> Self {
        let first = self.lines.len();
        let mut all =
            self.times("tank caustics/trace", true, 1.0, 0.004).times(name, false, ratio, spread);
        for line in &mut all.lines[first..] {
            if let Compared::Pair(pair) = line {
                (pair.second, pair.launch) = (true, pair.launch + LAUNCHES);
            }
        }
        let more = LAUNCHES..LAUNCHES + launches;
        all.lines.extend(more.map(|launch| {
            Compared::Launch(Launch { launch, wall_s: 1.5, second: true, ..Launch::default() })
        }));
        all
    }

    fn counts(mut self, name: &str, ratio: f64) -> Self {
        for (side, ratio) in [(Side::Base, 1.0), (Side::Head, ratio)] {
            self.lines.push(Compared::Instructions(InstructionCounts {
                side,
                cell: cell(name),
                counts: [10_000_000.0, 10_000_100.0, 10_000_200.0]
                    .map(|count| (count * ratio) as u64)
                    .to_vec(),
            }));
        }
        self
    }

    fn work(mut self, name: &str, base: u64, head: u64) -> Self {
        for (side, photons) in [(Side::Base, base), (Side::Head, head)] {
            self.lines.push(Compared::Exact(ExactFigures {
                side,
                cell: cell(name),
                work: Work { photons, ..Work::default() },
                counters: BTreeMap::from([("compute_shader_invocations".to_owned(), 2 * photons)]),
            }));
        }
        self
    }

    fn check(mut self, (stage, what): (&str, &str), base: f64, head: f64) -> Self {
        for (side, measured) in [(Side::Base, base), (Side::Head, head)] {
            self.lines.push(Compared::Check(CheckFigure {
                side,
                stage: stage.to_owned(),
                what: what.to_owned(),
                unit: "1".to_owned(),
                measured,
                tolerance: 0.1,
                sound: measured <= 0.1,
            }));
        }
        self
    }

    /// A cell in which nothing changed.
    fn same(self, name: &str) -> Self {
        self.work(name, 100, 100).counts(name, 1.0).times(name, false, 1.001, 0.004)
    }

    fn fault(mut self, gate: Gate, side: Side, name: Option<&str>, absent: bool) -> Self {
        let reason =
            if absent { "unknown pipeline `new`" } else { "it ended with signal: 11 (SIGSEGV)" };
        let fault = Fault::new(gate, Some(side), name.map(cell), reason);
        let launch = (gate == Gate::Time).then_some(3);
        self.lines.push(Compared::Fault(Fault { launch, absent, ..fault }));
        self
    }

    fn settings(mut self, change: impl FnOnce(&mut GateSettings)) -> Self {
        change(&mut self.header.settings);
        self
    }

    fn lines(self) -> Vec<Compared> {
        let mut lines = vec![Compared::Header(Box::new(self.header))];
        lines.extend(self.lines);
        lines.extend(
            self.interrupted
                .map(|interrupted| Compared::End(ComparisonEnd { wall_s: 61.5, interrupted })),
        );
        lines
    }

    fn write(self, folder: &Path) -> PathBuf {
        let mut held = Taken::free(folder).unwrap().open(Kind::Comparison).unwrap();
        store::write(&mut held, self.lines()).unwrap();
        held.output.records()
    }
}

/// One cell for each verdict.
fn mixed() -> Stored {
    let (slow, fast, cost) = ("tank caustics/trace", "tank godrays/lines", "tank shadow/depth");
    let (vague, gone, new) = ("tank compose", "tank water/refraction", "new voxel/clear");
    let (same, wrong) = ("tank caustics/splat", "tank caustics/filter");
    let mut stored = Stored::new(&[slow, same, wrong, fast, cost, vague, gone, new])
        .configuration(1_100_000, 0.01)
        .work(slow, 100, 120)
        .counts(slow, 1.061)
        .times(slow, false, 1.05, 0.004)
        .same(same)
        .work(wrong, 100, 100)
        .counts(wrong, 0.98)
        .check(("caustics/filter", "rounding"), 1e-7, 2e-7)
        .check(("caustics/filter", "energy"), 0.05, 0.01)
        .times(wrong, false, 1.0, 0.004)
        .counts(fast, 0.8)
        .check(("godrays/lines", "intensity"), 0.01, 0.2)
        .times(fast, false, 0.85, 0.01)
        .counts(cost, 1.02)
        .times(cost, false, 1.002, 0.004)
        .work(vague, 100, 100)
        .counts(vague, 1.0)
        .times(vague, false, 1.03, 0.08)
        .fault(Gate::Time, Side::Head, Some(gone), false)
        .fault(Gate::Exact, Side::Base, Some(new), true);
    stored.header.notes.push("no timestamps".to_owned());
    stored
}

fn quiet() -> Stored {
    Stored::new(&["tank caustics/trace", "tank compose"])
        .same("tank caustics/trace")
        .same("tank compose")
}

#[track_caller]
fn replayed(folder: &Path, status: i32) -> String {
    let output = fathom().args(["compare", "--replay"]).arg(folder).output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    let told = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(status), "{text}{told}");
    text
}

#[test]
fn what_is_told_of_a_stored_comparison_is_as_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let lines = mixed().write(folder.path());
    // A line that a crash tore.
    let torn =
        fs::read_to_string(&lines).unwrap() + "{\"record\":\"comparison\",\"kind\":\"pair\",\"laun";
    fs::write(&lines, torn).unwrap();
    let text = replayed(folder.path(), 1);
    fs::write(folder.path().join("terminal.txt"), text).unwrap();
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/compare");
    for name in ["terminal.txt", "summary.md", "junit.xml", "bencher.json", "benchmark.json"] {
        let found = fs::read_to_string(folder.path().join(name)).unwrap();
        let known = golden.join(name);
        if std::env::var_os("FATHOM_BLESS").is_some() {
            fs::write(&known, &found).unwrap();
        }
        let expected = fs::read_to_string(&known).unwrap();
        assert_eq!(found, expected, "{name}");
    }
}

#[test]
fn replaying_gives_the_same_bytes_each_time() {
    let folder = tempfile::tempdir().unwrap();
    mixed().write(folder.path());
    let first = replayed(folder.path(), 1);
    let files = || {
        let entries = fs::read_dir(folder.path()).unwrap();
        let mut files: Vec<(PathBuf, Vec<u8>)> = entries
            .map(|entry| entry.unwrap().path())
            .map(|path| (path.clone(), fs::read(path).unwrap()))
            .collect();
        files.sort();
        files
    };
    let before = files();
    assert_eq!(before.len(), 5);
    assert_eq!(replayed(folder.path(), 1), first);
    assert_eq!(files(), before);
}

#[test]
fn the_report_of_a_comparison_writes_the_same_files() {
    let folder = tempfile::tempdir().unwrap();
    mixed().write(folder.path());
    replayed(folder.path(), 1);
    let files = ["summary.md", "junit.xml", "bencher.json", "benchmark.json"];
    let read = || files.map(|name| fs::read_to_string(folder.path().join(name)).unwrap());
    let before = read();
    files.iter().for_each(|name| fs::remove_file(folder.path().join(name)).unwrap());
    fathom().arg("report").arg(folder.path()).assert().success();
    assert_eq!(read(), before);
    let resumed = fathom().args(["run", "--resume", "--out"]).arg(folder.path()).assert().code(2);
    resumed.stderr(contains("holds no run but other records"));
}

#[test]
fn the_exit_status_tells_how_it_ended() {
    let told = |stored: Stored, status| {
        let folder = tempfile::tempdir().unwrap();
        stored.write(folder.path());
        replayed(folder.path(), status)
    };
    let (trace, compose) = ("tank caustics/trace", "tank compose");
    let two = || Stored::new(&[trace, compose]).same(trace);
    assert!(told(quiet(), 0).contains("no regression; 2 cells: 2 same"));
    let slower = two().counts(compose, 1.0).times(compose, false, 1.05, 0.004);
    assert!(told(slower, 1).contains("tank compose: slower: time +5.0 %"));
    let more_bytes = quiet().configuration(1_000_001, 0.01);
    assert!(told(more_bytes, 1).contains("allocated_bytes"));
    let error = quiet().configuration(1_000_000, 0.02);
    assert!(told(error, 1).contains("tank caustics/trace: less accurate"));
    let cheap = Stored::new(&[trace, compose])
        .same(compose)
        .work(trace, 100, 100)
        .counts(trace, 1.0)
        .times(trace, false, 0.9, 0.004)
        .configuration(1_000_000, 0.02);
    assert!(told(cheap, 1).contains("tank caustics/trace: faster but less accurate"));
    let fewer_errors = quiet().configuration(1_000_000, 0.005);
    assert!(told(fewer_errors, 0).contains("0.0100 → 0.0050"));
    let counted = || two().work(compose, 1, 1).counts(compose, 1.0);
    let vague = counted().times(compose, false, 1.03, 0.08);
    assert!(told(vague, 3).contains("1 inconclusive"));
    let faster_if_anything = counted().times(compose, false, 0.97, 0.08);
    let text = told(faster_if_anything, 0);
    assert!(text.contains("of 1 inconclusive, 0 may be slower by more than 2.0 %"));
    let failed = two().fault(Gate::Time, Side::Head, Some(compose), false);
    assert!(told(failed, 2).contains("could not measure"));
    let new = two().fault(Gate::Exact, Side::Base, Some(compose), true);
    assert!(told(new, 0).contains("1 same, 1 new"));
}

#[test]
fn what_the_first_measurement_leaves_open_is_told_by_the_second() {
    let compose = "tank compose";
    let told = |stored: Stored, status: i32| {
        let folder = tempfile::tempdir().unwrap();
        stored.write(folder.path());
        replayed(folder.path(), status)
    };
    let open = || {
        Stored::new(&["tank caustics/trace", compose])
            .same("tank caustics/trace")
            .work(compose, 1, 1)
            .counts(compose, 1.0)
            .times(compose, false, 1.03, 0.08)
    };
    assert!(told(open(), 3).contains("10 launches of 2 pairs; a change"));
    let same = told(open().second(compose, 1.001, 0.004, LAUNCHES), 0);
    assert!(
        same.contains(
            "10 launches of 2 pairs, 10 more of 2 pairs for 1 cell that these left open;"
        ),
        "{same}"
    );
    let slower = told(open().second(compose, 1.06, 0.004, LAUNCHES), 1);
    assert!(slower.contains("1 slower, 1 same"), "{slower}");
    // A second measurement that was given up is a failure; a first one that got whole in spite of a fault is none.
    let late = |launches| {
        let mut late = open().second(compose, 1.001, 0.004, launches);
        late = late.fault(Gate::Time, Side::Base, None, false);
        if let Some(Compared::Fault(fault)) = late.lines.last_mut() {
            fault.launch = Some(LAUNCHES + launches);
        }
        late
    };
    assert!(told(late(LAUNCHES - 1), 2).contains("could not measure"));
    told(late(LAUNCHES), 0);
}

#[test]
fn a_control_that_moves_voids_the_time_gate_and_no_other() {
    let folder = tempfile::tempdir().unwrap();
    let trace = "tank caustics/trace";
    let mut stored = Stored::new(&[trace]).work(trace, 1, 1).counts(trace, 1.0);
    stored.lines.retain(|line| !matches!(line, Compared::Pair(pair) if pair.control));
    stored.times(trace, true, 1.06, 0.004).times(trace, false, 1.06, 0.004).write(folder.path());
    let text = replayed(folder.path(), 2);
    assert!(text.contains("time gate void: the control"), "{text}");
    assert!(text.contains("1 cell: 1 same"), "{text}");
}

#[test]
fn a_gate_that_cannot_run_here_is_no_failure_and_one_that_gave_nothing_is() {
    let folder = tempfile::tempdir().unwrap();
    let mut stored = quiet().settings(|settings| settings.gates = vec![Gate::Exact, Gate::Time]);
    stored
        .header
        .skipped
        .push(Skip { gate: Gate::Instructions, reason: "valgrind is not installed".to_owned() });
    stored.lines.retain(|line| !matches!(line, Compared::Instructions(_)));
    stored.write(folder.path());
    let text = replayed(folder.path(), 0);
    assert!(text.contains("instructions gate skipped: valgrind is not installed"));

    let folder = tempfile::tempdir().unwrap();
    let mut stored = quiet().fault(Gate::Time, Side::Base, None, false);
    stored.lines.retain(|line| !matches!(line, Compared::Pair(_) | Compared::Launch(_)));
    stored.write(folder.path());
    let text = replayed(folder.path(), 2);
    assert!(text.contains("time gate void: it ended with signal"), "{text}");
}

#[test]
fn what_nothing_measured_is_not_the_same() {
    let trace = "tank caustics/trace";
    let told = |stored: Stored| {
        let folder = tempfile::tempdir().unwrap();
        stored.write(folder.path());
        replayed(folder.path(), 2)
    };
    let mut void = Stored::new(&[trace]).settings(|settings| settings.gates = vec![Gate::Time]);
    void.lines.retain(|line| !matches!(line, Compared::Pair(_)));
    let void = void.times(trace, true, 1.06, 0.004);
    let void = void.times(trace, false, 1.0, 0.004);
    assert!(told(void).contains("1 cell: 1 not measured"));
    let uncounted = Stored::new(&[trace]).work(trace, 1, 1);
    let uncounted = uncounted.times(trace, false, 1.0, 0.004);
    assert!(told(uncounted.counts("tank compose", 1.0)).contains("1 not measured"));
    for interrupted in [None, Some(true)] {
        let mut cut = quiet();
        cut.interrupted = interrupted;
        assert!(told(cut).contains("could not measure; 2 cells: 2 same"));
    }

    let folder = tempfile::tempdir().unwrap();
    let mut exact = Stored::new(&[trace]).work(trace, 1, 1);
    exact.header.settings.gates = vec![Gate::Exact];
    exact.write(folder.path());
    assert!(replayed(folder.path(), 0).contains("1 same"));
}

#[test]
fn a_time_gate_whose_control_was_lost_is_void() {
    let told = |stored: Stored| {
        let folder = tempfile::tempdir().unwrap();
        stored.write(folder.path());
        replayed(folder.path(), 2)
    };
    let mut lost = quiet().fault(Gate::Time, Side::Base, Some("tank caustics/trace"), false);
    if let Some(Compared::Fault(fault)) = lost.lines.last_mut() {
        fault.control = true;
        fault.launch = Some(LAUNCHES);
    }
    let text = told(lost);
    assert!(text.contains("time gate void: the control was lost: it ended with signal"));
    let mut without = quiet();
    let control = |line: &Compared| matches!(line, Compared::Pair(pair) if pair.control);
    without.lines.retain(|line| !control(line));
    assert!(told(without).contains("time gate void: the control was not measured"));
}

#[test]
fn figures_that_vanish_are_faults_and_notes_are_told_once() {
    let folder = tempfile::tempdir().unwrap();
    let mut stored = quiet();
    for line in &mut stored.lines {
        match line {
            Compared::Configuration(figures) if figures.side == Side::Head => {
                figures.errors.clear();
                figures.notes.push("errors not computed: no reference".to_owned());
            }
            Compared::Launch(launch) => launch.notes.push("on any core: no Linux".to_owned()),
            _ => {}
        }
    }
    stored.write(folder.path());
    let text = replayed(folder.path(), 2);
    let once = |part: &str| assert_eq!(text.matches(part).count(), 1, "{part}: {text}");
    once("the head does not give caustics_photon_error_median_m of tank");
    once("head: tank: errors not computed: no reference");
    once("time gate: on any core: no Linux");
    assert!(!text.contains("core 0"));
    let junit = fs::read_to_string(folder.path().join("junit.xml")).unwrap();
    assert!(junit.contains("<testcase name=\"exact fault 1\" classname=\"gate\">"), "{junit}");
}

#[test]
fn faults_that_were_overcome_do_not_count() {
    let folder = tempfile::tempdir().unwrap();
    quiet()
        .fault(Gate::Time, Side::Base, None, false)
        .fault(Gate::Instructions, Side::Head, Some("tank compose"), false)
        .fault(Gate::Time, Side::Head, Some("tank compose"), false)
        .fault(Gate::Exact, Side::Head, None, false)
        .check(("compose", "energy"), 0.01, 0.01)
        .write(folder.path());
    assert!(!replayed(folder.path(), 0).contains("SIGSEGV"));
}

#[test]
fn pairs_of_a_launch_that_was_cut_short_do_not_count() {
    let folder = tempfile::tempdir().unwrap();
    let mut stored = quiet();
    for round in 0..500 {
        stored.lines.push(Compared::Pair(Pair {
            launch: LAUNCHES,
            round,
            cell: cell("tank compose"),
            control: false,
            second: false,
            first: Side::Base,
            base_ns: BASE_NS,
            head_ns: 2.0 * BASE_NS,
        }));
    }
    stored.write(folder.path());
    replayed(folder.path(), 0);
}

#[test]
fn damaged_and_foreign_files_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let lines = quiet().write(folder.path());
    let whole = fs::read_to_string(&lines).unwrap();
    let damaged = whole.replacen("\"kind\":\"exact\"", "\"kind\":\"exotic\"", 1);
    fs::write(&lines, &damaged).unwrap();
    let text = replayed(folder.path(), 2);
    assert!(text.contains("left out: line "), "{text}");
    assert!(text.contains("1 not measured, 1 same"), "{text}");

    let refused = |text: &str, reason: &str| {
        fs::write(&lines, text).unwrap();
        let mut command = fathom();
        let output = command.args(["compare", "--replay"]).arg(folder.path());
        let told = output.assert().code(2).get_output().stderr.clone();
        let told = String::from_utf8(told).unwrap();
        assert!(told.starts_with("error: ") && told.contains(reason), "{told}");
        assert_eq!(told.lines().count(), 1, "{told}");
    };
    refused(&whole.replacen("\"schema\":2", "\"schema\":9", 1), "format 9");
    refused(whole.split_once('\n').unwrap().1, "no sound header");
    fs::remove_file(&lines).unwrap();
    fathom()
        .args(["compare", "--replay"])
        .arg(folder.path())
        .assert()
        .code(2)
        .stderr(contains("no comparison in "));
}

#[test]
fn a_jobs_page_gets_the_markdown_of_a_fresh_comparison_only() {
    let folder = tempfile::tempdir().unwrap();
    let stored = folder.path().join("stored");
    quiet().write(&stored);
    let page = folder.path().join("page.md");
    let mut command = fathom();
    command.env("GITHUB_STEP_SUMMARY", &page);
    command.args(["compare", "--replay"]).arg(&stored);
    command.assert().success();
    assert!(!page.exists());
}

#[test]
fn formats_print_what_they_write() {
    let folder = tempfile::tempdir().unwrap();
    quiet().write(folder.path());
    for (format, file) in [
        ("markdown", "summary.md"),
        ("junit", "junit.xml"),
        ("bencher", "bencher.json"),
        ("benchmark", "benchmark.json"),
    ] {
        let mut command = fathom();
        command.args(["compare", "--format", format, "--replay"]);
        let output = command.arg(folder.path()).output().unwrap();
        let written = fs::read(folder.path().join(file)).unwrap();
        assert_eq!(output.stdout, written, "{format}");
    }
}

#[test]
fn bad_input_is_one_clear_line_and_status_2() {
    let refused = |arguments: &[&str], reason: &str| {
        let output = fathom().arg("compare").args(arguments).output().unwrap();
        let told = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {told}");
        let lines: Vec<&str> = told.lines().filter(|line| line.contains(reason)).collect();
        assert_eq!(lines.len(), 1, "{arguments:?}: {told}");
        assert!(lines[0].starts_with("error: "), "{arguments:?}: {told}");
    };
    refused(&[], "nothing to compare with");
    refused(&["--base", "no-such-revision"], "unknown revision `no-such-revision`");
    refused(&["--base-bin", "no/such/program"], "no/such/program");
    refused(&["--base-bin", "x", "--gates", "exakt"], "gates are exact, instructions, time");
    refused(&["--base-bin", "x", "--threshold", "2"], "a share lies between 0 and 1");
    refused(&["--base-bin", "x", "--cells", "no such cell"], "no gate cell matches");
    refused(&["--base-bin", "x", "--launches", "0"], "0 is not in 1..=200");
    refused(&["--base-bin", "x", "--resume"], "--out");
    refused(&["one.jsonl"], "2 values required");
    refused(&["one.jsonl", "two.jsonl"], "one.jsonl");
}

/// What the jobs of `docs/ci.md` run are its steps in their order, which a shell can read, and every option that it names
/// is one.
#[test]
fn the_documented_jobs_run_the_documented_steps() {
    let text = include_str!("../../docs/ci.md");
    let (_, rest) = text.split_once("```sh\n").unwrap();
    let (steps, _) = rest.split_once("```").unwrap();
    let commands = |block: &str| -> Vec<String> {
        let checked = std::process::Command::new("sh").args(["-n", "-c", block]).status();
        assert!(checked.unwrap().success(), "{block}");
        let lines = block.lines().map(str::trim);
        let kept = lines.filter(|line| {
            ["set", "scripts", "cargo", "target"].iter().any(|word| line.starts_with(word))
        });
        let plain = |line: &str| line.replace(" || status=$?", "");
        kept.map(plain).collect()
    };
    assert_eq!(commands(steps).len(), 4);
    for (begin, end) in [("run: |\n", "      - uses: actions/upload"), ("- |\n", "  # 3:")] {
        let (_, rest) = text.split_once(begin).unwrap();
        let (block, _) = rest.split_once(end).unwrap();
        assert_eq!(commands(block), commands(steps), "{begin}");
    }

    let help = fathom().args(["compare", "--help"]).output().unwrap();
    let help = String::from_utf8(help.stdout).unwrap();
    let commands = text.lines().filter(|line| line.contains("fathom compare "));
    let words = commands.flat_map(str::split_whitespace);
    let words = words.map(|word| word.trim_matches('`'));
    let options: Vec<&str> = words.filter(|word| word.starts_with("--")).collect();
    assert!(options.len() > 5, "{options:?}");
    for option in options {
        assert!(help.contains(option), "{option}");
    }
}

/// A real gate on the default adapter over one cell; none where it cannot be run.
fn counted(name: &str) -> Option<(StoredComparison, String)> {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let page = folder.path().join("page.md");
    let output = fathom()
        .env("GITHUB_STEP_SUMMARY", &page)
        .args(["compare", "--gates", "instructions", "--cells", name])
        .args(["--base-bin", env!("CARGO_BIN_EXE_fathom"), "--out"])
        .arg(&out)
        .output()
        .unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    let told = String::from_utf8(output.stderr).unwrap();
    if text.contains("instructions gate skipped") {
        eprintln!("not tried: {text}");
        return None;
    }
    assert_eq!(output.status.code(), Some(0), "{text}{told}");
    let comparison = StoredComparison::read(&out).unwrap();
    Some((comparison, fs::read_to_string(page).unwrap()))
}

#[test]
fn equal_builds_execute_equally_many_instructions() {
    let Some((comparison, page)) = counted("pool godrays/trace") else {
        return;
    };
    let counted = fathom::compare::instructions::judge(&comparison);
    let ratio = counted[&cell("pool godrays/trace")].ratio;
    assert!((ratio - 1.0).abs() < 0.001, "{ratio}");
    assert!(page.contains("no regression"));
}

/// What a stage leaves behind must not make its next frame longer: here, triangles in a queue. All frames but one are held to it:
/// what else the process does falls into one at times.
#[test]
fn a_stage_alone_executes_as_much_in_each_frame() {
    let Some((comparison, _)) = counted("alpha voxel/alpha") else {
        return;
    };
    for line in &comparison.instructions {
        let mut counts = line.counts.clone();
        counts.sort_unstable();
        let (least, most) = (counts[0] as f64, counts[counts.len() - 2] as f64);
        assert!(counts.len() >= 3 && most / least < 1.002, "{counts:?}");
    }
    assert_eq!(comparison.instructions.len(), 2);
}
