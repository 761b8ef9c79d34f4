//! `fathom export`, `fathom schema` and `fathom list exporters` as a user meets them.

use std::path::Path;

use assert_cmd::prelude::*;
use fathom::record::comparison::Compared;
use fathom::record::schema::LineKind;
use fathom::record::{
    Cell, Clock, Estimate, FrameRecord, Measured, Outcome, Record, Run, SCHEMA, StageRecord, Work,
    Writer,
};
use predicates::prelude::*;
use predicates::str::{contains, starts_with};
use serde_json::{Map, Value, json};

use super::refused;
use crate::common::fathom;

const SAMPLES_NS: [f64; 3] = [2e6, 1e6, 4e6];

fn write(folder: &Path, records: &[Record]) {
    let mut writer = Writer::create(&folder.join("records.jsonl")).unwrap();
    writer.write_all(records).unwrap();
}

fn estimate(median: f64) -> Estimate {
    Estimate { median, interval: None, n: SAMPLES_NS.len() }
}

/// A frame of one stage and as long gaps.
fn measured() -> Measured {
    let stage = StageRecord {
        stage: "compose".into(),
        clock: Clock::Timestamp,
        samples_ns: SAMPLES_NS.to_vec(),
        time: estimate(2e6),
        fenced: None,
        work: Work { fragments: 64, ..Work::default() },
        counters: fathom::record::Named::default(),
        ceiling: None,
        least_work: None,
    };
    let envelope_samples_ns = SAMPLES_NS.map(|ns| 2.0 * ns).to_vec();
    let frame = FrameRecord {
        gap_samples_ns: SAMPLES_NS.to_vec(),
        untimed_samples_ns: envelope_samples_ns.clone(),
        untimed: estimate(4e6),
        envelope_samples_ns,
        ..FrameRecord::default()
    };
    Measured { stages: vec![stage], frame, allocated_bytes: 512, ..Measured::default() }
}

fn cell(name: &str, outcome: Outcome) -> Record {
    Record::Cell(Box::new(Cell {
        experiment: "own".to_owned(),
        cell: name.to_owned(),
        axes: Map::new(),
        pipeline: "underwater".to_owned(),
        scene: "tank".to_owned(),
        stand_ins: Vec::new(),
        params: json!({}).into(),
        outcome,
    }))
}

/// A folder with a run of a measured and a skipped cell.
fn run() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let run = Run { schema: SCHEMA, ..Run::default() };
    let skipped = Outcome::Skipped { reason: "too large".to_owned() };
    let records = [
        Record::Run(Box::new(run)),
        cell("n=1", Outcome::Measured(Box::new(measured()))),
        cell("n=2", skipped),
    ];
    write(folder.path(), &records);
    folder
}

fn comparison() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), &[Compared::Header(Box::default()).into()]);
    folder
}

fn exported(folder: &Path, arguments: &[&str]) -> Vec<u8> {
    let (format, more) = arguments.split_first().unwrap();
    let mut export = fathom();
    export.args(["export", format]).arg(folder).args(more);
    export.assert().success().stderr("").get_output().stdout.clone()
}

fn json_of(folder: &Path, arguments: &[&str]) -> Value {
    serde_json::from_slice(&exported(folder, arguments)).unwrap()
}

