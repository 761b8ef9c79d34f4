//! What the page's script reads: the times of every cell's stages, compressed.

use std::io::BufWriter;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;
use flate2::{Compression, GzBuilder};
use serde::{Serialize, Serializer};

use super::Page;
use crate::Report;
use crate::format::{NS_PER_MS, three};
use fathom_base::statistics;
use fathom_record::Measured;

/// Bytes that are compressed in one step.
const WRITTEN_AT_ONCE: usize = 1 << 16;

#[derive(Serialize)]
struct PageData<'a> {
    runs: Vec<CellRows<'a>>,
}

/// The measured cells of a run, each made when it is written: rows of a table of its frame's and stages' times.
struct CellRows<'a>(&'a Report<'a>);

impl Serialize for CellRows<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(self.0.measured().map(|(_, measured)| rows(measured)))
    }
}

fn rows(measured: &Measured) -> Vec<[String; 6]> {
    let frame = &measured.frame;
    let of_frame = [
        row("frame, untimed", &frame.untimed_samples_ns, "", None),
        row("frame, timed by stage", &frame.envelope_samples_ns, "", None),
    ];
    let stages = measured.stages.iter().map(|stage| {
        let below_ns = (!stage.is_resolved()).then(|| stage.resolution_ns());
        row(&stage.stage, &stage.samples_ns, stage.clock.name(), below_ns)
    });
    of_frame.into_iter().chain(stages).collect()
}

/// Name, median, minimum and maximum in ms, number of samples, clock. `below_ns` is the clock's resolution where the time is below it.
fn row(name: &str, samples_ns: &[f64], clock: &str, below_ns: Option<f64>) -> [String; 6] {
    let ms = |ns: f64| three(ns / NS_PER_MS);
    let [median, min, max] = match below_ns {
        Some(ns) => [format!("< {}", ms(ns)), String::new(), String::new()],
        None if samples_ns.is_empty() => ["–".to_owned(), String::new(), String::new()],
        None => {
            let end = |of: fn(f64, f64) -> f64| samples_ns.iter().copied().reduce(of);
            [Some(statistics::median(samples_ns)), end(f64::min), end(f64::max)]
                .map(|ns| ns.map(ms).unwrap_or_default())
        }
    };
    [name.to_owned(), median, min, max, samples_ns.len().to_string(), clock.to_owned()]
}

/// JSON, compressed by gzip, as base64. The same records give the same bytes.
pub fn packed(page: &Page<'_>) -> String {
    let data = PageData { runs: page.runs.iter().map(|run| CellRows(run.view)).collect() };
    // Without a time in its header.
    let packer = GzBuilder::new().write(Vec::new(), Compression::default());
    let mut packer = BufWriter::with_capacity(WRITTEN_AT_ONCE, packer);
    serde_json::to_writer(&mut packer, &data).expect("numbers and names are JSON");
    let packed = packer.into_inner().map_err(|error| error.into_error());
    let packed = packed.and_then(|packer| packer.finish());
    BASE64.encode(packed.expect("a buffer takes all bytes"))
}

#[cfg(test)]
mod tests {
    use std::io::Read as _;

    use super::*;
    use crate::testing;

    #[test]
    fn every_measured_cell_is_packed_with_its_stages() {
        let view = testing::view();
        let bytes = BASE64.decode(packed(&crate::testing::page(&[&view]))).unwrap();
        let mut json = String::new();
        flate2::read::GzDecoder::new(bytes.as_slice()).read_to_string(&mut json).unwrap();
        let data: serde_json::Value = serde_json::from_str(&json).unwrap();
        let cells = data["runs"][0].as_array().unwrap();
        assert_eq!(cells.len(), view.measured().count());
        let (_, first) = view.measured().next().unwrap();
        let stage = &first.stages[0];
        let median = three(statistics::median(&stage.samples_ns) / NS_PER_MS);
        let row = &cells[0][2];
        assert_eq!((&row[0], &row[1]), (&stage.stage.as_str().into(), &median.into()));
        assert_eq!(cells[0].as_array().unwrap().len(), 2 + first.stages.len());
    }
}
