//! Every cell as a row that can be sorted, filtered, opened, and measured again.

use std::path::Path;

use itertools::Itertools;
use maud::{Markup, html};

use super::setting_words;
use super::{Fold, Page, PageRun, PageSection};
use crate::RunCell;
use crate::cells_csv::percentile;
use crate::format::{NS_PER_MS, percent, three};
use fathom_base::text;
use fathom_experiments::Experiment;
use fathom_record::command::{cell_options, shown};
use fathom_record::{Cell, Estimate, Measured, Outcome, Run, StageRecord, Throttling};

pub const SECTION: PageSection = PageSection {
    id: "cells",
    title: "Cells",
    question: "What was measured in each cell, and with which command?",
    fold: Fold::Listed,
    write,
};

fn write(page: &Page<'_>) -> Option<Markup> {
    let rows = rows(page);
    let experiments: Vec<&str> = rows.iter().map(|row| row.experiment).unique().collect();
    if experiments.is_empty() {
        return None;
    }
    Some(html! {
        p.lead {
            "A row per cell; a click on a heading sorts. "
            span.script-only { "“stages” shows the cell's stages; “copy” copies the command that measures it again." }
        }
        div.controls.script-only {
            label { "Experiment "
                select #cell-experiment {
                    option value="" { "all" }
                    @for id in &experiments { option { (id) } }
                }
            }
            label { "Holds the words " input #cell-words type="search" size="24"; }
            output #cell-count {}
        }
        div.scroll tabindex="0" role="group" aria-label="Cells" {
            table #cell-table {
                thead { tr {
                    @if page.is_overlay() { th scope="col" { "Run" } }
                    @for title in ["Experiment", "Cell"] { th scope="col" { (title) } }
                    @for title in ["Frame (ms)", "± %", "n", "p95 (ms)", "p99 (ms)", "Worst (ms)", "Cost of timing"] { th.number scope="col" { (title) } }
                    th scope="col" { "Slowest stage" }
                    th.number scope="col" { "Its share" }
                    th.script-only scope="col" { "Look closer" }
                } }
                tbody {
                    @for one in &rows { (row(page, one)) }
                }
            }
        }
        p.script-only { button #cell-more type="button" hidden {} }
    })
}

/// A cell of a run, and where its samples are in the page's data.
struct CellRow<'a> {
    run: &'a PageRun<'a>,
    experiment: &'a str,
    entry: &'a RunCell<'a>,
    /// The run's place on the page, and the cell's among those that were measured.
    at: Option<[usize; 2]>,
}

/// Timed cells first.
fn rows<'a>(page: &'a Page<'a>) -> Vec<CellRow<'a>> {
    let mut rows = Vec::new();
    for (place, run) in page.runs.iter().enumerate() {
        let mut measured = 0..;
        for section in &run.view.sections {
            rows.extend(section.entries.iter().map(|entry| {
                let index = entry.cell.measured().and_then(|_| measured.next());
                let at = index.map(|index| [place, index]);
                CellRow { run, experiment: section.id, entry, at }
            }));
        }
    }
    let is_timed = |row: &CellRow<'_>| row.entry.cell.measured().is_some_and(Measured::is_timed);
    rows.sort_by_key(|row| !is_timed(row));
    rows
}

fn row(page: &Page<'_>, row: &CellRow<'_>) -> Markup {
    let CellRow { run, experiment, entry, at } = row;
    let cell = entry.cell;
    html! {
        tr data-experiment=(experiment) data-at=[at.map(|[run, cell]| format!("{run} {cell}"))] {
            @if page.is_overlay() { td { (run.label) } }
            td { (experiment) }
            th scope="row" title=(cell.cell) { (name(cell)) }
            @match &cell.outcome {
                Outcome::Measured(measured) => { (figures(measured)) }
                Outcome::Failed { reason } => { td.bad colspan="9" { "failed: " (reason) } }
                other => { td.faint colspan="9" { (other.words().join(": ")) } }
            }
            td.script-only {
                @if at.is_some() { button.stages type="button" { "stages" } " " }
                @if let Some(command) = command(cell, entry.run, run.view.folder.as_deref()) {
                    button.copy type="button" data-copy=(command) { "copy" }
                }
            }
        }
    }
}

/// What tells the cell from the others of its experiment, in words.
fn name(cell: &Cell) -> String {
    if cell.axes.is_empty() {
        return cell.cell.clone();
    }
    setting_words(&cell.axes)
}

