//! Folders of measured data under two processes, kills and damage: nothing that was measured is lost or given to another run.
#![cfg(unix)]

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};

use crate::common::{
    CommandOutput, Ends, Place, SMALL, cells, failing_beyond, holds, measured, names, records,
    repetitions, signal, skipped_cell, wait_until, write_records,
};
use fathom::record::{Begun, Cell, FolderLock, Outcome, Record, Run, SCHEMA};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// A run of two small cells.
const RUN: &str =
    "run uw-waves --no-ceilings --axis water=circular --axis water.amplitude_m=0.0,0.1";

/// Visits that no cell reaches.
const UNENDING: &str = "--visits 1000 --budget 10m";
/// One visit, and the run ends.
const AT_ONCE: &str = "--visits 1 --budget 10m";

/// The same into the folder `out`.
fn run(place: &Place, options: &str) -> Command {
    let mut command = place.fathom(format!("{RUN} {SMALL} --out out {options}"));
    command.stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

/// How many versions of measured cells the records hold.
fn versions(place: &Place) -> usize {
    let text = fs::read_to_string(place.path("out/records.jsonl")).unwrap_or_default();
    text.matches("\"status\":\"measured\"").count()
}

/// While one run measures, another into the same folder names it. The first is interrupted after that, and a third run goes on with
/// what it has measured. Gives what the first said.
#[track_caller]
fn one_of_two(place: &Place, options: &str) -> String {
    let first = run(place, &format!("{UNENDING} {options}")).spawn().unwrap();
    let begin = format!("process {} ", first.id());
    let lock = || fs::read_to_string(place.path("out/.lock")).unwrap_or_default();
    wait_until("a holder of the folder", || lock().starts_with(&begin));
    // It is not done before the second has begun.
    signal("-STOP", first.id());
    let in_use = format!("is in use by process {} (`", first.id());
    holds(&run(place, options).refused(&in_use), &[", since 20"]);
    signal("-INT", first.id());
    signal("-CONT", first.id());
    let output = CommandOutput::check(first.wait_with_output().unwrap(), 130);
    assert!(
        matches!(records(&place.path("out")).last(), Some(Record::End(end)) if end.interrupted)
    );
    run(place, &format!("--resume {AT_ONCE}")).ends(0);
    output.err
}

#[test]
fn a_kill_at_any_moment_loses_no_record_and_one_of_two_processes_goes_on() {
    let mut random = Pcg64::seed_from_u64(repetitions());
    for _ in 0..repetitions() {
        let place = Place::new();
        let out = &place.path("out");
        let mut child = run(&place, UNENDING).spawn().unwrap();
        // Each cell is written after its first pair, and after 12 and more.
        let wanted = random.random_range(1..7);
        wait_until("a record of a cell", || {
            assert_eq!(child.try_wait().unwrap(), None, "it ended before there were records");
            versions(&place) >= wanted
        });
        // It measures no more.
        signal("-STOP", child.id());
        run(&place, "--resume").refused(&format!("process {} (", child.id()));
        child.kill().unwrap();
        child.wait().unwrap();
        let before = cells(out);
        place.fathom("report out").ends(0);
        holds(&one_of_two(&place, "--resume"), &["continuing from "]);
        goes_on(&before, &cells(out));
        assert_eq!(
            versions(&place),
            2,
            "only the latest of each cell is left when a run has ended"
        );
        assert_eq!(names(out).iter().filter(|name| name.ends_with(".jsonl")).count(), 1);
    }
}

/// Every pair that was recorded stands in its cell's latest record, at the beginning and in its order, and figures that were read stay.
/// `harness::sample` has the rest of the law.
#[track_caller]
fn goes_on(before: &[Cell], after: &[Cell]) {
    assert!(!before.is_empty() && after.len() == 2);
    for cell in after {
        let after = measured(cell);
        let all = after.frame.untimed_samples_ns.len();
        let visits = after.frame.visits.last().map_or(0, |last| *last as usize + 1);
        assert!(visits > 0 && after.frame.visits.len() == all);
        assert_eq!([after.frame.untimed.n, after.frame.timing_cost.n], [visits; 2]);
        assert!(after.is_finished() && !after.quantities.is_empty());
        let Some(before) = before.iter().find(|of| of.cell == cell.cell).map(measured) else {
            continue;
        };
        let pairs = before.frame.rounds.len();
        assert!(all >= pairs && after.warm_up_frames >= before.warm_up_frames);
        assert_eq!(after.frame.rounds[..pairs], before.frame.rounds);
        assert_eq!(after.frame.envelope_samples_ns[..pairs], before.frame.envelope_samples_ns);
        assert_eq!(after.frame.untimed_samples_ns[..pairs], before.frame.untimed_samples_ns);
        assert!(!before.is_finished() || before.quantities == after.quantities);
    }
}

#[test]
fn what_is_no_run_is_not_resumed_and_what_is_garbage_is_not_reported() {
    let place = Place::new();
    run(&place, "--resume").refused("no run to resume in ");
    assert!(!place.path("out").exists());
    place.write("out/summary.md", "a summary by fathom");
    for garbage in ["", "{\"record\":\"run\",\"sche", "one\ntwo\n", "\0\0\0\0"] {
        place.write("out/records.jsonl", garbage);
        place.fathom("report out").refused("holds no sound record");
        if !garbage.is_empty() {
            run(&place, "--resume").refused("holds no sound record");
        }
        assert_eq!(place.read("out/records.jsonl"), garbage);
        assert_eq!(place.read("out/summary.md"), "a summary by fathom");
    }
}

fn pipe(path: &Path) {
    assert!(Command::new("mkfifo").arg(path).status().unwrap().success());
}

/// A folder `out` with records of one cell.
fn recorded(place: &Place) {
    let run = Run { schema: SCHEMA, ..Run::default() };
    write_records(&place.path("out"), &[Record::Run(Box::new(run)), skipped_cell("n=1")]);
}

/// What a link, a pipe or a folder in the way comes to is tested in `base::folder`.
#[test]
fn reports_and_what_a_user_names_are_written_over_no_link_no_pipe_and_no_other_programs_file() {
    let place = Place::new();
    recorded(&place);
    let precious = place.write("precious", "keep");
    for name in ["out/index.html", "link"] {
        std::os::unix::fs::symlink(&precious, place.path(name)).unwrap();
    }
    pipe(&place.path("pipe.png"));
    let others = ["site/index.html", "new/summary.md", "swept/sweep.toml", "compared/junit.xml"];
    others.iter().for_each(|name| drop(place.write(name, "not by f-a-t-h-o-m")));
    let sweep = "sweep underwater --scene tank --axis surface.cells=16,17";
    for (words, reason) in [
        ("report out", "`index.html` is a symbolic link"),
        ("export csv out -o link", "`link` is a symbolic link"),
        (&format!("render tank -o pipe.png {SMALL}"), "`pipe.png` is a pipe or a device"),
        ("compare --base-bin pipe.png --out elsewhere", "it is a pipe or a device"),
        ("report out --out site", "`index.html` is there, and not by fathom"),
        ("run uw-default --out new", "`summary.md` is there, and not by fathom"),
        (&format!("{sweep} --out swept"), "`sweep.toml` is there, and not by fathom"),
        (
            "compare --base-cmd true --head-cmd true --out compared",
            "`junit.xml` is there, and not by fathom",
        ),
    ] {
        place.fathom(words).refused(reason);
    }
    assert_eq!(place.read("precious"), "keep");
    assert!(others.iter().all(|name| place.read(name) == "not by f-a-t-h-o-m"));
    assert_eq!(names(&place.path("new")), ["summary.md"]);
    place.write("old.csv", "old");
    place.fathom("export csv out -o old.csv").ends(0);
    holds(&place.read("old.csv"), &["own"]);
}

#[test]
fn a_folder_whose_name_is_no_text_can_be_used_and_locked() {
    use std::os::unix::ffi::OsStrExt;
    let place = Place::new();
    let out = place.path(std::ffi::OsStr::from_bytes(b"o\xffut"));
    let run = "run uw-default --cell base --no-ceilings";
    place.fathom(format!("{run} {SMALL} {AT_ONCE} --out")).arg(&out).ends(0);
    assert_eq!(cells(&out).len(), 1);
    place.fathom("report").arg(&out).ends(0);
}

#[test]
fn a_cell_in_which_two_processes_ended_is_failed_named_and_passed_over() {
    let place = Place::new();
    let run = format!("{RUN} {SMALL} {AT_ONCE}");
    place.fathom(format!("{run} --out whole")).ends(0);
    // What a process leaves that ends in the second cell.
    let whole = records(&place.path("whole"));
    let header = whole.iter().find_map(Record::try_as_run_ref).unwrap();
    let mut measured = whole.iter().filter_map(Record::try_as_cell_ref);
    let second = measured.find(|cell| cell.cell.ends_with("=0.1")).unwrap();
    let left = [Record::Run(header.clone()), Record::Begun(Begun::new(header, second))];
    write_records(&place.path("out"), &[left.clone(), left].concat());
    let output = place.fathom(format!("{run} --out out --resume")).ends(1);
    holds(&output.err, &["water.amplitude_m=0.1: failed: two processes ended while they built it"]);
    let cells = cells(&place.path("out"));
    let failed = |cell: &&Cell| matches!(&cell.outcome, Outcome::Failed { .. });
    assert_eq!((cells.len(), cells.iter().filter(failed).count()), (2, 1), "{cells:?}");
    assert!(cells.iter().any(|cell| cell.measured().is_some()));
}

/// `compare --replay` and `history show` take the lock by the same calls.
#[test]
fn a_folder_in_use_is_left_alone_by_every_command_that_writes_one() {
    let place = Place::new();
    recorded(&place);
    let _lock = FolderLock::take(&place.path("out")).unwrap();
    for words in [
        &format!("run uw-default --cell base --no-ceilings {SMALL} --out out"),
        "compare --base-cmd true --head-cmd true --out out",
        "bisect --good HEAD --out out",
        "report out",
        "report out --out out",
        "export csv out -o out",
        "render --figure uw -o out",
        &format!("dump caustics/trace {SMALL} -o out"),
    ] {
        place.fathom(words).refused(&format!("is in use by process {} (", std::process::id()));
    }
    assert_eq!(names(&place.path("out")), [".lock", "records.jsonl"]);
}

#[test]
fn a_limit_of_the_size_of_files_is_an_error_like_a_full_disk() {
    let place = Place::new();
    recorded(&place);
    failing_beyond(1, &place.fathom("report out")).refused("File too large");
}
