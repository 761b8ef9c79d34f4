//! `fathom export`, `fathom schema` and `fathom list exporters` as a user meets them.

use crate::common::{
    Ends, Place, fathom, holds, names, own_cell, records, reference_of, skipped_cell, write_records,
};
use fathom::experiments::Experiment;
use fathom::record::comparison::Compared;
use fathom::record::schema::LineKind;
use fathom::record::{
    Cell, Clock, Definition, FrameRecord, Measured, Note, NoteKind, Outcome, Record, Run, SCHEMA,
    StageRecord, Work,
};
use fathom::statistics::estimate;
use serde_json::{Value, json};

const SAMPLES_NS: [f64; 3] = [2e6, 1e6, 4e6];

/// A frame of one stage and as long gaps.
fn measured() -> Measured {
    let stage = StageRecord::of("compose", Clock::Timestamp, SAMPLES_NS.to_vec());
    let work = Work { fragments: 64, ..Work::default() };
    let envelope_samples_ns = SAMPLES_NS.map(|ns| 2.0 * ns).to_vec();
    let frame = FrameRecord {
        gap_samples_ns: SAMPLES_NS.to_vec(),
        untimed_samples_ns: envelope_samples_ns.clone(),
        untimed: estimate(&envelope_samples_ns),
        envelope_samples_ns,
        ..FrameRecord::default()
    };
    let stages = vec![StageRecord { work, ..stage }];
    Measured { stages, frame, allocated_bytes: 512, ..Measured::default() }
}

/// A run of a measured and a skipped cell, a comparison, and a folder without records.
fn folders() -> Place {
    let place = Place::new();
    let run = Run { schema: SCHEMA, ..Run::default() };
    let measured = own_cell("n=1", Outcome::Measured(Box::new(measured())));
    let records =
        [Record::Run(Box::new(run)), Record::Cell(Box::new(measured)), skipped_cell("n=2")];
    write_records(&place.path("run"), &records);
    write_records(&place.path("comparison"), &[Compared::Header(Box::default()).into()]);
    std::fs::create_dir(place.path("empty")).unwrap();
    place
}

fn exported(place: &Place, words: &str) -> String {
    let told = place.fathom(format!("export {words}")).ends(0);
    assert_eq!(told.err, "");
    told.out
}

fn json_of(place: &Place, words: &str) -> Value {
    serde_json::from_str(&exported(place, words)).unwrap()
}

#[test]
fn every_format_of_a_run_can_be_had_alone() {
    let place = folders();
    place.fathom("report run").ends(0);
    for (format, file) in [("csv", "cells.csv"), ("markdown", "summary.md")] {
        let written = place.read(format!("run/{file}"));
        assert_eq!(exported(&place, &format!("{format} run")), written, "{format}");
    }
    let bencher = json_of(&place, "bencher run");
    assert_eq!(bencher["own n=1"]["latency"], json!({ "value": 4e6 }));
    assert_eq!(bencher["own n=1"]["allocated-bytes"], json!({ "value": 512 }));
    assert_eq!(bencher["own n=1 compose"]["latency"], json!({ "value": 2e6 }));
    let entries = json_of(&place, "github-action-benchmark run");
    let names: Vec<&Value> =
        entries.as_array().unwrap().iter().map(|entry| &entry["name"]).collect();
    assert_eq!(names, ["own n=1", "own n=1 compose"]);
    assert_eq!(entries[1]["value"], 2.0);
    holds(&exported(&place, "junit run"), &["<skipped message=\"too large\""]);
}

#[test]
fn a_trace_is_of_the_frame_that_is_asked_for() {
    let place = folders();
    let frame_us = |options: &[&str]| {
        let trace = place.fathom("export chrome-trace run").args(options).ends(0).json();
        let mut events = trace["traceEvents"].as_array().unwrap().iter();
        let frame = events.find(|event| event["cat"] == "frame").unwrap();
        (trace["otherData"]["frame"].as_u64().unwrap(), frame["dur"].as_f64().unwrap())
    };
    // The median of 2, 4 and 8 ms.
    assert_eq!(frame_us(&[]), (0, 4e3));
    assert_eq!(frame_us(&["--cell", "own n=1", "--frame", "2"]), (2, 8e3));
}

