//! `customSmallerIsBetter` of github-action-benchmark: the head's figures by cell, to be kept from commit to commit.
//! <https://github.com/benchmark-action/github-action-benchmark#examples>

use serde::Serialize;

use crate::format::NS_PER_MS;
use fathom_base::text;
use fathom_judge::verdict::{JudgedCell, Verdicts};
use fathom_record::Interval;

/// A value under a name. The smaller, the better.
#[derive(Serialize)]
struct BenchValue {
    name: String,
    unit: &'static str,
    /// In `unit`.
    value: f64,
    /// For people, shown beside the value.
    extra: String,
    /// How far the value may be off, for people.
    #[serde(skip_serializing_if = "Option::is_none")]
    range: Option<String>,
}

pub fn export(verdicts: &Verdicts<'_>) -> String {
    let entries: Vec<BenchValue> = verdicts.cells.iter().flat_map(entries).collect();
    // Strings and numbers always have a JSON.
    serde_json::to_string_pretty(&entries).unwrap_or_default() + "\n"
}

fn entries(cell: &JudgedCell) -> Vec<BenchValue> {
    let mut entries = Vec::new();
    let verdict = cell.verdict;
    let mut add = |what: &str, unit, value, extra, range| {
        let name = text::key([cell.cell.configuration(), cell.cell.stage(), what]);
        entries.push(BenchValue { name, unit, value, extra, range });
    };
    if let Some(time) = &cell.time {
        let extra = format!("{verdict}: {:+.2} % against the base", 100.0 * time.change.median);
        let range =
            |interval: Interval| format!("± {:.2} %", 50.0 * (interval.high - interval.low));
        let range = time.change.interval.map(range);
        add("time", "ms", time.head_ns / NS_PER_MS, extra, range);
    }
    if let Some(counted) = &cell.instructions {
        let change = 100.0 * (counted.ratio - 1.0);
        let extra = format!("{verdict}: {change:+.3} % against the base");
        add("instructions", "instructions", counted.head, extra, None);
    }
    entries
}
