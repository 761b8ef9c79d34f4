//! How far the figures of a run can be trusted.

use std::collections::BTreeSet;

use itertools::Itertools;

use super::super::format::{self, Table};
use super::super::{ReportView, trust};
use crate::experiments::{CHANCE, Verdict};
use crate::record::{FrameRecord, Run};
use crate::statistics;

/// How many verdicts chance alone would bring about.
fn claims(view: &ReportView<'_>, table: &mut Table) {
    let rulings = || view.sections.iter().flat_map(|section| section.rulings());
    let tested = rulings().filter(|ruling| ruling.verdict != Verdict::NotRun);
    let sampled = tested.filter(|ruling| ruling.n.is_some()).count();
    if sampled > 0 {
        let expected = CHANCE * sampled as f64;
        table.row([
            "verdicts by chance".to_owned(),
            format!(
                "{sampled} claims rest on samples: at most {expected:.1} of them would be supported by chance, \
                 and as many contradicted, if the figures of all lay exactly at their bounds"
            ),
        ]);
    }
}

fn precision(view: &ReportView<'_>, table: &mut Table) {
    let widths = trust::half_widths(view);
    let Some((worst, cell)) = widths.iter().max_by(|a, b| a.0.total_cmp(&b.0)) else { return };
    let all: Vec<f64> = widths.iter().map(|(width, _)| *width).collect();
    let fewest = view.timed().map(|(_, measured)| measured.frame.untimed.n).min().unwrap_or(0);
    table.row([
        "half width of the frame times' 95 % intervals".to_owned(),
        format!(
            "{} in the median cell, at worst {} ({} {}); n ≥ {fewest}",
            format::percent(statistics::median(&all)),
            format::percent(*worst),
            cell.experiment,
            cell.cell
        ),
    ]);
}

/// The cost of timing, in words.
fn timing_cost(view: &ReportView<'_>) -> String {
    let cost = trust::timing_cost(view);
    let [low, high] = cost.ends();
    let [median, low, high] = [cost.median, low, high].map(|ratio| format::percent(ratio - 1.0));
    format!("{median} ({low} – {high}) over {} pairs of frames taken in alternation", cost.n)
}

/// How far the figures can be trusted: clock, precision, accounting, the cost of timing, efficiency, memory.
pub fn write(view: &ReportView<'_>, run: &Run, table: &mut Table) {
    table.row(["clock".to_owned(), trust::conditions(run)]);
    claims(view, table);
    precision(view, table);
    let frames = || view.timed().map(|(cell, measured)| (cell, &measured.frame));
    let worst = |share: &dyn Fn(&FrameRecord) -> f64| {
        let worst = frames()
            .map(|(cell, frame)| (share(frame), cell))
            .filter(|(share, _)| share.is_finite())
            .max_by(|a, b| a.0.total_cmp(&b.0));
        worst.map(|(share, cell)| {
            format!("at worst {} ({} {})", format::percent(share), cell.experiment, cell.cell)
        })
    };
    let typical = |share: &dyn Fn(&FrameRecord) -> f64| {
        let shares: Vec<f64> = frames().map(|(_, frame)| share(frame)).collect();
        format::percent(statistics::median(&shares))
    };
    let accounting = |frame: &FrameRecord| frame.accounting_error;
    if let Some(worst_accounting) = worst(&accounting) {
        table.row([
            "frame accounting, stages + gaps against envelope".to_owned(),
            format!("{} in the median cell, {worst_accounting}", typical(&accounting)),
        ]);
        table.row(["cost of timing, timed over untimed frame".to_owned(), timing_cost(view)]);
    }
    table.row([
        "cost of a submission as the audit measured it".to_owned(),
        run.submit_cost_ns
            .iter()
            .map(|(kind, ns)| {
                format!("{} {} ms", kind.name(), format::three(ns / format::NS_PER_MS))
            })
            .collect::<Vec<_>>()
            .join(", "),
    ]);
    let rejected: u32 = view.measured().map(|(_, measured)| measured.rejected_frames()).sum();
    table.row(["frames rejected".to_owned(), rejected.to_string()]);
    throttled(view, table);
    ended(view, table);
}

fn ended(view: &ReportView<'_>, table: &mut Table) {
    let wall_s: f64 = view.ends.iter().map(|end| end.measuring_wall_s).sum();
    let gpu_s: f64 = view.ends.iter().map(|end| end.measured_gpu_s).sum();
    let set_up_s: f64 = view.ends.iter().map(|end| end.set_up_s).sum();
    if gpu_s > 0.0 {
        table.row([
            "harness efficiency, wall over GPU time".to_owned(),
            format!(
                "{:.2} ({} s wall, {} s GPU; set-up {} s apart)",
                wall_s / gpu_s,
                format::three(wall_s),
                format::three(gpu_s),
                format::three(set_up_s)
            ),
        ]);
    }
    let parts = trust::set_up_parts(view).into_iter();
    let parts: Vec<String> =
        parts.map(|(part, s)| format!("{} {} s", part.name(), format::three(s))).collect();
    if !parts.is_empty() {
        table.row(["parts of the set-up".to_owned(), parts.join(", ")]);
    }
    if let Some(bytes) = view.ends.iter().filter_map(|end| end.peak_memory_bytes).max() {
        table.row(["peak memory of the process".to_owned(), format::mebibytes(bytes)]);
    }
    if view.ends.last().is_none_or(|end| end.interrupted) {
        table.row(["ended", "early: what was measured until then stands below"]);
    }
    if view.runs.len() > 1 {
        let runs = format!("{}, the latest described here", view.runs.len());
        table.row(["runs in these records".to_owned(), runs]);
    }
}

/// Cells of which a sample was taken while the driver held the clocks down.
fn throttled(view: &ReportView<'_>, table: &mut Table) {
    let mut reasons = BTreeSet::new();
    let mut cells = 0;
    for (_, measured) in view.timed() {
        let held = measured.frame.machine.iter().flat_map(|state| &state.throttle);
        let found: BTreeSet<&str> = held.map(String::as_str).collect();
        cells += usize::from(!found.is_empty());
        reasons.extend(found);
    }
    if cells > 0 {
        let reasons = reasons.into_iter().join(", ");
        table.row(["cells with clocks held down".to_owned(), format!("{cells}: {reasons}")]);
    }
}
