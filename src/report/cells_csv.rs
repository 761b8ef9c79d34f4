//! `cells.csv`: one row per cell and stage, as RFC 4180 has it. A cell without figures has one row with an empty stage.
//! The quantities of a cell stand in its first row only: they are many, and the same for all its stages.
//! A name that a spreadsheet would take for a formula has an apostrophe in front; see [`text::spreadsheet`].

use std::io::{self, Write};

use itertools::Itertools;

use super::{Entry, Exporter, OfRun, ReportView, RunExporter, Written};
use fathom_base::statistics::median;
use fathom_base::text;
use fathom_record::{
    Estimate, Fenced, Interval, Measured, Outcome, Run, StageRecord, Throttling, Work, machine,
};

pub const EXPORTER: RunExporter = Exporter {
    name: "csv",
    about: "one row per cell and stage",
    file: "cells.csv",
    written: Written::WithEveryReport,
    export: OfRun::Rows(export),
};

/// What stands in a column.
type OfCell = fn(&Entry<'_>) -> String;
type OfStage = fn(&StageRecord) -> String;
type OfFrame = fn(&Measured) -> String;

const OF_CELL: [(&str, OfCell); 10] = [
    ("experiment", |entry| entry.cell.experiment.clone()),
    ("cell", |entry| entry.cell.cell.clone()),
    ("pipeline", |entry| entry.cell.pipeline.clone()),
    ("scene", |entry| entry.cell.scene.clone()),
    ("stand_ins", |entry| entry.cell.stand_ins.join("; ")),
    ("adapter", |entry| of_run(entry, |run| run.adapter.title())),
    ("software", |entry| of_run(entry, |run| run.adapter.software.to_string())),
    ("profile", |entry| of_run(entry, |run| run.profile.to_string())),
    ("status", |entry| status(entry)[0].to_owned()),
    ("reason", |entry| status(entry)[1].to_owned()),
];

/// No figures of a time that is below the resolution, which then stands alone.
const OF_STAGE: [(&str, OfStage); 8] = [
    ("stage", |stage| stage.stage.to_string()),
    ("clock", |stage| {
        let clock = serde_json::to_value(stage.clock).unwrap_or_default();
        clock.as_str().unwrap_or_default().to_owned()
    }),
    ("median_ns", |stage| middle(&resolved(stage))),
    ("low_ns", |stage| end(&resolved(stage), |interval| interval.low)),
    ("high_ns", |stage| end(&resolved(stage), |interval| interval.high)),
    ("samples", |stage| stage.time.n.to_string()),
    ("submit_cost_median_ns", |stage| fenced(stage, |of| median(&of.submit_cost_samples_ns))),
    ("resolution_ns", |stage| fenced(stage, |of| of.resolution_ns)),
];

const OF_FRAME: [(&str, OfFrame); 12] = [
    ("frame_untimed_median_ns", |cell| middle(&cell.frame.untimed)),
    ("frame_untimed_low_ns", |cell| end(&cell.frame.untimed, |interval| interval.low)),
    ("frame_untimed_high_ns", |cell| end(&cell.frame.untimed, |interval| interval.high)),
    ("frame_untimed_samples", |cell| cell.frame.untimed.n.to_string()),
    ("accounting_error", |cell| number(cell.frame.accounting_error)),
    ("timing_cost", |cell| number(cell.frame.timing_cost.median)),
    ("allocated_bytes", |cell| cell.allocated_bytes.to_string()),
    ("warm_up_frames", |cell| cell.warm_up_frames.to_string()),
    ("rejected_frames", |cell| cell.rejected_frames().to_string()),
    // Samples whose state of the machine is known, those that were taken while heat or power held clocks down, and why.
    ("machine_samples", |cell| cell.frame.machine.len().to_string()),
    ("throttled_samples", |cell| held(cell).map_or(0, |held| held.throttled).to_string()),
    ("throttle_reasons", |cell| {
        held(cell).map_or_else(String::new, |held| machine::words(&held.reasons))
    }),
];

fn export(view: &ReportView<'_>, to: &mut dyn Write) -> io::Result<()> {
    let of_cell = OF_CELL.iter().map(|(name, _)| *name);
    let of_stage = OF_STAGE.iter().map(|(name, _)| *name).chain(Work::NAMES.iter().copied());
    let of_frame = OF_FRAME.iter().map(|(name, _)| *name).chain(["quantities"]);
    let header = of_cell.chain(of_stage).chain(of_frame);
    let header = header.map(str::to_owned).collect_vec();
    let columns = header.len();
    let mut writer = csv::WriterBuilder::new().terminator(csv::Terminator::CRLF).from_writer(to);
    let rows = view.entries().flat_map(|entry| rows(entry, columns));
    for row in std::iter::once(header).chain(rows) {
        writer.write_record(row.iter().map(|field: &String| text::spreadsheet(field)))?;
    }
    writer.flush()
}

fn rows(entry: &Entry<'_>, columns: usize) -> Vec<Vec<String>> {
    let of_cell = OF_CELL.iter().map(|(_, field)| field(entry)).collect_vec();
    let Some(measured) = entry.cell.measured() else {
        let mut row = of_cell;
        row.resize(columns, String::new());
        return vec![row];
    };
    let row = |(index, stage): (usize, &StageRecord)| {
        let work = stage.work.fields().into_iter().map(|(_, count)| count.to_string()).collect();
        let quantities = if index == 0 { quantities(measured) } else { String::new() };
        let of_stage = OF_STAGE.iter().map(|(_, field)| field(stage)).collect();
        let of_frame = OF_FRAME.iter().map(|(_, field)| field(measured)).collect();
        [of_cell.clone(), of_stage, work, of_frame, vec![quantities]].concat()
    };
    measured.stages.iter().enumerate().map(row).collect()
}

fn of_run(entry: &Entry<'_>, field: fn(&Run) -> String) -> String {
    entry.run.map(field).unwrap_or_default()
}

/// What became of a cell, and why.
fn status<'e>(entry: &'e Entry<'_>) -> [&'e str; 2] {
    match &entry.cell.outcome {
        Outcome::Measured(_) => ["measured", ""],
        Outcome::Skipped { reason } => ["skipped", reason],
        Outcome::Failed { reason } => ["failed", reason],
        Outcome::OverBudget => ["not run", "budget"],
    }
}

