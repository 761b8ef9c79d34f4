//! `summary.md`: what was measured, on what, how far to trust it, and what it says of the claims.

mod section;

use std::fmt::Write as _;

use indexmap::IndexSet;

use super::format::{self, Table};
use super::{Artifact, Exporter, ReportError, ReportView};
use crate::experiments::Verdict;
use crate::record::{FrameRecord, Outcome, Run};
use crate::text;

pub const EXPORTER: Exporter = Exporter {
    name: "summary.md",
    about: "the run, its tables, verdicts and links to plots and pictures",
    export,
};

fn export(view: &ReportView<'_>) -> Result<Vec<Artifact>, ReportError> {
    let mut text = String::new();
    match view.run() {
        Some(run) => header(view, run, &mut text),
        None => text += "# fathom\n\nThe records hold no run.\n\n",
    }
    overview(view, &mut text);
    for part in &view.sections {
        section::write(part, &mut text);
    }
    Ok(vec![Artifact { name: EXPORTER.name.to_owned(), bytes: text.into_bytes() }])
}

fn header(view: &ReportView<'_>, run: &Run, text: &mut String) {
    let adapter = &run.adapter;
    *text += &format!("# fathom on {}\n\n", text::markdown(&adapter.name));
    if adapter.software {
        *text += "> Measured on a software driver. Ratios, slopes and shares stand; absolute times and \
                  frame rates count only on hardware.\n\n";
    }
    let mut table = Table::new(["", ""]);
    table.row([
        "adapter".to_owned(),
        format!("{} ({}, {})", adapter.name, adapter.device_type, adapter.backend),
    ]);
    table.row(["driver".to_owned(), format!("{} {}", adapter.driver, adapter.driver_info)]);
    table.row(["host threads".to_owned(), adapter.host_threads.to_string()]);
    table.row(["profile", run.profile.name()]);
    table.row(["shader checks", run.shader_checks.name()]);
    table.row(["started", &run.started_at]);
    table.row(["fathom", &run.fathom_version]);
    let command = text::code(&run.command.join(" "));
    table.row_of_markdown(["command".to_owned(), command.replace('|', "\\|")]);
    trust(view, run, &mut table);
    *text += &table.markdown();
    audit(run, text);
    notes(view, text);
}

/// The cost of timing over the pairs of all cells: one cell's few pairs tell the machine's noise rather.
fn timing_cost<'r>(frames: impl Iterator<Item = &'r FrameRecord>) -> String {
    let pairs: Vec<(f64, f64)> = frames
        .flat_map(|frame| {
            let timed = frame.envelope_samples_ns.iter().copied();
            timed.zip(frame.untimed_samples_ns.iter().copied())
        })
        .collect();
    let cost = crate::statistics::ratio_estimate(&pairs);
    let [low, high] = cost.ends();
    let [median, low, high] = [cost.median, low, high].map(|ratio| format::percent(ratio - 1.0));
    format!("{median} ({low} – {high}) over {} pairs of frames taken in alternation", cost.n)
}

