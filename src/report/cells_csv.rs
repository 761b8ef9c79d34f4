//! `cells.csv`: a row for each cell's frame, with the stage `frame`, and one for each of its stages, as RFC 4180 has it, with a column for each
//! axis of the run's cells. What is of the whole frame stands in its row alone, so that a sum over rows counts it once. A cell without
//! figures has one row with an empty stage. An axis with numbers beside words has a second column for the words: a column has one type.
//! A name that a spreadsheet would take for a formula has an apostrophe in front; see [`text::spreadsheet`].

use itertools::Itertools;
use serde_json::Value;

use super::{Exporter, Report, RunCell, RunExporter, RunFormat, Timing};
use fathom_base::statistics::{mean, median, quantile};
use fathom_base::text;
use fathom_experiments::label_text;
use fathom_record::{
    Build, CeilingShare, Cell, ErrorFigure, Estimate, Fenced, Interval, Measured, Run, StageRecord,
    Throttling, Work, machine,
};

pub const EXPORTER: RunExporter = Exporter {
    name: "csv",
    about: "a row for each cell's frame and for each of its stages",
    file: "cells.csv",
    written: Timing::WithEveryReport,
    export: RunFormat::One(export),
};

type CellField = fn(&RunCell<'_>) -> String;
type StageField = fn(&StageRecord) -> String;
type FrameField = fn(&Measured) -> String;
type ErrorField = fn(&ErrorFigure) -> String;

const CELL_COLUMNS: [(&str, CellField); 14] = [
    ("experiment", |entry| entry.cell.experiment.clone()),
    ("cell", |entry| entry.cell.cell.clone()),
    ("pipeline", |entry| entry.cell.pipeline.clone()),
    ("scene", |entry| entry.cell.scene.clone()),
    ("stand_ins", |entry| entry.cell.stand_ins.join("; ")),
    ("adapter", |entry| run_field(entry, |run| run.adapter.title())),
    ("software", |entry| run_field(entry, |run| run.adapter.software.to_string())),
    ("profile", |entry| run_field(entry, |run| run.profile.to_string())),
    ("driver", |entry| {
        run_field(entry, |run| format!("{} {}", run.adapter.driver, run.adapter.driver_info))
    }),
    ("machine", |entry| run_field(entry, |run| run.conditions.host.clone().unwrap_or_default())),
    ("commit", |entry| {
        run_field(entry, |run| run.build.as_ref().map(Build::to_string).unwrap_or_default())
    }),
    ("started_at", |entry| run_field(entry, |run| run.started_at.clone())),
    ("status", |entry| entry.cell.outcome.words()[0].to_owned()),
    ("reason", |entry| entry.cell.outcome.words()[1].to_owned()),
];

/// No figures of a time that is below the resolution, which then stands alone.
const STAGE_COLUMNS: [(&str, StageField); 13] = [
    ("stage", |stage| stage.stage.to_string()),
    ("clock", |stage| {
        let clock = serde_json::to_value(stage.clock).unwrap_or_default();
        clock.as_str().unwrap_or_default().to_owned()
    }),
    ("median_ns", |stage| middle(&resolved(stage))),
    ("low_ns", |stage| end(&resolved(stage), |interval| interval.low)),
    ("high_ns", |stage| end(&resolved(stage), |interval| interval.high)),
    ("p95_ns", |stage| tail(resolved_samples(stage), 0.95)),
    ("p99_ns", |stage| tail(resolved_samples(stage), 0.99)),
    ("max_ns", |stage| tail(resolved_samples(stage), 1.0)),
    ("samples", |stage| stage.samples_ns.len().to_string()),
    ("submit_cost_median_ns", |stage| fenced(stage, |of| median(&of.submit_cost_samples_ns))),
    ("resolution_ns", |stage| fenced(stage, |of| of.resolution_ns)),
    ("limit", |stage| stage.ceiling.as_ref().map(CeilingShare::limit_name).unwrap_or_default()),
    ("limit_share", |stage| optional(stage.ceiling.as_ref().map(|of| of.share))),
];

/// The first error that judges the stage's output: the others are among the quantities.
const ERROR_COLUMNS: [(&str, ErrorField); 3] = [
    ("error", |error| number(error.value)),
    ("error_name", |error| error.name.clone()),
    ("error_unit", |error| error.unit.clone()),
];

const FRAME_COLUMNS: [(&str, FrameField); 18] = [
    ("frame_untimed_median_ns", |cell| middle(&cell.frame.untimed)),
    ("frame_untimed_low_ns", |cell| end(&cell.frame.untimed, |interval| interval.low)),
    ("frame_untimed_high_ns", |cell| end(&cell.frame.untimed, |interval| interval.high)),
    ("frame_untimed_p95_ns", |cell| tail(&cell.frame.untimed_samples_ns, 0.95)),
    ("frame_untimed_p99_ns", |cell| tail(&cell.frame.untimed_samples_ns, 0.99)),
    ("frame_untimed_max_ns", |cell| tail(&cell.frame.untimed_samples_ns, 1.0)),
    ("frame_untimed_samples", |cell| cell.frame.untimed_samples_ns.len().to_string()),
    ("frame_in_no_stage_ns", |cell| optional(cell.is_timed().then(|| cell.in_no_stage_ns()))),
    ("visits", |cell| {
        cell.frame.visits.last().map_or_else(String::new, |last| (last + 1).to_string())
    }),
    ("frame_energy_j", |cell| optional(energy_j(cell))),
    ("accounting_error", |cell| number(cell.frame.accounting_error)),
    ("timing_cost", |cell| number(cell.frame.timing_cost.median)),
    ("allocated_bytes", |cell| cell.allocated_bytes.to_string()),
    ("warm_up_frames", |cell| cell.warm_up_frames.to_string()),
    ("rejected_frames", |cell| cell.rejected_frames().to_string()),
    // Samples whose state of the machine is known, those that were taken while heat or power held clocks down, and why.
    ("machine_samples", |cell| cell.frame.machine.len().to_string()),
    ("throttled_samples", |cell| throttling(cell).map_or(0, |held| held.throttled).to_string()),
    ("throttle_reasons", |cell| {
        throttling(cell).map_or_else(String::new, |held| machine::words(&held.reasons))
    }),
];

fn export(view: &Report<'_>) -> String {
    let axes = axis_columns(view);
    let of_cell = CELL_COLUMNS.iter().map(|(name, _)| (*name).to_owned());
    let of_axes = axes.iter().map(AxisColumn::title);
    let of_stage =
        STAGE_COLUMNS.iter().map(|(name, _)| *name).chain(ERROR_COLUMNS.map(|(name, _)| name));
    let of_frame = FRAME_COLUMNS.iter().map(|(name, _)| *name).chain(["quantities"]);
    let others = of_stage.chain(Work::NAMES.iter().copied()).chain(of_frame);
    let header = of_cell.chain(of_axes).chain(others.map(str::to_owned)).collect_vec();
    let columns = header.len();
    let mut writer =
        csv::WriterBuilder::new().terminator(csv::Terminator::CRLF).from_writer(Vec::new());
    let rows = view.entries().flat_map(|entry| rows(entry, &axes, columns));
    for row in std::iter::once(header).chain(rows) {
        // Writing to memory does not fail.
        let _ = writer.write_record(row.iter().map(|field: &String| text::spreadsheet(field)));
    }
    String::from_utf8(writer.into_inner().unwrap_or_default()).unwrap_or_default()
}

/// A column of an axis: all its values, or of one with both only the numbers or the words.
struct AxisColumn<'a> {
    name: &'a str,
    only_words: Option<bool>,
}