fn resolved(stage: &StageRecord) -> Estimate {
    if stage.is_resolved() { stage.time } else { Estimate::default() }
}

fn fenced(stage: &StageRecord, field: fn(&Fenced) -> f64) -> String {
    stage.fenced.as_ref().map(|fenced| number(field(fenced))).unwrap_or_default()
}

fn held(cell: &Measured) -> Option<Throttling> {
    Throttling::of(&cell.frame.machine)
}

/// Empty where it is not finite.
fn number(value: f64) -> String {
    if value.is_finite() { value.to_string() } else { String::new() }
}

fn middle(estimate: &Estimate) -> String {
    if estimate.n > 0 { number(estimate.median) } else { String::new() }
}

fn end(estimate: &Estimate, end: fn(&Interval) -> f64) -> String {
    estimate.interval.as_ref().map_or_else(String::new, |interval| number(end(interval)))
}

/// `NAME=VALUE` of each quantity and error.
fn quantities(measured: &Measured) -> String {
    let figures = measured.figures();
    figures.iter().map(|(name, value)| format!("{name}={}", number(*value))).join("; ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use fathom_experiments::fixtures;
    use fathom_record::{Cell, MachineState, Record};

    fn exported(records: &[Record]) -> Vec<u8> {
        let mut bytes = Vec::new();
        export(&ReportView::new(records, None), &mut bytes).unwrap();
        bytes
    }

    #[test]
    fn every_row_has_every_column() {
        let records = fixtures::run();
        let text = exported(&records);
        let mut reader = csv::Reader::from_reader(&text[..]);
        assert_eq!(reader.headers().unwrap().len(), 38);
        let rows: Vec<csv::StringRecord> = reader.records().map(Result::unwrap).collect();
        assert!(rows.len() > 20);
        assert!(rows.iter().any(|row| &row[8] == "skipped"));
    }

    #[test]
    fn quantities_stand_once_for_each_cell() {
        let records = fixtures::run();
        let view = ReportView::new(&records, None);
        let text = exported(&records);
        let mut reader = csv::Reader::from_reader(&text[..]);
        let rows = reader.records().map(Result::unwrap);
        let told = rows.filter(|row| row[37].contains('=')).count();
        let with_figures = view.measured().filter(|(_, measured)| !measured.figures().is_empty());
        assert_eq!(told, with_figures.count());
    }

    #[test]
    fn a_throttled_cell_says_how_often_and_why() {
        let mut records = fixtures::run();
        let measured = fixtures::cells(&mut records).find_map(Cell::measured_mut);
        let state = |throttle| MachineState { throttle, ..MachineState::default() };
        use fathom_record::ThrottleReason::{GpuIdle, SwPowerCap};
        measured.unwrap().frame.machine = vec![state(vec![GpuIdle]), state(vec![SwPowerCap])];
        let text = exported(&records);
        let mut reader = csv::Reader::from_reader(&text[..]);
        let rows: Vec<csv::StringRecord> = reader.records().map(Result::unwrap).collect();
        let told = |row: &csv::StringRecord| [34, 35, 36].map(|column| row[column].to_owned());
        let measured = rows.iter().filter(|row| &row[8] == "measured").map(told);
        let kinds: std::collections::BTreeSet<[String; 3]> = measured.collect();
        let expected = [["0", "0", ""], ["2", "1", "sw power cap"]];
        assert_eq!(kinds, expected.map(|row| row.map(str::to_owned)).into());
    }

    #[test]
    fn a_time_below_the_resolution_has_no_figures_but_its_bound() {
        let mut records = fixtures::run();
        let measured = fixtures::cells(&mut records).find_map(Cell::measured_mut);
        let stage = &mut measured.unwrap().stages[0];
        stage.time =
            Estimate { median: 5e4, interval: Some(Interval { low: 5e4, high: 6e4 }), n: 7 };
        stage.fenced = Some(Fenced {
            wall_samples_ns: vec![6e4; 7],
            submit_cost_samples_ns: vec![6e4; 7],
            resolution_ns: 5e4,
        });
        let fields = OF_STAGE[2..].iter().map(|(_, field)| field(stage)).collect_vec();
        assert_eq!(fields, ["", "", "", "7", "60000", "50000"]);
        assert_eq!(crate::format::stage_ms(stage), "< 0.0500");
    }
}
