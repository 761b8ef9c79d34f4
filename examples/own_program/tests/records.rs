//! The lines that timing takes, the records of a run on the adapter at hand, and what fathom makes of them.

use std::path::Path;
use std::process::{Command, Output};

use fathom::judge::files::RunFile;
use fathom::judge::verdict::Status;
use fathom::quiet::{self, Quiet};
use fathom::record::comparison::Gate;
use fathom::record::output::RECORDS;
use fathom::record::{Cell, Clock, PassKind, Record, Run, read};
use fathom::report::changes::RunChanges;

const PASSES: [&str; 3] = ["ripple", "blur", "shade"];
/// What the clock may take of a program.
const MAX_LINES: usize = 15;

#[test]
fn the_clock_takes_few_lines_and_the_front_page_shows_them() {
    let own = |line: &&str| ["clock", "frame."].iter().any(|word| line.contains(word));
    let lines: Vec<&str> = include_str!("../src/main.rs").lines().filter(own).collect();
    assert!((1..=MAX_LINES).contains(&lines.len()), "{lines:#?}");
    let front_page = include_str!("../../../src/clock/README.md");
    for line in lines {
        assert!(front_page.contains(line.trim()), "the front page lacks `{line}`");
    }
}

/// On one core, where the audit of the clock is soon done.
fn run(program: &str, arguments: &[&str]) -> Output {
    let mut command = Command::new(program);
    let core = quiet::allowed_cores().first().copied();
    quiet::apply(&mut command, &Quiet { core, ..Quiet::default() });
    command.args(arguments).output().expect("it starts")
}

/// The run and the only cell of a file of records.
fn recorded(folder: &Path) -> (Run, Cell) {
    let records = read(&folder.join(RECORDS)).expect("they are sound").records;
    let [Record::Run(run), Record::Cell(cell), Record::End(_)] = &records[..] else {
        panic!("{records:#?}");
    };
    ((**run).clone(), (**cell).clone())
}

/// The times of a run on a machine of any load are asked for no more than that they are there.
#[test]
fn a_run_has_records_that_fathom_reports_keeps_and_compares() {
    let folders = tempfile::tempdir().unwrap();
    let measured = folders.path().join("measured");
    let timed = run(env!("CARGO_BIN_EXE_own_program"), &["16", measured.to_str().unwrap(), "0.5"]);
    assert!(timed.status.success(), "{}", String::from_utf8_lossy(&timed.stderr));
    let told = String::from_utf8(timed.stdout).unwrap();
    assert!(PASSES.iter().all(|pass| told.contains(&format!("\n  {pass} "))), "{told}");

    let (run, cell) = recorded(&measured);
    check(&run, &cell);
    reported(&measured);
    let kept = fathom::history::NewRun::read(&measured, RECORDS).expect("a history reads it");
    assert_eq!(kept.cells, 1);
    compared(&measured);
}

fn check(run: &Run, cell: &Cell) {
    let measured = cell.measured().expect("its frames were sampled");
    let names: Vec<&str> = measured.stages.iter().map(|stage| stage.stage.as_str()).collect();
    assert_eq!(names, PASSES);
    let pairs = measured.frame.untimed_samples_ns.len();
    assert!(pairs >= 1 && measured.warm_up_frames >= 2, "{measured:?}");
    for (stage, kind) in
        measured.stages.iter().zip([PassKind::Compute, PassKind::Compute, PassKind::Render])
    {
        let sound = |ns: &f64| ns.is_finite() && *ns > 0.0;
        assert!(stage.samples_ns.len() == pairs && stage.samples_ns.iter().all(sound));
        assert_eq!(stage.clock, run.clocks[&kind]);
        assert_eq!(stage.fenced.is_some(), stage.clock != Clock::Timestamp);
    }
    for kind in [PassKind::Compute, PassKind::Render, PassKind::Copy] {
        let rows = || run.audit.iter().filter(|row| row.pass == kind);
        let timestamps = rows().filter(|row| row.clock == Clock::Timestamp);
        let sound = timestamps.clone().count() > 0 && timestamps.clone().all(|row| row.sound);
        assert!(rows().count() > 0, "no audit of {kind:?}");
        // A pinned process on a software driver is timed by its CPU time, whatever the timestamps are.
        if run.clocks[&kind] != Clock::ProcessCpu {
            assert_eq!(run.clocks[&kind] == Clock::Timestamp, sound);
        }
    }
}

fn reported(folder: &Path) {
    let records = read(&folder.join(RECORDS)).unwrap().records;
    let files = fathom::report::report_files(&records, Some(folder));
    let summary = files.iter().find(|file| file.name == "summary.md").expect("there is one");
    let summary = std::str::from_utf8(&summary.bytes).unwrap();
    for text in PASSES.into_iter().chain(["own-program"]) {
        assert!(summary.contains(text), "{text}: {summary}");
    }
}

/// Two versions of the program compared, which are one here. What becomes of their times depends on the machine.
fn compared(folder: &Path) {
    let file = RunFile::read(&folder.join(RECORDS)).expect("it was just written");
    let changes = RunChanges::from_files([&file, &file], &Gate::ALL).expect("they compare");
    assert_eq!(changes.status, Status::TimesNotJudged);
    let told = changes.into_text();
    assert!(told.contains("exact figures of 1 cell: same"), "{told}");
}