fn axis_columns<'a>(view: &'a Report<'_>) -> Vec<AxisColumn<'a>> {
    let axes = || view.entries().flat_map(|entry| &entry.cell.axes);
    let columns = axes().map(|(name, _)| name.as_str()).unique().flat_map(|name| {
        let mut kinds = axes().filter(|(of, _)| *of == name).map(|(_, value)| !value.is_number());
        let both = !kinds.all_equal();
        let kinds = if both { vec![Some(false), Some(true)] } else { vec![None] };
        kinds.into_iter().map(move |only_words| AxisColumn { name, only_words })
    });
    columns.collect()
}

impl AxisColumn<'_> {
    fn title(&self) -> String {
        let words = if self.only_words == Some(true) { ":text" } else { "" };
        format!("axis:{}{words}", self.name)
    }

    fn text(&self, cell: &Cell) -> String {
        let value = cell.axes.get(self.name);
        let is_here = |value: &&Value| self.only_words.is_none_or(|of| of != value.is_number());
        value.filter(is_here).map_or_else(String::new, label_text)
    }
}

fn rows(entry: &RunCell<'_>, axes: &[AxisColumn<'_>], columns: usize) -> Vec<Vec<String>> {
    let of_cell = CELL_COLUMNS.iter().map(|(_, field)| field(entry));
    let of_axes = axes.iter().map(|column| column.text(entry.cell));
    let of_cell = of_cell.chain(of_axes).collect_vec();
    let Some(measured) = entry.cell.measured() else {
        let mut row = of_cell;
        row.resize(columns, String::new());
        return vec![row];
    };
    let of_frame = FRAME_COLUMNS.iter().map(|(_, field)| field(measured)).collect_vec();
    let empty = vec![String::new(); columns - of_cell.len() - 1 - of_frame.len() - 1];
    let frame = vec!["frame".to_owned()];
    let frame = [of_cell.clone(), frame, empty, of_frame, vec![quantities(measured)]].concat();
    let row = |stage: &StageRecord| {
        let work = stage.work.fields().into_iter().map(|(_, count)| count.to_string()).collect();
        let of_stage = STAGE_COLUMNS.iter().map(|(_, field)| field(stage)).collect();
        let error = measured.errors.iter().find(|error| error.stage == stage.stage);
        let of_error = ERROR_COLUMNS.map(|(_, field)| error.map_or_else(String::new, field));
        let mut row = [of_cell.clone(), of_stage, of_error.into(), work].concat();
        row.resize(columns, String::new());
        row
    };
    std::iter::once(frame).chain(measured.stages.iter().map(row)).collect()
}

