//! Bencher Metric Format: names of benchmarks → measures → a metric each.
//! <https://bencher.dev/docs/reference/bencher-metric-format/>

use serde_json::{Map, Value, json};

use super::{Exporter, Report, RunExporter, RunFormat, Timing};
use fathom_base::text;
use fathom_record::{Cell, Estimate, Interval};

pub const EXPORTER: RunExporter = Exporter {
    name: "bencher",
    about: "Bencher Metric Format: median and interval of each frame and stage, bytes of each cell",
    file: "bencher.json",
    written: Timing::OnRequest,
    export: RunFormat::One(export),
};

/// `EXPERIMENT CELL`.
fn cell_name(cell: &Cell) -> String {
    text::key([&*cell.experiment, &*cell.cell])
}

/// A stage's time below the clock's resolution is left out.
fn export(view: &Report<'_>) -> String {
    let mut all = Map::new();
    let mut add = |name: String, measure: &str, metric: Value| {
        all.entry(name).or_insert_with(|| json!({}))[measure] = metric;
    };
    for (cell, measured) in view.timed() {
        add(cell_name(cell), "latency", latency(&measured.frame.untimed));
        for stage in measured.stages.iter().filter(|of| of.time.n > 0 && of.is_resolved()) {
            let name = text::key([&*cell.experiment, &*cell.cell, &*stage.stage]);
            add(name, "latency", latency(&stage.time));
        }
    }
    for (cell, measured) in view.measured() {
        let metric = json!({ "value": measured.allocated_bytes });
        add(cell_name(cell), "allocated-bytes", metric);
    }
    format!("{:#}\n", Value::Object(all))
}

fn latency(time: &Estimate) -> Value {
    let mut metric = json!({ "value": time.median });
    if let Some(Interval { low, high }) = time.interval {
        metric["lower_value"] = json!(low);
        metric["upper_value"] = json!(high);
    }
    metric
}

#[cfg(test)]
mod tests {
    use super::*;
    use fathom_experiments::fixtures;
    use fathom_record::Record;

    fn exported(records: &[Record]) -> Value {
        serde_json::from_str(&export(&Report::new(records, None))).unwrap()
    }

    #[test]
    fn it_is_as_documented_and_holds_medians_with_their_intervals() {
        let records = fixtures::run();
        let all = exported(&records);
        let measures = all.as_object().unwrap().values().flat_map(|of| of.as_object().unwrap());
        for (_, metric) in measures {
            let metric = metric.as_object().unwrap();
            let known = ["value", "lower_value", "upper_value"];
            assert!(metric.iter().all(|(name, v)| known.contains(&&**name) && v.is_number()));
            assert!(metric.contains_key("value"));
        }
        let view = Report::new(&records, None);
        let (cell, measured) = view.timed().next().unwrap();
        let frame = &all[cell_name(cell)]["latency"];
        assert_eq!(frame["value"], json!(measured.frame.untimed.median));
        let stage = &measured.stages[0];
        let metric = &all[format!("{} {}", cell_name(cell), stage.stage)]["latency"];
        let Interval { low, high } = stage.time.interval.unwrap();
        let expected =
            json!({ "value": stage.time.median, "lower_value": low, "upper_value": high });
        assert_eq!(*metric, expected);
        assert!(all.as_object().unwrap().keys().all(|name| name.chars().count() <= 1024));
    }
}