#[test]
fn every_format_of_a_run_can_be_had_alone() {
    let folder = run();
    fathom().arg("report").arg(folder.path()).assert().success();
    for (format, file) in [("csv", "cells.csv"), ("markdown", "summary.md")] {
        let written = std::fs::read(folder.path().join(file)).unwrap();
        assert_eq!(exported(folder.path(), &[format]), written, "{format}");
    }
    let bencher = json_of(folder.path(), &["bencher"]);
    assert_eq!(bencher["own n=1"]["latency"], json!({ "value": 4e6 }));
    assert_eq!(bencher["own n=1"]["allocated-bytes"], json!({ "value": 512 }));
    assert_eq!(bencher["own n=1 compose"]["latency"], json!({ "value": 2e6 }));
    let entries = json_of(folder.path(), &["github-action-benchmark"]);
    let names: Vec<&str> =
        entries.as_array().unwrap().iter().map(|entry| entry["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["own n=1", "own n=1 compose"]);
    assert_eq!(entries[1]["value"], 2.0);
    let junit = String::from_utf8(exported(folder.path(), &["junit"])).unwrap();
    assert!(junit.contains("<skipped message=\"too large\""), "{junit}");
}

#[test]
fn a_trace_is_of_the_frame_that_is_asked_for() {
    let folder = run();
    let frame_us = |arguments: &[&str]| {
        let trace = json_of(folder.path(), arguments);
        let mut events = trace["traceEvents"].as_array().unwrap().iter();
        let frame = events.find(|event| event["cat"] == "frame").unwrap();
        (trace["otherData"]["frame"].as_u64().unwrap(), frame["dur"].as_f64().unwrap())
    };
    // The median of 2, 4 and 8 ms.
    assert_eq!(frame_us(&["chrome-trace"]), (0, 4e3));
    assert_eq!(frame_us(&["chrome-trace", "--cell", "own n=1", "--frame", "2"]), (2, 8e3));
}

#[test]
fn a_file_goes_where_it_is_told_to_go() {
    let (folder, out) = (run(), tempfile::tempdir().unwrap());
    let text = exported(folder.path(), &["junit"]);
    let file = out.path().join("a.xml");
    let told = exported(folder.path(), &["junit", "-o", file.to_str().unwrap()]);
    assert_eq!(String::from_utf8(told).unwrap().trim(), file.display().to_string());
    assert_eq!(std::fs::read(file).unwrap(), text);
    exported(folder.path(), &["junit", "-o", out.path().to_str().unwrap()]);
    assert_eq!(std::fs::read(out.path().join("junit.xml")).unwrap(), text);
}

#[test]
fn formats_of_comparisons_are_found_by_what_the_folder_holds() {
    let folder = comparison();
    let text = String::from_utf8(exported(folder.path(), &["text"])).unwrap();
    assert!(text.contains("0 cells"), "{text}");
    assert_eq!(json_of(folder.path(), &["bencher"]), json!({}));
}

#[test]
fn what_cannot_be_exported_is_one_clear_line() {
    let (run, comparison, empty) = (run(), comparison(), tempfile::tempdir().unwrap());
    let [run, comparison, empty] = [&run, &comparison, &empty].map(|f| f.path().to_str().unwrap());
    let no_records = "holds a file records.jsonl";
    let cases: [(&[&str], &str); 11] = [
        (&["csv", "no/such/folder"], "no/such/folder/records.jsonl"),
        (&["csv", empty], no_records),
        (&["bencherr", run], "unknown format `bencherr`; did you mean `bencher`?"),
        (
            &["csv", comparison],
            "holds a comparison, which cannot be written as `csv`, only as text",
        ),
        (
            &["text", run],
            "holds a run, which cannot be written as `text`, only as plots, rooflines, csv",
        ),
        (
            &["chrome-trace", run, "--cell", "own n=3"],
            "no timed cell `own n=3`; did you mean `own n=1`?",
        ),
        (&["chrome-trace", run, "--frame", "3"], "has frames 0 to 2, and no frame 3"),
        (&["chrome-trace", run, "--frame", "first"], "--frame"),
        (
            &["csv", run, "--frame", "1"],
            "do not apply to `csv`, only to a format of one frame (chrome-trace)",
        ),
        (&["plots", run], "name a folder with -o DIR"),
        (&["csv", run, "-o", "no/such/folder/cells.csv"], "cannot write no/such/folder/cells.csv"),
    ];
    for (arguments, reason) in cases {
        refused(&[&["export"], arguments].concat(), reason);
    }
    std::fs::write(Path::new(empty).join("records.jsonl"), "nonsense\n").unwrap();
    refused(&["export", "csv", empty], "holds no sound record: line 1: not JSON");
}

#[test]
fn exporters_and_schemas_are_told() {
    let list = fathom().args(["list", "exporters"]).assert().success();
    let formats = ["csv", "plots", "junit", "bencher", "github-action-benchmark", "chrome-trace"];
    for format in formats {
        let listed = String::from_utf8(list.get_output().stdout.clone()).unwrap();
        assert!(listed.lines().any(|line| line.trim_start().starts_with(format)), "{format}");
    }
    for (arguments, kind) in
        [(vec!["schema"], LineKind::Record), (vec!["schema", "sample"], LineKind::Sample)]
    {
        let told = fathom().args(arguments).assert().success();
        let told: Value = serde_json::from_slice(&told.get_output().stdout).unwrap();
        assert_eq!(told, kind.schema());
    }
    let wrong = fathom().args(["schema", "records"]).assert().code(2);
    wrong.stderr(starts_with("error: invalid value 'records'").and(contains("record, sample")));
}
