//! `customSmallerIsBetter` of github-action-benchmark: the head's figures by cell, to be kept from commit to commit.

use crate::verdict::{JudgedCell, Verdicts};
use fathom_record::Interval;
use fathom_report::format::NS_PER_MS;
use fathom_report::github_benchmark::{Entry, text};

pub fn export(verdicts: &Verdicts<'_>) -> String {
    let entries: Vec<Entry> = verdicts.cells.iter().flat_map(entries).collect();
    text(&entries)
}

fn entries(cell: &JudgedCell) -> Vec<Entry> {
    let mut entries = Vec::new();
    let verdict = cell.verdict;
    let mut add = |what: &str, unit, value, extra, range| {
        entries.push(Entry { name: format!("{} {what}", cell.cell), unit, value, extra, range });
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
