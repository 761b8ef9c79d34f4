//! Bencher Metric Format: the head's figures by cell, and its time over the base's with the interval.

use crate::verdict::{JudgedCell, Verdicts};
use fathom_record::comparison::Side;
use fathom_report::bencher::{ALLOCATED_BYTES, Benchmarks, LATENCY};

pub fn export(verdicts: &Verdicts<'_>) -> String {
    let mut all = Benchmarks::default();
    for cell in &verdicts.cells {
        add(cell, &mut all);
    }
    let configurations = verdicts.comparison.configurations.iter();
    for line in configurations.filter(|line| line.side == Side::Head) {
        all.add(&line.configuration, ALLOCATED_BYTES, line.allocated_bytes, None);
    }
    all.text()
}

fn add(cell: &JudgedCell, all: &mut Benchmarks) {
    let name = cell.cell.as_str();
    if let Some(time) = &cell.time {
        // What digits there are beyond these is the mathematics library's affair.
        let ratio = time.change.map(|change| ((1.0 + change) * 1e6).round() / 1e6);
        all.add(name, "time-ratio", ratio.median, ratio.interval);
        all.add(name, LATENCY, time.head_ns.round(), None);
    }
    if let Some(counted) = &cell.instructions {
        all.add(name, "instructions", counted.head, None);
    }
}