/// How far the figures can be trusted: accounting, the cost of timing, efficiency, memory.
fn trust(view: &ReportView<'_>, run: &Run, table: &mut Table) {
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
        format::percent(crate::statistics::median(&shares))
    };
    let accounting = |frame: &FrameRecord| frame.accounting_error;
    if let Some(worst_accounting) = worst(&accounting) {
        table.row([
            "frame accounting, stages + gaps against envelope".to_owned(),
            format!("{} in the median cell, {worst_accounting}", typical(&accounting)),
        ]);
        table.row([
            "cost of timing, timed over untimed frame".to_owned(),
            timing_cost(frames().map(|(_, frame)| frame)),
        ]);
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

fn audit(run: &Run, text: &mut String) {
    let head = "clock|pass|context|clock (ms)|host (ms)|ratio|2 N / N|verdict|why";
    let mut table = Table::new(head.split('|'));
    for row in &run.audit {
        let verdict = if row.sound { "sound" } else { "unusable" };
        table.row([
            row.clock.name().to_owned(),
            row.pass.name().to_owned(),
            row.context.name().to_owned(),
            format::three(row.clock_ns / format::NS_PER_MS),
            format::three(row.host_ns / format::NS_PER_MS),
            format!("{:.3}", row.ratio),
            format!("{:.2}", row.doubling),
            verdict.to_owned(),
            row.reason.clone(),
        ]);
    }
    let about = "Each clock against the fenced host clock, for a kernel of N and of 2 N work.";
    table.add_to(text, &format!("## Clock audit\n\n{about}\n\n"));
}

/// Notes on the run, and the stand-ins that cells ran on.
fn notes(view: &ReportView<'_>, text: &mut String) {
    let of_runs = view.runs.iter().flat_map(|run| &run.notes).map(|note| &note.text);
    let stand_ins = view
        .sections
        .iter()
        .flat_map(|section| &section.entries)
        .flat_map(|entry| &entry.cell.stand_ins);
    let mut all: IndexSet<&str> = of_runs.chain(stand_ins).map(String::as_str).collect();
    let adapters: IndexSet<&str> = view.runs.iter().map(|run| run.adapter.name.as_str()).collect();
    if adapters.len() > 1 {
        all.insert("Cells of several adapters stand in these records; cells.csv names the adapter of each.");
    }
    if all.is_empty() {
        return;
    }
    *text += "## Notes\n\n";
    for note in all {
        let _ = writeln!(text, "- {}", text::markdown(note));
    }
    *text += "\n";
}

fn overview(view: &ReportView<'_>, text: &mut String) {
    let head =
        "experiment|measured|skipped|failed|claims supported|contradicted|inconclusive|not run";
    let mut table = Table::new(head.split('|'));
    for section in &view.sections {
        let count = |wanted: fn(&Outcome) -> bool| {
            let entries = section.entries.iter();
            entries.filter(|entry| wanted(&entry.cell.outcome)).count().to_string()
        };
        let rulings = section.rulings();
        let ruled = |wanted: Verdict| {
            let same = rulings.iter().filter(|ruling| ruling.verdict == wanted);
            same.count().to_string()
        };
        table.row_of_markdown([
            format!("[{}](#{})", text::markdown(section.id), text::link(section.id)),
            count(|outcome| matches!(outcome, Outcome::Measured(_))),
            count(|outcome| matches!(outcome, Outcome::Skipped { .. })),
            count(|outcome| matches!(outcome, Outcome::Failed { .. })),
            ruled(Verdict::Supported),
            ruled(Verdict::Contradicted),
            ruled(Verdict::Inconclusive),
            ruled(Verdict::NotRun),
        ]);
    }
    table.add_to(text, "## Experiments\n\n");
}

fn image(name: &str, path: &str) -> String {
    format!("![{}]({})", text::markdown(name), text::link(path))
}

#[cfg(test)]
mod tests {
    use crate::exporters::of_run as artifacts;
    use crate::report::fixtures;

    #[test]
    fn the_same_records_give_the_same_bytes() {
        let records = fixtures::run();
        assert_eq!(artifacts(&records, None).unwrap(), artifacts(&records, None).unwrap());
    }

    #[test]
    fn the_summary_tells_adapter_audit_claims_and_reasons() {
        let text = fixtures::summary(&fixtures::run());
        for expected in [
            "# fathom on llvmpipe",
            "count only on hardware",
            "| compute | mixed |",
            "unusable",
            "GeForce GTX 260",
            "| supported |",
            "(uw-photons.svg)",
            "device lost",
            "134,217,728",
            "harness efficiency",
        ] {
            assert!(text.contains(expected), "{expected}");
        }
    }

    #[test]
    fn tables_have_as_many_columns_in_every_row() {
        let text = fixtures::summary(&fixtures::run());
        let columns = |line: &str| line.replace("\\|", "").matches('|').count();
        let mut previous: Option<&str> = None;
        for line in text.lines() {
            if let Some(above) = previous.filter(|_| line.starts_with('|')) {
                assert_eq!(columns(above), columns(line), "{above}\n{line}");
            }
            previous = Some(line).filter(|line| line.starts_with('|'));
        }
    }

    #[test]
    fn no_records_give_a_summary_all_the_same() {
        let files = artifacts(&[], None).unwrap();
        assert!(files.iter().any(|file| file.name == "summary.md"));
    }
}
