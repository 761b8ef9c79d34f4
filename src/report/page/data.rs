//! What the page's script reads: the samples of every cell and the plots, compressed.

use std::borrow::Cow;
use std::io::BufWriter;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;
use flate2::{Compression, GzBuilder};
use serde::{Serialize, Serializer};

use super::{Page, PageRun};
use crate::axis::tenth;
use crate::colors::StageColors;
use crate::format::NS_PER_MS;
use crate::plots::rooflines;
use crate::{ReportView, Section};
use fathom_record::{Cell, Measured};

/// Significant digits of a sample: a hundredth of a per cent, less than any clock resolves.
const DIGITS: i32 = 4;
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

/// Of an experiment, by its id, or a roofline, by the name of its file.
#[derive(Serialize)]
struct PlotData<'a> {
    name: Cow<'a, str>,
    svg: Cow<'a, str>,
}

/// Of a measured cell. Times are milliseconds; samples of one frame have the same index.
#[derive(Serialize)]
struct CellData<'a> {
    experiment: &'a str,
    cell: &'a str,
    stages: Vec<StageData<'a>>,
    envelope: Vec<f64>,
    gaps: Vec<f64>,
    untimed: Vec<f64>,
    /// Since the first sample of the run, in tenths of seconds.
    at_s: Vec<f64>,
}

#[derive(Serialize)]
struct StageData<'a> {
    stage: &'a str,
    clock: &'static str,
    samples: Vec<f64>,
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
        Some(PlotData { name: section.id.into(), svg: section.figure().svg.as_deref()?.into() })
    };
    let plots = run.view.sections.iter().filter_map(plot);
    let rooflines = rooflines(run.view).into_iter().filter_map(|file| {
        Some(PlotData { name: file.name.into(), svg: String::from_utf8(file.bytes).ok()?.into() })
    });
    let plots = plots.chain(rooflines).collect();
    RunData { label: &run.label, cells, plots }
}

fn of_cell<'a>(cell: &'a Cell, measured: &'a Measured, started_s: f64) -> CellData<'a> {
    let frame = &measured.frame;
    let stages = measured.stages.iter().map(|stage| StageData {
        stage: &stage.stage,
        clock: stage.clock.name(),
        samples: in_ms(&stage.samples_ns),
        below: (!stage.is_resolved()).then(|| rounded(stage.resolution_ns() / NS_PER_MS)),
    });
    CellData {
        experiment: &cell.experiment,
        cell: &cell.cell,
        stages: stages.collect(),
        envelope: in_ms(&frame.envelope_samples_ns),
        gaps: in_ms(&frame.gap_samples_ns),
        untimed: in_ms(&frame.untimed_samples_ns),
        at_s: frame.sampled_at_s.iter().map(|at_s| tenth(at_s - started_s)).collect(),
    }
}

fn in_ms(samples_ns: &[f64]) -> Vec<f64> {
    samples_ns.iter().map(|ns| rounded(ns / NS_PER_MS)).collect()
}

/// To [`DIGITS`] significant digits.
fn rounded(value: f64) -> f64 {
    if value == 0.0 || !value.is_finite() {
        return 0.0;
    }
    let digits = DIGITS - 1 - value.abs().log10().floor() as i32;
    format!("{value:.*}", digits.max(0) as usize).parse().unwrap_or(value)
}

#[cfg(test)]
mod tests {
    use std::io::Read as _;

    use super::*;
    use crate::testing;

    #[test]
    fn samples_keep_four_digits() {
        assert_eq!(
            [rounded(12.345_67), rounded(0.012_345_67), rounded(0.0)],
            [12.35, 0.012_35, 0.0]
        );
        assert_eq!(rounded(123_456.7), 123_457.0);
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
        let samples = cells[0]["stages"][0]["samples"].as_array().unwrap();
        assert_eq!(samples.len(), first.stages[0].samples_ns.len());
    }
}
