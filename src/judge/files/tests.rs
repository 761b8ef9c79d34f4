use serde_json::json;

use super::super::verdict::{CellVerdict, Status, Verdicts};
use super::*;
use fathom_record::{Adapter, StageRecord};

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
    let stage = |stage: &&str| StageRecord::new(*stage, record::Clock::Timestamp, vec![ns; 5], &[]);
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
        params: json!({ "quality": quality }).into(),
        outcome,
        ..Cell::default()
    }))
}

fn failed() -> Outcome {
    Outcome::Failed { reason: "device lost".to_owned() }
}

fn compared(base: &[Record], head: &[Record]) -> anyhow::Result<Comparison> {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, records: &[Record]| {
        let lines = records.iter().map(|record| serde_json::to_string(record).unwrap() + "\n");
        let path = folder.path().join(name);
        std::fs::write(&path, lines.collect::<String>()).unwrap();
        path
    };
    let [base, head] = [("base", base), ("head", head)]
        .map(|(name, records)| RunFile::read(&write(name, records)).unwrap());
    Ok(SameCells::compare([&base, &head], &Gate::ALL)?.comparison)
}

#[test]
fn files_without_a_common_cell_are_told_with_their_counts_and_what_differs() {
    let whole = || measured(&["s"], 1.0);
    let left = || cell("x=3", 1, Outcome::OverBudget);
    let base = [run("a"), cell("x=1", 1, whole()), cell("x=2", 1, whole()), left()];
    let of_both = "no measured cell in common: 2 measured in the base, 1 in the head";
    for (head, reason) in [
        (cell("x=2", 5, whole()), "; they differ, such as e:x=2 in quality 1 → 5"),
        (cell("y=2", 5, whole()), ""),
    ] {
        let head = [run("a"), left(), head];
        let message = compared(&base, &head).unwrap_err().to_string();
        assert!(message.ends_with(&format!("{of_both}{reason}")), "{message}");
    }
}

#[test]
fn cells_of_two_meshes_are_not_compared_and_an_unknown_one_is_told() {
    let with = |digest: Option<&str>| {
        let mut cell = cell("x=1", 1, measured(&["s"], 1.0));
        let sources = digest.map(|of| ("own.glb".to_owned(), of.to_owned()));
        cell.try_as_cell_mut().unwrap().sources.extend(sources);
        [run("a"), cell]
    };
    let [a, b, unknown] = [Some("a"), Some("b"), None].map(with);
    let message = compared(&a, &b).unwrap_err().to_string();
    assert!(message.ends_with("they differ, such as e:x=1 in own.glb a → b"), "{message}");
    let notes = |base, head| compared(base, head).unwrap().header.notes.len();
    assert_eq!([notes(&a, &a), notes(&unknown, &unknown)], [0, 0]);
    assert_eq!([notes(&a, &unknown), notes(&unknown, &a)], [1, 1]);
}

#[test]
fn a_cell_or_stage_that_the_head_lacks_fails() {
    let whole = || measured(&["s", "t"], 1.0);
    let base = [run("a"), cell("x=1", 1, whole()), cell("x=2", 1, whole())];
    let head = [run("a"), cell("x=1", 1, failed()), cell("x=2", 1, measured(&["s"], 1.0))];
    let (failed, same) = (CellVerdict::Failed, CellVerdict::Same);
    for (base, head, expected) in [
        (&base, &head, [failed, failed, same, failed]),
        (&head, &base, [failed, failed, same, CellVerdict::New]),
    ] {
        let comparison = compared(base, head).unwrap();
        let verdicts = Verdicts::judge(&comparison);
        assert_eq!(verdicts.status, Status::CouldNotMeasure);
        let cells = verdicts.cells.iter().map(|cell| cell.verdict);
        assert_eq!(cells.collect::<Vec<_>>(), expected);
    }
}

#[test]
fn cells_of_an_earlier_run_on_another_adapter_do_not_count() {
    let one = |name| cell(name, 1, measured(&["s"], 1.0));
    let base = [run("a"), one("x=1"), run("b"), one("x=2")];
    let head = [run("b"), one("x=1"), one("x=2")];
    let comparison = compared(&base, &head).unwrap();
    assert_eq!(comparison.header.cells, [CellId::new("e:x=2", "s")]);
    assert!(comparison.header.notes[0].contains("only its last run counts"));
}