fn run_field(entry: &RunCell<'_>, field: fn(&Run) -> String) -> String {
    entry.run.map(field).unwrap_or_default()
}

/// What became of a cell, and why.
fn resolved(stage: &StageRecord) -> Estimate {
    if stage.is_resolved() { stage.time } else { Estimate::default() }
}

fn resolved_samples(stage: &StageRecord) -> &[f64] {
    if stage.is_resolved() { &stage.samples_ns } else { &[] }
}

fn tail(samples: &[f64], share: f64) -> String {
    optional(percentile(samples, share))
}

fn optional(value: Option<f64>) -> String {
    value.map_or_else(String::new, number)
}

/// The value below which this share of the samples lies; none where less than one of them is expected beyond it. Of all: the largest.
pub fn percentile(samples: &[f64], share: f64) -> Option<f64> {
    let beyond = samples.len() as f64 * (1.0 - share);
    let is_known = if share < 1.0 { beyond.round() >= 1.0 } else { !samples.is_empty() };
    is_known.then(|| quantile(samples, share))
}

/// Energy of a frame: the mean power at the cell's samples times the frame's time.
fn energy_j(cell: &Measured) -> Option<f64> {
    let watts = cell.frame.machine.iter().filter_map(|state| state.power_w).collect_vec();
    let is_known = !watts.is_empty() && cell.is_timed();
    is_known.then(|| mean(watts) * cell.frame.untimed.median * 1e-9)
}

fn fenced(stage: &StageRecord, field: fn(&Fenced) -> f64) -> String {
    stage.fenced.as_ref().map(|fenced| number(field(fenced))).unwrap_or_default()
}

