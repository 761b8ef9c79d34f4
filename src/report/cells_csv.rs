//! `cells.csv`: one row per cell and stage, as RFC 4180 has it. A cell without figures has one row with an empty stage.
//! The quantities of a cell stand in its first row only: they are many, and the same for all its stages.
//! A name that a spreadsheet would take for a formula has an apostrophe in front; see [`text::spreadsheet`].

use std::io::{self, Write};

use itertools::Itertools;

use super::{Entry, Exporter, OfRun, ReportView, RunExporter, Written};
use fathom_base::statistics::median;
use fathom_base::text;
use fathom_record::{
    Estimate, Fenced, Interval, MachineState, Measured, Outcome, StageRecord, Throttling, Work,
    machine,
};

pub const EXPORTER: RunExporter = Exporter {
    name: "csv",
    about: "one row per cell and stage",
    file: "cells.csv",
    written: Written::WithEveryReport,
    export: OfRun::Rows(export),
};

const OF_CELL: &str =
    "experiment cell pipeline scene stand_ins adapter software profile status reason";
const OF_STAGE: &str =
    "stage clock median_ns low_ns high_ns samples submit_cost_median_ns resolution_ns";
const OF_FRAME: &str = "frame_untimed_median_ns frame_untimed_low_ns frame_untimed_high_ns frame_untimed_samples \
    accounting_error timing_cost allocated_bytes warm_up_frames rejected_frames \
    machine_samples throttled_samples throttle_reasons quantities";

fn export(view: &ReportView<'_>, to: &mut dyn Write) -> io::Result<()> {
    let names = |names: &str| names.split(' ').map(str::to_owned).collect::<Vec<String>>();
    let work = Work::NAMES.iter().map(ToString::to_string).collect();
    let header = [names(OF_CELL), names(OF_STAGE), work, names(OF_FRAME)].concat();
    let mut writer = csv::WriterBuilder::new().terminator(csv::Terminator::CRLF).from_writer(to);
    let columns = header.len();
    let rows = view.entries().flat_map(|entry| rows(entry, columns));
    for row in std::iter::once(header).chain(rows) {
        writer.write_record(row.iter().map(|field: &String| text::spreadsheet(field)))?;
    }
    writer.flush()
}

fn rows(entry: &Entry<'_>, columns: usize) -> Vec<Vec<String>> {
    let unmeasured = |status: &str, reason: &str| {
        let mut fields = cell_fields(entry, status, reason);
        fields.resize(columns, String::new());
        vec![fields]
    };
    match &entry.cell.outcome {
        Outcome::Measured(measured) => {
            let cell = cell_fields(entry, "measured", "");
            let row = |(index, stage)| {
                let quantities = if index == 0 { quantities(measured) } else { String::new() };
                [cell.clone(), stage_fields(stage), frame_fields(measured), vec![quantities]]
                    .concat()
            };
            measured.stages.iter().enumerate().map(row).collect()
        }
        Outcome::Skipped { reason } => unmeasured("skipped", reason),
        Outcome::Failed { reason } => unmeasured("failed", reason),
    }
}

fn cell_fields(entry: &Entry<'_>, status: &str, reason: &str) -> Vec<String> {
    let cell = entry.cell;
    let run = |field: fn(&fathom_record::Run) -> String| entry.run.map(field).unwrap_or_default();
    vec![
        cell.experiment.clone(),
        cell.cell.clone(),
        cell.pipeline.clone(),
        cell.scene.clone(),
        cell.stand_ins.join("; "),
        run(|run| run.adapter.name.clone()),
        run(|run| run.adapter.software.to_string()),
        run(|run| run.profile.name().to_owned()),
        status.to_owned(),
        reason.to_owned(),
    ]
}

fn stage_fields(stage: &StageRecord) -> Vec<String> {
    let clock = serde_json::to_value(stage.clock).unwrap_or_default();
    let mut fields = vec![stage.stage.to_string(), clock.as_str().unwrap_or_default().to_owned()];
    fields.extend(time_fields(stage));
    fields.extend(stage.work.fields().map(|(_, count)| count.to_string()));
    fields
}

/// No figures of a time that is below the resolution, which then stands alone.
fn time_fields(stage: &StageRecord) -> Vec<String> {
    let mut fields = estimate_fields(&stage.time).to_vec();
    if !stage.is_resolved() {
        fields[..3].fill(String::new());
    }
    let of_fenced = |field: fn(&Fenced) -> f64| {
        stage.fenced.as_ref().map(|fenced| field(fenced).to_string()).unwrap_or_default()
    };
    fields.push(of_fenced(|fenced| median(&fenced.submit_cost_samples_ns)));
    fields.push(of_fenced(|fenced| fenced.resolution_ns));
    fields
}

fn frame_fields(measured: &Measured) -> Vec<String> {
    let frame = &measured.frame;
    let mut fields = estimate_fields(&frame.untimed).to_vec();
    fields.extend([
        frame.accounting_error.to_string(),
        frame.timing_cost.median.to_string(),
        measured.allocated_bytes.to_string(),
        measured.warm_up_frames.to_string(),
        measured.rejected_frames().to_string(),
    ]);
    fields.extend(machine_fields(&frame.machine));
    fields
}

/// Samples whose state of the machine is known, those that were taken while heat or power held clocks down, and why.
fn machine_fields(states: &[MachineState]) -> [String; 3] {
    let held = Throttling::of(states);
    let reasons = held.as_ref().map_or_else(String::new, |held| machine::words(&held.reasons));
    let throttled = held.map_or(0, |held| held.throttled);
    [states.len().to_string(), throttled.to_string(), reasons]
}

/// `NAME=VALUE` of each quantity and error.
fn quantities(measured: &Measured) -> String {
    let figures = measured.figures();
    figures.iter().map(|(name, value)| format!("{name}={value}")).join("; ")
}

fn estimate_fields(estimate: &Estimate) -> [String; 4] {
    let Estimate { median, interval, n } = estimate;
    let end = |end: fn(&Interval) -> f64| {
        interval.as_ref().map(end).map_or_else(String::new, |end| end.to_string())
    };
    let median = if *n > 0 { median.to_string() } else { String::new() };
    [median, end(|interval| interval.low), end(|interval| interval.high), n.to_string()]
}

#[cfg(test)]
mod tests {
    use super::*;
    use fathom_experiments::fixtures;
    use fathom_record::{Cell, Record};

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
        let expected = [["0", "0", ""], ["2", "1", "power cap"]];
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
        assert_eq!(time_fields(stage), ["", "", "", "7", "60000", "50000"]);
        assert_eq!(crate::format::stage_ms(stage), "< 0.0500");
    }
}