#[test]
fn a_file_goes_where_it_is_told_to_go() {
    let place = folders();
    let text = exported(&place, "junit run");
    assert_eq!(exported(&place, "junit run -o a.xml").trim(), "a.xml");
    assert_eq!(place.read("a.xml"), text);
    exported(&place, "junit run -o empty");
    assert_eq!(place.read("empty/junit.xml"), text);
}

#[test]
fn formats_of_comparisons_are_found_by_what_the_folder_holds() {
    let place = folders();
    holds(&exported(&place, "text comparison"), &["0 cells"]);
    assert_eq!(json_of(&place, "bencher comparison"), json!({}));
}

#[test]
fn what_cannot_be_exported_is_one_clear_line() {
    let place = folders();
    let unknown_cell = ["--cell", "own n=3"];
    for (words, more, reason) in [
        ("csv no/such/folder", &[][..], "no/such/folder/records.jsonl"),
        ("csv empty", &[], "holds a file records.jsonl"),
        ("bencherr run", &[], "unknown format `bencherr`; did you mean `bencher`?"),
        (
            "csv comparison",
            &[],
            "holds a comparison, which cannot be written as `csv`, only as text",
        ),
        (
            "text run",
            &[],
            "holds a run, which cannot be written as `text`, only as plots, rooflines, csv",
        ),
        ("chrome-trace run", &unknown_cell, "no timed cell `own n=3`; did you mean `own n=1`?"),
        ("chrome-trace run --frame 3", &[], "has frames 0 to 2, and no frame 3"),
        ("chrome-trace run --frame first", &[], "--frame"),
        (
            "csv run --frame 1",
            &[],
            "do not apply to `csv`, only to a format of one frame (chrome-trace)",
        ),
        ("plots run", &[], "name a folder with -o DIR"),
        ("csv run -o no/such/folder/cells.csv", &[], "cannot write no/such/folder/cells.csv"),
    ] {
        place.fathom(format!("export {words}")).args(more).refused(reason);
    }
    assert_eq!(names(&place.path("")), ["comparison", "empty", "run"]);
    place.write("empty/records.jsonl", "nonsense\n");
    place.fathom("export csv empty").refused("holds no sound record: line 1: not JSON");
}

#[test]
fn exporters_and_schemas_are_told() {
    let listed = fathom("list exporters").answer();
    for format in
        ["csv", "plots", "junit", "bencher", "github-action-benchmark", "chrome-trace", "public"]
    {
        assert!(listed.lines().any(|line| line.trim_start().starts_with(format)), "{format}");
    }
    for (words, kind) in [
        ("schema", LineKind::Record),
        ("schema sample", LineKind::Sample),
        ("schema worker", LineKind::Worker),
    ] {
        assert_eq!(fathom(words).ends(0).json(), kind.schema());
    }
    let wrong = fathom("schema records").refused("error: invalid value 'records'");
    holds(&wrong, &["record, sample, worker"]);
}

