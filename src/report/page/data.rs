//! What the page's script reads: the samples of every cell and the plots, compressed.

use std::io::BufWriter;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;
use flate2::{Compression, GzBuilder};
use serde::{Serialize, Serializer};

use super::{Page, PageRun};
use crate::axis::tenth;
use crate::colors::StageColors;
use crate::format::NS_PER_MS;
use crate::{ReportView, Section};
use fathom_base::statistics;
use fathom_record::{Cell, Measured};

/// Steps of a sample in its list's median: 0.2 % of it. The page shows three digits.
const STEPS: f64 = 500.0;
/// Bytes that are compressed in one step.
const WRITTEN_AT_ONCE: usize = 1 << 16;

#[derive(Serialize)]
struct Data<'a> {
    runs: Vec<RunData<'a>>,
    /// Of every stage.
    colors: &'a StageColors,
}

#[derive(Serialize)]
struct RunData<'a> {
    label: &'a str,
    cells: Cells<'a>,
    plots: Vec<PlotData<'a>>,
}

/// Of an experiment, by its id.
#[derive(Serialize)]
struct PlotData<'a> {
    name: &'a str,
    svg: &'a str,
}

/// Samples as multiples of a [`STEPS`]th of their median: whole numbers compress well.
#[derive(Serialize)]
struct Samples {
    step: f32,
    steps: Vec<i64>,
}

impl Samples {
    fn of(samples_ns: &[f64]) -> Samples {
        if samples_ns.is_empty() {
            return Samples { step: 0.0, steps: Vec::new() };
        }
        let middle_ns = statistics::median(samples_ns).abs();
        // A nanosecond where the median is none.
        let step = if middle_ns == 0.0 { 1.0 } else { middle_ns / STEPS } / NS_PER_MS;
        let steps = samples_ns.iter().map(|ns| (ns / NS_PER_MS / step).round() as i64);
        Samples { step: step as f32, steps: steps.collect() }
    }
}

/// Of a measured cell. Times are milliseconds; samples of one frame have the same index.
#[derive(Serialize)]
struct CellData<'a> {
    experiment: &'a str,
    cell: &'a str,
    stages: Vec<StageData<'a>>,
    envelope: Samples,
    gaps: Samples,
    untimed: Samples,
    /// Since the first sample of the run, in tenths of seconds.
    at_s: Vec<f64>,
}

#[derive(Serialize)]
struct StageData<'a> {
    stage: &'a str,
    clock: &'static str,
    samples: Samples,
    /// Where no sample can be told from none: the duration below which that is so.
    #[serde(skip_serializing_if = "Option::is_none")]
    below: Option<f64>,
}

/// The measured cells of a run, each made when it is written.
struct Cells<'a> {
    view: &'a ReportView<'a>,
    started_s: f64,
}

impl Serialize for Cells<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let cells = self.view.measured();
        serializer.collect_seq(cells.map(|(cell, m)| of_cell(cell, m, self.started_s)))
    }
}

/// JSON, compressed by gzip, as base64. The same records give the same bytes.
pub fn packed(page: &Page<'_>) -> String {
    let data = Data { runs: page.runs.iter().map(of_run).collect(), colors: &page.colors };
    // Without a time in its header.
    let packer = GzBuilder::new().write(Vec::new(), Compression::best());
    let mut packer = BufWriter::with_capacity(WRITTEN_AT_ONCE, packer);
    serde_json::to_writer(&mut packer, &data).expect("numbers and names are JSON");
    let packed = packer.into_inner().map_err(|error| error.into_error());
    let packed = packed.and_then(|packer| packer.finish());
    BASE64.encode(packed.expect("a buffer takes all bytes"))
}

fn of_run<'a>(run: &'a PageRun<'a>) -> RunData<'a> {
    let started_s = run
        .view
        .measured()
        .flat_map(|(_, measured)| &measured.frame.sampled_at_s)
        .copied()
        .fold(f64::INFINITY, f64::min);
    let cells = Cells { view: run.view, started_s };
    let plot = |section: &'a Section<'a>| {
        Some(PlotData { name: section.id, svg: section.figure().svg.as_deref()? })
    };
    let plots = run.view.sections.iter().filter_map(plot).collect();
    RunData { label: &run.label, cells, plots }
}

fn of_cell<'a>(cell: &'a Cell, measured: &'a Measured, started_s: f64) -> CellData<'a> {
    let frame = &measured.frame;
    let stages = measured.stages.iter().map(|stage| StageData {
        stage: &stage.stage,
        clock: stage.clock.name(),
        samples: Samples::of(&stage.samples_ns),
        below: (!stage.is_resolved()).then(|| stage.resolution_ns() / NS_PER_MS),
    });
    CellData {
        experiment: &cell.experiment,
        cell: &cell.cell,
        stages: stages.collect(),
        envelope: Samples::of(&frame.envelope_samples_ns),
        gaps: Samples::of(&frame.gap_samples_ns),
        untimed: Samples::of(&frame.untimed_samples_ns),
        at_s: frame.sampled_at_s.iter().map(|at_s| tenth(at_s - started_s)).collect(),
    }
}

#[cfg(test)]
mod tests {
    use std::io::Read as _;

    use super::*;
    use crate::testing;

    #[test]
    fn samples_are_kept_to_half_a_step() {
        let samples_ns = [12_345.678, 11_000.0, 1.0, 900_000.0, 13_000.0];
        let Samples { step, steps } = Samples::of(&samples_ns);
        for (ns, steps) in samples_ns.iter().zip(steps) {
            let unpacked = NS_PER_MS * f64::from(step) * steps as f64;
            assert!((unpacked - ns).abs() <= 0.51 * 12_345.678 / STEPS, "{ns} became {unpacked}");
        }
        assert!(Samples::of(&[]).steps.is_empty());
    }

    #[test]
    fn every_measured_cell_is_packed_with_its_samples() {
        let view = testing::view();
        let bytes = BASE64.decode(packed(&crate::testing::page(&[&view]))).unwrap();
        let mut json = String::new();
        flate2::read::GzDecoder::new(bytes.as_slice()).read_to_string(&mut json).unwrap();
        let data: serde_json::Value = serde_json::from_str(&json).unwrap();
        let cells = data["runs"][0]["cells"].as_array().unwrap();
        assert_eq!(cells.len(), view.measured().count());
        let (_, first) = view.measured().next().unwrap();
        let samples = cells[0]["stages"][0]["samples"]["steps"].as_array().unwrap();
        assert_eq!(samples.len(), first.stages[0].samples_ns.len());
    }
}