fn figures(measured: &Measured) -> Markup {
    let Estimate { median, n, .. } = measured.frame.untimed;
    if !measured.is_timed() {
        return html! { td.faint colspan="9" { "its errors were asked for, not its time" } };
    }
    let half = measured.frame.untimed.relative_half_width();
    let slowest = slowest(measured);
    let total: f64 = measured.stages.iter().map(|stage| stage.time.median).sum();
    html! {
        td.number data-v=[finite(median)] {
            (three(median / NS_PER_MS))
            @if let Some(held) = Throttling::from_states(&measured.frame.machine) {
                " " span.chip.open title=(format!("Heat or power held the clocks down in {held}")) { "throttled" }
            }
        }
        td.number data-v=[finite(half).map(|half| half as f32)] { (three(100.0 * half)) }
        td.number data-v=(n) { (n) }
        (tails(&measured.frame.untimed_samples_ns))
        (cost(measured))
        @if let Some(stage) = slowest {
            td { (stage.stage) }
            td.number data-v=[finite(stage.time.median / total).map(|share| share as f32)] { (percent(stage.time.median / total)) }
        } @else {
            td.faint colspan="2" { "no stage is above the clock's resolution" }
        }
    }
}

/// Percentiles of the frame's times, where samples are enough for them, and the longest.
fn tails(samples_ns: &[f64]) -> Markup {
    html! {
        @for ns in [0.95, 0.99, 1.0].map(|share| percentile(samples_ns, share)) {
            td.number data-v=[ns] { (ns.map_or_else(|| "–".to_owned(), |ns| three(ns / NS_PER_MS))) }
        }
    }
}

/// A number to sort by; without one the cell's text counts.
fn finite(value: f64) -> Option<f64> {
    Some(value).filter(|value| value.is_finite())
}

fn cost(measured: &Measured) -> Markup {
    let share = measured.frame.timing_cost.median - 1.0;
    html! { td.number data-v=[finite(share).map(|share| share as f32)] { (format!("{:+.1} %", 100.0 * share)) } }
}

fn slowest(measured: &Measured) -> Option<&StageRecord> {
    let resolved = measured.stages.iter().filter(|stage| stage.is_resolved());
    resolved.max_by(|a, b| a.time.median.total_cmp(&b.time.median))
}

/// The command that measures a cell again, with the options of its run that it depends on. An experiment that is not built in is named
/// by its file in the run's folder, without which there is none.
pub fn command(cell: &Cell, run: Option<&Run>, folder: Option<&Path>) -> Option<String> {
    let id = &cell.experiment;
    let asked = run.and_then(|run| run.experiments.as_deref());
    let is_known =
        Experiment::builtin_text(id).is_some() || asked.is_some_and(|asked| asked.is_empty());
    let file =
        |name: &&String| **name == format!("{id}.toml") || !is_known && *name == "sweep.toml";
    let own = asked.unwrap_or_default().iter().find(file);
    let own = own.and_then(|name| Some(format!("{}/{name}", shown(folder?))));
    let experiment = own.or_else(|| is_known.then(|| id.clone()))?;
    let mut words = vec!["fathom".to_owned(), "run".to_owned(), text::shell(&experiment)];
    words.extend(["--cell".to_owned(), text::shell(&cell.cell)]);
    if let Some(run) = run {
        words.extend(["--profile".to_owned(), run.profile.to_string()]);
        words.extend(cell_options(&run.command).iter().map(|word| text::shell(word)));
    }
    Some(words.join(" "))
}

#[cfg(test)]
mod tests {
    use super::*;
    use fathom_experiments::fixtures;
    use fathom_record::{MachineState, ThrottleReason};

    #[test]
    fn a_throttled_cell_is_marked() {
        let mut records = fixtures::run();
        let measured = fixtures::cells(&mut records).find_map(Cell::measured_mut).unwrap();
        assert!(!figures(measured).0.contains("throttled"));
        let throttle = vec![ThrottleReason::PowerLimit];
        measured.frame.machine = vec![MachineState { throttle, ..MachineState::default() }];
        let marked = figures(measured).0;
        assert!(marked.contains("clocks down in 1 of 1 samples (power limit)"), "{marked}");
    }

    #[test]
    fn an_experiment_that_is_not_built_in_is_named_by_its_file() {
        let mut records = fixtures::run();
        let mut cell = fixtures::cells(&mut records).next().unwrap().clone();
        let again = |cell: &Cell, line: &str, file: &str| {
            let command = line.split(' ').map(str::to_owned).collect();
            let run = Run { command, experiments: Some(vec![file.to_owned()]), ..Run::default() };
            super::command(cell, Some(&run), Some(Path::new("out")))
        };
        let builtin = format!("fathom run {} --cell", cell.experiment);
        assert!(again(&cell, "fathom run a.toml", "a.toml").unwrap().starts_with(&builtin));
        cell.experiment = "own".to_owned();
        assert_eq!(again(&cell, "fathom run b.toml", "b.toml"), None);
        for (line, file) in [("run b.toml", "own.toml"), ("sweep hsao --set a=1", "sweep.toml")] {
            let command = again(&cell, &format!("fathom {line}"), file).unwrap();
            assert!(command.starts_with(&format!("fathom run out/{file} --cell ")), "{command}");
            assert!(!command.contains("--set"), "{command}");
        }
    }
}