/// Of two experiments, with their times and pictures, beside a picture of `own`. What only the machine or the user told is in
/// capitals.
fn private_run() -> Place {
    let place = Place::new();
    let mut records = reference_of("uw-default");
    records.extend(reference_of("vao-guard").into_iter().filter(|r| r.try_as_run_ref().is_none()));
    for definition in records.iter_mut().filter_map(Record::try_as_experiment_mut) {
        definition.toml = Experiment::load(&definition.id).unwrap().text;
    }
    let Record::Run(run) = &mut records[0] else { panic!() };
    run.conditions.host = Some("HOST".into());
    run.command = ["/home/JO/fathom", "run", "--out", "SECRET", "--set=water.noise=0"]
        .map(str::to_owned)
        .to_vec();
    run.notes.push(Note::new(NoteKind::Adapter, "see"));
    run.notes.last_mut().unwrap().text = "see /home/JO/x.obj".into();
    let toml = "id = \"own\"\ntitle = \"TITLE\"".to_owned();
    records.push(Record::Experiment(Definition { id: "own".into(), toml }));
    records.push(Record::Cell(Box::new(Cell {
        stand_ins: vec!["SECRET".into()],
        ..own_cell("n=PRIVATE", Outcome::Measured(Box::new(measured())))
    })));
    records.push(Record::Cell(Box::new(Cell {
        cell: "n=SCENE".into(),
        scene: "SCENE.toml".into(),
        ..records.iter().find_map(Record::try_as_cell_ref).unwrap().as_ref().clone()
    })));
    write_records(&place.path("run"), &records);
    let mut pictures = records.iter().filter_map(Record::try_as_cell_ref);
    let picture = pictures.find_map(|cell| cell.measured()?.pictures.first()).unwrap();
    place.write(format!("run/{}", picture.path), "picture");
    place
}

const PRIVATE: [&str; 8] =
    ["HOST", "JO", "SECRET", "TITLE", "PRIVATE", "SCENE", "/home", "machine-0"];

/// The claims of built-in experiments in a folder's summary.
fn claims(place: &Place, folder: &str) -> Vec<String> {
    let junit: String = exported(place, &format!("junit {folder}"));
    let of_claim = |line: &&str| {
        let is_builtin = line.contains("classname=\"uw-default\"") || line.contains("vao-");
        is_builtin && !line.contains("SCENE")
    };
    junit.lines().filter(of_claim).map(str::to_owned).collect()
}

#[test]
fn a_public_copy_says_the_same_and_nothing_private() {
    let place = private_run();
    let told = place.fathom("export public run -o copies/full --samples").ends(0);
    holds(&told.err, &["2 cells are left out", "--own"]);
    let full = place.read("copies/full/records.jsonl");
    for private in PRIVATE {
        assert!(!full.contains(private), "{private}");
    }
    holds(&full, &["machine-1", "\"command\":[\"fathom\",\"run\",\"--set=water.noise=0\"]"]);
    assert_eq!(names(&place.path("copies/full/renders")).len(), 1);
    let original = claims(&place, "run");
    assert!(original.iter().any(|line| line.contains("vao-guard")));
    assert_eq!(claims(&place, "copies/full"), original);

    place.fathom("export public run -o copies/small").ends(0);
    let small = place.read("copies/small/records.jsonl");
    assert!(small.len() < full.len());
    let cells = records(&place.path("copies/small"));
    let mut measured =
        cells.iter().filter_map(Record::try_as_cell_ref).filter_map(|c| c.measured());
    assert!(measured.all(|m| !m.is_timed() && m.stages.iter().all(|s| s.samples_ns.is_empty())));
    holds(&place.read("copies/small/summary.md"), &["raw samples are left out"]);
}

#[test]
fn a_public_copy_keeps_what_is_asked_for_and_replaces_nothing() {
    let place = private_run();
    place.fathom("export public run -o all --own").ends(0);
    let all = place.read("all/records.jsonl");
    holds(&all, &["TITLE", "n=PRIVATE", "SCENE.toml"]);
    assert!(!all.contains("HOST") && !all.contains("/home"), "{all}");
    place.fathom("export public run -o all").refused("all is there already");
    place.fathom("export public run").refused("name it with -o DIR");
    place.fathom("export public run -o x --frame 1").refused("do not apply to `public`");
    place.fathom("export csv run --own").refused("apply to `public` alone");
    write_records(&place.path("own"), &[skipped_cell("n=1")]);
    place.fathom("export public own -o none").refused("nothing else is there");
    assert!(!place.path("none").exists());
}