fn throttling(cell: &Measured) -> Option<Throttling> {
    Throttling::from_states(&cell.frame.machine)
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
    use std::collections::BTreeMap;

    use super::*;
    use fathom_experiments::fixtures;
    use fathom_record::ThrottleReason::{GpuIdle, SwPowerCap};
    use fathom_record::{MachineState, Record};

    fn exported(records: &[Record]) -> String {
        export(&Report::new(records, None))
    }

    #[test]
    fn rows_are_tidy_and_tails_need_their_samples() {
        let mut records = fixtures::run();
        let cell = fixtures::cells(&mut records).find(|cell| !cell.axes.is_empty()).unwrap();
        let cells = [cell.experiment.clone(), cell.cell.clone()];
        let axis = cell.axes.keys().next().unwrap().clone();
        let value = label_text(&cell.axes[&axis]);
        let measured = cell.measured_mut().unwrap();
        let stage = &mut measured.stages[0];
        (stage.fenced, stage.samples_ns) = (None, (1..=100).map(f64::from).collect());
        measured.errors = vec![ErrorFigure::new("e", 0.25, "m", &stage.stage)];
        measured.frame.untimed_samples_ns = (1..=20).map(f64::from).collect();
        measured.frame.untimed.median = 2e9;
        let state = |(power_w, reason)| {
            let throttle = vec![reason];
            MachineState { power_w, throttle, ..MachineState::default() }
        };
        let states = [(Some(10.0), GpuIdle), (Some(30.0), SwPowerCap), (None, GpuIdle)];
        measured.frame.machine = states.map(state).into();
        let text = exported(&records);
        let mut reader = csv::Reader::from_reader(text.as_bytes());
        let head = reader.headers().unwrap().clone();
        let rows = reader.records().map(Result::unwrap);
        let mut of_cell = rows.filter(|row| row[0] == *cells[0] && row[1] == *cells[1]);
        let (frame, row) = (of_cell.next().unwrap(), of_cell.next().unwrap());
        for (name, expected) in [
            (&*format!("axis:{axis}"), &*value),
            ("p95_ns", "95.05"),
            ("p99_ns", "99.01"),
            ("max_ns", "100"),
            ("error", "0.25"),
            ("error_name", "e"),
            ("frame_untimed_p95_ns", "19.05"),
            ("frame_untimed_p99_ns", ""),
            ("frame_untimed_max_ns", "20"),
            ("frame_energy_j", "40"),
            ("machine_samples", "3"),
            ("throttled_samples", "1"),
            ("throttle_reasons", "sw power cap"),
        ] {
            let place = head.iter().position(|column| column == name).expect(name);
            // What is of the frame stands in its row, and nowhere else.
            let of_frame = FRAME_COLUMNS.iter().any(|(column, _)| *column == name);
            let [here, other] = if of_frame { [&frame, &row] } else { [&row, &frame] };
            assert_eq!(&here[place], expected, "{name}");
            assert!(other[place].is_empty() || name.starts_with("axis:"), "{name}");
        }
        assert_eq!(&frame[head.iter().position(|column| column == "stage").unwrap()], "frame");
    }

    type Row = BTreeMap<String, String>;

    fn rows_of(text: &str) -> Vec<Row> {
        let mut reader = csv::Reader::from_reader(text.as_bytes());
        let head = reader.headers().unwrap().clone();
        let named = |row: csv::StringRecord| {
            head.iter().map(str::to_owned).zip(row.iter().map(str::to_owned)).collect()
        };
        reader.records().map(Result::unwrap).map(named).collect()
    }

    /// The times of stages, and what lies in none of them, which stands once. `tests/nightly/cells.py` joins runs.
    #[test]
    fn stages_and_gaps_of_a_cell_add_up_to_its_frame() {
        let mut records = fixtures::run();
        let mixed = |place: usize| [Value::from(5), "5x5".into()][place & 1].clone();
        for (place, cell) in fixtures::cells(&mut records).enumerate() {
            cell.axes.insert("mixed".to_owned(), mixed(place));
        }
        let rows = rows_of(&exported(&records));
        for cell in fixtures::cells(&mut records) {
            let Some(of) = cell.measured() else { continue };
            let resolved = of.stages.iter().filter(|stage| stage.is_resolved());
            let exact: f64 = resolved.map(|stage| stage.time.median).sum();
            let own = [("experiment", &cell.experiment), ("cell", &cell.cell)];
            let own =
                rows.iter().filter(|row| own.iter().all(|(name, value)| row[*name] == **value));
            assert_eq!(own.clone().filter(|row| row["stage"] == "frame").count(), 1);
            let has_figures = own.clone().filter(|row| row["quantities"].contains('=')).count();
            assert_eq!(has_figures, usize::from(!of.figures().is_empty()));
            let numbers = |name| own.clone().filter_map(move |row| row[name].parse::<f64>().ok());
            let sums = ["median_ns", "frame_in_no_stage_ns"].map(|name| numbers(name).sum::<f64>());
            let gaps = if of.is_timed() { of.in_no_stage_ns() } else { 0.0 };
            assert_eq!(sums, [exact, gaps], "{}", cell.cell);
        }
        let values = |name: &str| {
            let texts = rows.iter().filter_map(|row| row.get(name));
            texts.filter(|text| !text.is_empty()).unique().cloned().collect_vec()
        };
        assert_eq!(values("axis:mixed"), ["5"]);
        assert_eq!(values("axis:mixed:text"), ["5x5"]);
    }

    #[test]
    fn every_column_is_documented() {
        let documented = include_str!("../../docs/exporters.md");
        let text = exported(&fixtures::run());
        let head = csv::Reader::from_reader(text.as_bytes()).headers().unwrap().clone();
        let is_listed = |name: &&str| name.starts_with("axis:") || Work::NAMES.contains(name);
        let of_work = [Work::NAMES[0], Work::NAMES[Work::NAMES.len() - 1]];
        let names = head.iter().filter(|name| !is_listed(name)).chain(of_work);
        let missing = names.filter(|name| !documented.contains(&format!("`{name}`")));
        assert_eq!(missing.collect_vec(), [""; 0]);
    }

    #[test]
    fn a_time_below_the_resolution_has_no_figures_but_its_bound() {
        let mut records = fixtures::run();
        let measured = fixtures::cells(&mut records).find_map(Cell::measured_mut);
        let stage = &mut measured.unwrap().stages[0];
        stage.samples_ns.truncate(7);
        stage.time =
            Estimate { median: 5e4, interval: Some(Interval { low: 5e4, high: 6e4 }), n: 7 };
        stage.fenced = Some(Fenced {
            wall_samples_ns: vec![6e4; 7],
            submit_cost_samples_ns: vec![6e4; 7],
            resolution_ns: 5e4,
        });
        let fields = STAGE_COLUMNS[2..11].iter().map(|(_, field)| field(stage)).collect_vec();
        assert_eq!(fields, ["", "", "", "", "", "", "7", "60000", "50000"]);
        assert_eq!(crate::format::stage_ms(stage), "< 0.0500");
    }
}
