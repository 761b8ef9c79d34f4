//! A history as Apache Otava reads it: a CSV file for each series, and a configuration that lists them as tests.
//! <https://otava.apache.org/docs/csv>

use serde_json::json;

use super::stored::{Series, StoredRuns};
use super::tables;
use fathom_base::text;
use fathom_report::Artifact;
use jiff::Timestamp;

/// Name of the configuration.
pub const CONFIGURATION: &str = "otava.yaml";
/// Name of the group of all tests.
pub const GROUP: &str = "fathom";
/// Name of the metric, which is a column.
const METRIC: &str = "value";

/// A test for each series. Paths in the configuration lead into `folder`.
pub fn files(stored: &StoredRuns, folder: &str) -> anyhow::Result<Vec<Artifact>> {
    let mut tests = serde_json::Map::new();
    let mut files = Vec::new();
    for (number, series) in stored.series.iter().enumerate() {
        let test = format!("{:05}-{}", number + 1, stem(series));
        let file = format!("{test}.csv");
        tests.insert(test, test_of(series, &format!("{folder}/{file}")));
        files.push(Artifact { name: file, bytes: csv_of(stored, series)? });
    }
    // JSON is YAML too, with no rule of YAML to quote names by. YAML 1.2.2, section 1.3.
    let all: Vec<&String> = tests.keys().collect();
    let configuration = json!({ "test_groups": { GROUP: all }, "tests": tests });
    let configuration = format!("{configuration:#}\n");
    files.push(Artifact { name: CONFIGURATION.to_owned(), bytes: configuration.into_bytes() });
    Ok(files)
}

/// Of plain characters only: Otava takes names with commas for several.
fn stem(series: &Series) -> String {
    let name = text::file_stem(&series.key.name());
    name.chars()
        .map(|c| if c.is_ascii_alphanumeric() || ".-".contains(c) { c } else { '_' })
        .collect()
}

fn test_of(series: &Series, path: &str) -> serde_json::Value {
    let metric = json!({ METRIC: { "column": METRIC, "direction": -1, "scale": 1.0, "unit": tables::unit(series) } });
    json!({ "type": "csv", "file": path, "time_column": "time", "attributes": ["commit"], "metrics": metric })
}

fn csv_of(stored: &StoredRuns, series: &Series) -> anyhow::Result<Vec<u8>> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(["time", "commit", METRIC])?;
    for point in &series.points {
        let run = &stored.runs[point.run];
        let time = Timestamp::from_second(run.committed_at).unwrap_or_default().to_string();
        let row = [time, text::spreadsheet(&run.commit), point.value.median.to_string()];
        writer.write_record(row)?;
    }
    Ok(writer.into_inner()?)
}
