//! Bencher Metric Format: the head's figures by cell, and its time over the base's with the interval.
//! <https://bencher.dev/docs/reference/bencher-metric-format/>

use crate::record::Interval;
use serde_json::{Map, Value, json};

use super::Format;
use crate::compare::verdict::{JudgedCell, Verdicts};
use crate::record::comparison::Side;

pub const FORMAT: Format =
    Format { name: "bencher", about: "Bencher Metric Format", file: Some("bencher.json"), write };

fn write(verdicts: &Verdicts<'_>) -> String {
    let mut all = Map::new();
    for cell in &verdicts.cells {
        let measures = measures(cell);
        if !measures.is_empty() {
            all.insert(cell.cell.to_string(), Value::Object(measures));
        }
    }
    let configurations = verdicts.comparison.configurations.iter();
    for line in configurations.filter(|line| line.side == Side::Head) {
        let bytes = json!({ "allocated-bytes": { "value": line.allocated_bytes } });
        all.insert(line.configuration.clone(), bytes);
    }
    format!("{:#}\n", Value::Object(all))
}

fn measures(cell: &JudgedCell) -> Map<String, Value> {
    let mut measures = Map::new();
    if let Some(time) = &cell.time {
        // What digits there are beyond these is the mathematics library's affair.
        let ratio = |change: f64| ((1.0 + change) * 1e6).round() / 1e6;
        let mut metric = json!({ "value": ratio(time.change) });
        if let Some((low, high)) = time.interval {
            metric["lower_value"] = json!(ratio(low));
            metric["upper_value"] = json!(ratio(high));
        }
        measures.insert("time-ratio".to_owned(), metric);
        // Bencher's own measure of time is in nanoseconds.
        measures.insert("latency".to_owned(), json!({ "value": time.head_ns.round() }));
    }
    if let Some(unpaired) = cell.unpaired.filter(|times| times.head.is_resolved()) {
        let time = &unpaired.head.ns;
        let mut metric = json!({ "value": time.median });
        if let Some(Interval { low, high }) = time.interval {
            metric["lower_value"] = json!(low);
            metric["upper_value"] = json!(high);
        }
        measures.insert("latency".to_owned(), metric);
    }
    if let Some(counted) = &cell.instructions {
        measures.insert("instructions".to_owned(), json!({ "value": counted.head }));
    }
    measures
}
