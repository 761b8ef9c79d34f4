//! `customSmallerIsBetter` of github-action-benchmark: the head's figures by cell, to be kept from commit to commit.
//! <https://github.com/benchmark-action/github-action-benchmark>

use serde_json::{Value, json};

use super::Format;
use crate::compare::verdict::{JudgedCell, Verdicts};
use crate::report::format::NS_PER_MS;

pub const FORMAT: Format = Format {
    name: "benchmark",
    about: "JSON for github-action-benchmark",
    file: Some("benchmark.json"),
    write,
};

fn write(verdicts: &Verdicts<'_>) -> String {
    let entries: Vec<Value> = verdicts.cells.iter().flat_map(entries).collect();
    format!("{:#}\n", Value::Array(entries))
}

fn entries(cell: &JudgedCell) -> Vec<Value> {
    let mut entries = Vec::new();
    let verdict = cell.verdict;
    if let Some(time) = &cell.time {
        let mut entry = json!({
            "name": format!("{} time", cell.cell),
            "unit": "ms",
            "value": time.head_ns / NS_PER_MS,
            "extra": format!("{verdict}: {:+.2} % against the base", 100.0 * time.change),
        });
        if let Some((low, high)) = time.interval {
            let half = 50.0 * (high - low);
            entry["range"] = json!(format!("± {half:.2} %"));
        }
        entries.push(entry);
    }
    if let Some(unpaired) = cell.unpaired.filter(|times| times.head.is_resolved()) {
        entries.push(json!({
            "name": format!("{} time", cell.cell),
            "unit": "ms",
            "value": unpaired.head.ns.median / NS_PER_MS,
            "extra": "unpaired",
        }));
    }
    if let Some(counted) = &cell.instructions {
        entries.push(json!({
            "name": format!("{} instructions", cell.cell),
            "unit": "instructions",
            "value": counted.head,
            "extra": format!("{verdict}: {:+.3} % against the base", 100.0 * (counted.ratio - 1.0)),
        }));
    }
    entries
}
