//! Pieces of a program that stands in: it dies, hangs, or does what it is asked for.

use std::fs;
use std::os::unix::fs::PermissionsExt;

use tempfile::TempDir;

use super::*;

/// What a program that is this script leaves, and the status.
fn measured(script: &str, change: impl FnOnce(&mut HardwareArgs)) -> (TempDir, State, ExitCode) {
    let place = tempfile::tempdir().unwrap();
    let program = place.path().join("program");
    fs::write(&program, format!("#!/bin/sh\n{script}")).unwrap();
    fs::set_permissions(&program, fs::Permissions::from_mode(0o755)).unwrap();
    let adapter = AdapterArgs {
        adapter: None,
        like: None,
        without: Vec::new(),
        unchecked: false,
        allow_large: false,
    };
    let out = place.path().join("out");
    // A piece that ends by itself is never ended by this.
    let piece = Duration::from_secs(3_600);
    let mut args = HardwareArgs {
        out,
        piece,
        total: None,
        with: Vec::new(),
        steps: Step::ALL.to_vec(),
        adapter,
    };
    change(&mut args);
    let hardware = Hardware::open(&args, program).unwrap();
    let status = hardware.measure().unwrap();
    let state = fs::read(args.out.join(STATE))
        .map_or(State::default(), |bytes| serde_json::from_slice(&bytes).unwrap());
    (place, state, status)
}

#[test]
fn a_cell_in_which_the_driver_dies_is_named_and_left_out_of_the_next_piece() {
    let (place, state, status) = measured(
        r#"echo "$*" >> "$0.calls"
        case "$2 $*" in
            run*"--skip e c=1"*) ;;
            run*) echo "working on e b" >&2; echo "working on e c=1" >&2; kill -SEGV $$ ;;
            *) echo "{\"step\": \"$2\"}" ;;
        esac"#,
        |_| (),
    );
    assert_eq!(state.given_up, ["e c=1"]);
    assert_eq!(status, ExitCode::from(SOMETHING_FAILED));
    assert_eq!(state.steps.len(), Step::ALL.len());
    assert!(state.steps.iter().all(|taken| taken.is_over && taken.status == Some(0)), "{state:?}");
    let kept = |name| fs::read_to_string(place.path().join("out").join(name)).unwrap();
    assert_eq!(kept("verify.json"), "{\"step\": \"verify\"}\n");
    let program = place.path().join("program").display().to_string();
    let out = place.path().join("out").display().to_string();
    let calls = [
        "doctor --json".to_owned(),
        "audit --json".to_owned(),
        "verify --json".to_owned(),
        "ceilings --json".to_owned(),
        format!("run --profile paper --budget 3540 --out {out}"),
        format!("run --profile paper --budget 3540 --out {out} --skip e c=1"),
        format!("compare --base-bin {program} --out {out}/comparison"),
    ];
    let expected: String = calls.iter().map(|call| format!("--verbose {call}\n")).collect();
    assert_eq!(fs::read_to_string(program + ".calls").unwrap(), expected);
}

#[test]
fn what_never_ends_is_given_up_after_two_pieces_and_the_rest_goes_on() {
    let (_, state, status) =
        measured("sleep 100000", |args| args.piece = Duration::from_millis(300));
    assert_eq!(status, ExitCode::from(SOMETHING_FAILED));
    assert_eq!(state.steps.len(), Step::ALL.len());
    for taken in &state.steps {
        assert!(taken.is_over && taken.status.is_none(), "{taken:?}");
        assert_eq!(taken.reason, "it did not end within 0.3 s and was killed");
    }
}

#[test]
fn what_could_not_run_is_tried_twice_and_its_reason_kept() {
    let (_, state, status) = measured(r#"echo "error: no GPU" >&2; exit 2"#, |_| ());
    assert_eq!(status, ExitCode::from(SOMETHING_FAILED));
    for taken in &state.steps {
        assert_eq!((taken.status, taken.in_vain), (Some(2), MOST_ATTEMPTS));
        assert_eq!(taken.reason, "error: no GPU");
    }
}

#[test]
fn what_ends_with_a_fault_names_the_file_that_says_which() {
    let (_, state, status) = measured("echo {}; exit 1", |_| ());
    assert_eq!(status, ExitCode::from(SOMETHING_FAILED));
    let reasons: Vec<&str> = state.steps.iter().map(|taken| taken.reason.as_str()).collect();
    let files = [
        "doctor.json",
        "audit.json",
        "verify.json",
        "ceilings.json",
        "summary.md",
        "comparison/summary.md",
    ];
    assert_eq!(reasons, files.map(|file| format!("{file} says why")));
    // Without an answer there is no such file.
    let (_, state, _) = measured("echo 'error: no window' >&2; exit 1", |_| ());
    assert_eq!(state.steps[0].reason, "error: no window");
}

#[test]
fn cells_that_no_piece_measures_are_counted_and_not_called_done() {
    let cell = r#"{"record":"cell","experiment":"e","cell":"c","axes":{},"pipeline":"p","scene":"s","stand_ins":[],"params":{},"outcome":{"status":"over_budget"}}"#;
    let script =
        format!("[ \"$2\" = run ] && printf '%s\\n' '{cell}' > \"$8/records.jsonl\"\nexit 0");
    let (_, state, status) = measured(&script, |_| ());
    assert_eq!(status, ExitCode::from(SOMETHING_FAILED));
    let run = state.steps.iter().find(|taken| taken.step == Step::Run).unwrap();
    assert_eq!((run.status, run.is_over, run.in_vain), (Some(0), true, MOST_ATTEMPTS));
    assert_eq!(run.reason, "cells not measured: 1");
}

#[test]
fn without_time_nothing_is_begun_and_something_is_left() {
    let (_, state, status) = measured("exit 0", |args| args.total = Some(Duration::from_nanos(1)));
    assert_eq!(status, ExitCode::from(LEFT));
    assert!(state.steps.is_empty());
}
