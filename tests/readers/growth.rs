//! Reports of many cells: what they allocate grows with the cells and not with their square.

use fathom::record::{Definition, Record};
use fathom::report::of_run as artifacts;
use serde_json::json;

use super::common::skipped_cell;
use super::memory::allocated_by;

/// Quadratic work grows 16-fold from n to 4 n, linear work 4-fold.
const MOST_GROWTH: f64 = 8.0;
const CELLS: usize = 8_000;

const ALONG: &str = r#"
    id = "own"
    title = "Own"
    source = "none"
    pipeline = "underwater"
    scene = "tank"
    [[sweep]]
    [[sweep.axis]]
    name = "caustics.grid"
    values = VALUES
    [[plot]]
    title = "Frames"
    kind = "bars"
    over = "caustics.grid"
    y = ["frame"]
    [[claim]]
    id = "rising"
    text = "It rises"
    test.monotone = { y = "frame", x = "axis:caustics.grid", over = "caustics.grid", direction = "rising" }
"#;

fn cell(experiment: &str, number: usize) -> Record {
    let mut record = skipped_cell(&format!("caustics.grid={number}"));
    if let Record::Cell(cell) = &mut record {
        cell.experiment = experiment.to_owned();
        cell.axes.insert("caustics.grid".to_owned(), json!(number));
        cell.stand_ins.push(format!("note {number}"));
    }
    record
}

/// Cells of one experiment that the records do not define, from the last to the first.
fn undefined(count: usize) -> Vec<Record> {
    (0..count).rev().map(|number| cell("own", number)).collect()
}

/// The same with the definition.
fn defined(count: usize) -> Vec<Record> {
    let values: Vec<usize> = (0..count).collect();
    let toml = ALONG.replace("VALUES", &format!("{values:?}"));
    let id = "own".to_owned();
    let definition = Record::Experiment(Definition { id, toml });
    std::iter::once(definition).chain(undefined(count)).collect()
}

/// A cell for each of many experiments.
fn scattered(count: usize) -> Vec<Record> {
    let cells = 0..count;
    cells.map(|number| cell(&format!("own-{number}"), number)).collect()
}

/// Bytes that a report takes in all, whatever it gives back.
fn bytes_of(records: &[Record]) -> f64 {
    let (files, bytes) = allocated_by(|| artifacts(records, None));
    assert!(!files.is_empty());
    bytes as f64
}

#[test]
fn the_definition_is_one() {
    let files = artifacts(&defined(3), None);
    let summary = files.last().unwrap();
    let text = String::from_utf8(summary.bytes.clone()).unwrap();
    assert!(text.contains("| It rises |"), "{text}");
}

#[test]
fn what_a_report_allocates_grows_with_its_cells() {
    type Shape = fn(usize) -> Vec<Record>;
    let shapes: [(&str, Shape); 3] =
        [("undefined", undefined), ("defined", defined), ("scattered", scattered)];
    for (name, shape) in shapes {
        let [few, many] = [CELLS, 4 * CELLS].map(|count| bytes_of(&shape(count)));
        assert!(many < MOST_GROWTH * few, "{name}: {few} bytes, then {many}");
    }
}
