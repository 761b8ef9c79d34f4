use serde_json::json;

use super::super::store::StoredComparison;
use super::super::verdict::{CellVerdict, Status, Verdicts};
use super::*;
use fathom_record::StageRecord;

fn run(adapter: &str) -> Record {
    Record::Run(Box::new(Run {
        schema: record::SCHEMA,
        fathom_version: "0.1.0".to_owned(),
        adapter: Adapter { name: adapter.to_owned(), ..Adapter::default() },
        ..Run::default()
    }))
}

/// A cell whose stages all last so long.
fn measured(stages: &[&str], ns: f64) -> Outcome {
    let stage = |stage: &&str| StageRecord::of(*stage, record::Clock::Timestamp, vec![ns; 5]);
    Outcome::Measured(Box::new(Measured {
        stages: stages.iter().map(stage).collect(),
        allocated_bytes: 1,
        ..Measured::default()
    }))
}

fn cell(name: &str, quality: u32, outcome: Outcome) -> Record {
    Record::Cell(Box::new(Cell {
        experiment: "e".to_owned(),
        cell: name.to_owned(),
        axes: serde_json::Map::new(),
        pipeline: "p".to_owned(),
        scene: "s".to_owned(),
        stand_ins: Vec::new(),
        params: json!({ "quality": quality }).into(),
        outcome,
    }))
}

fn failed() -> Outcome {
    Outcome::Failed { reason: "device lost".to_owned() }
}

fn compared(base: &[Record], head: &[Record]) -> StoredComparison {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, records: &[Record]| {
        let lines = records.iter().map(|record| serde_json::to_string(record).unwrap() + "\n");
        let path = folder.path().join(name);
        std::fs::write(&path, lines.collect::<String>()).unwrap();
        path
    };
    let [base, head] = [("base", base), ("head", head)]
        .map(|(name, records)| RunFile::read(&write(name, records)).unwrap());
    let compared = lines(&base, &head, &GateSettings::default()).unwrap();
    StoredComparison::from_records(compared.into_iter().map(Record::from)).unwrap()
}

#[test]
fn unpaired_times_are_not_judged_and_have_no_ratio_below_the_clock_s_resolution() {
    let short = |ns: f64| {
        let Outcome::Measured(mut measured) = measured(&["s"], ns) else {
            panic!("it is measured");
        };
        measured.stages[0].fenced = Some(record::Fenced {
            wall_samples_ns: vec![6e4; 5],
            submit_cost_samples_ns: vec![6e4; 5],
            resolution_ns: 5e4,
        });
        Outcome::Measured(measured)
    };
    let both = [5e4, 9e4].map(|ns| [run("a"), cell("x=1", 1, short(ns))]);
    let comparison = compared(&both[0], &both[1]);
    let verdicts = Verdicts::of(&comparison);
    assert_eq!(verdicts.status, Status::TimesNotJudged);
    assert_eq!(verdicts.cells[0].verdict, CellVerdict::NotJudged);
    let times = verdicts.cells[0].unpaired.expect("both have times");
    assert!(!times.base.is_resolved() && times.head.is_resolved());
    assert_eq!(times.change(), None);
    let both = [1.0, 1.5].map(|ns| [run("a"), cell("x=1", 1, measured(&["s"], ns))]);
    let comparison = compared(&both[0], &both[1]);
    let verdicts = Verdicts::of(&comparison);
    assert_eq!(verdicts.status, Status::TimesNotJudged);
    assert_eq!(verdicts.cells[0].verdict, CellVerdict::NotJudged);
    assert_eq!(verdicts.cells[0].unpaired.and_then(|times| times.change()), Some(0.5));
}

#[test]
fn a_cell_or_stage_that_the_head_lacks_fails() {
    let whole = || measured(&["s", "t"], 1.0);
    let base = [run("a"), cell("x=1", 1, whole()), cell("x=2", 1, whole())];
    let head = [run("a"), cell("x=1", 1, failed()), cell("x=2", 1, measured(&["s"], 1.0))];
    let (failed, unjudged) = (CellVerdict::Failed, CellVerdict::NotJudged);
    for (base, head, expected) in [
        (&base, &head, [failed, failed, unjudged, failed]),
        (&head, &base, [failed, failed, unjudged, CellVerdict::New]),
    ] {
        let comparison = compared(base, head);
        let verdicts = Verdicts::of(&comparison);
        assert_eq!(verdicts.status, Status::CouldNotMeasure);
        let cells = verdicts.cells.iter().map(|cell| cell.verdict);
        assert_eq!(cells.collect::<Vec<_>>(), expected);
    }
}

#[test]
fn cells_of_one_file_only_are_named() {
    let one = || cell("x=1", 1, measured(&["s"], 1.0));
    let two = cell("x=2", 1, measured(&["s"], 1.0));
    let comparison = compared(&[run("a"), one(), two], &[run("a"), one()]);
    let note = "only in the base, and not compared: 1 of its cells: e:x=2";
    assert_eq!(comparison.header.notes, [note]);
}

#[test]
fn cells_of_an_earlier_run_on_another_adapter_do_not_count() {
    let one = |name| cell(name, 1, measured(&["s"], 1.0));
    let base = [run("a"), one("x=1"), run("b"), one("x=2")];
    let head = [run("b"), one("x=1"), one("x=2")];
    let comparison = compared(&base, &head);
    assert_eq!(comparison.header.cells, [CellId::new("e:x=2", "s")]);
    assert!(comparison.header.notes[0].contains("only its last run counts"));
}

#[test]
fn cells_of_one_name_and_other_parameters_are_numbered() {
    let twice = [1, 2].map(|quality| cell("x=1", quality, measured(&["s"], 1.0)));
    let records: Vec<Record> = std::iter::once(run("a")).chain(twice).collect();
    let comparison = compared(&records, &records);
    let expected = ["e:x=1", "e:x=1 (2)"].map(|id| CellId::new(id, "s"));
    assert_eq!(comparison.header.cells, expected);
}
