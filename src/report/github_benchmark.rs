//! `customSmallerIsBetter` of github-action-benchmark: a list of named values.
//! <https://github.com/benchmark-action/github-action-benchmark#examples>

use serde::Serialize;

use super::format::{NS_PER_MS, three};
use super::timed::{NamedTime, times};
use super::{Exporter, OfRun, ReportView, RunExporter, Written};

pub const EXPORTER: RunExporter = Exporter {
    name: "github-action-benchmark",
    about: "customSmallerIsBetter of github-action-benchmark: median and interval of each frame and stage",
    file: "benchmark.json",
    written: Written::OnRequest,
    export: OfRun::One(export),
};

/// A value under a name. The smaller, the better.
#[derive(Serialize)]
pub struct Entry {
    pub name: String,
    pub unit: &'static str,
    /// In `unit`.
    pub value: f64,
    /// For people, shown beside the value.
    pub extra: String,
    /// How far the value may be off, for people.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub range: Option<String>,
}

/// The file of a list.
pub fn text(entries: &[Entry]) -> String {
    // Strings and numbers always have a JSON.
    let json = serde_json::to_string_pretty(entries).unwrap_or_default();
    json + "\n"
}

fn export(view: &ReportView<'_>) -> String {
    let entries: Vec<Entry> = times(view).into_iter().map(entry).collect();
    text(&entries)
}

fn entry(named: NamedTime) -> Entry {
    let time = named.time.scaled(1.0 / NS_PER_MS);
    let clock = match named.clock {
        Some(clock) => format!("{} clock", clock.name()),
        None => "frame without per-stage timing".to_owned(),
    };
    let interval = time.interval.map(|interval| {
        let [low, high] = [interval.low, interval.high].map(three);
        format!("; 95 % interval {low} – {high} ms")
    });
    Entry {
        name: named.name,
        unit: "ms",
        value: time.median,
        extra: format!("n = {}; {clock}{}", time.n, interval.unwrap_or_default()),
        range: time.interval.map(|interval| format!("± {}", three(interval.half_width()))),
    }
}

#[cfg(test)]
mod tests {
    use serde_json::Value;

    use super::*;
    use crate::testing;

    #[test]
    fn every_entry_has_what_the_action_asks_for() {
        let view = testing::view();
        let all: Vec<Value> = serde_json::from_str(&export(&view)).unwrap();
        assert_eq!(all.len(), times(&view).len());
        for entry in &all {
            let texts = ["name", "unit", "extra", "range"];
            assert!(texts.iter().all(|field| entry[field].is_string()), "{entry}");
            assert!(entry["value"].as_f64().is_some_and(|value| value > 0.0), "{entry}");
        }
        let frame = &times(&view)[0];
        assert_eq!(all[0]["value"], frame.time.median / NS_PER_MS);
    }
}
