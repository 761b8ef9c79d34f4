//! `summary.md`: what was measured, on what, how far to trust it, and what it says of the claims.

mod section;
mod trust;

use std::fmt::Write as _;

use indexmap::IndexSet;

use super::format::{self, Table};
use super::{Exporter, OfRun, ReportError, ReportView, RunExporter, Written};
use crate::experiments::Verdict;
use crate::record::{Outcome, Run};
use crate::text;

pub const EXPORTER: RunExporter = Exporter {
    name: "markdown",
    about: "the run, its tables, verdicts and links to plots and pictures",
    file: "summary.md",
    written: Written::WithEveryReport,
    export: OfRun::One(export),
};

fn export(view: &ReportView<'_>) -> Result<String, ReportError> {
    let mut text = String::new();
    match view.run() {
        Some(run) => header(view, run, &mut text),
        None => text += "# fathom\n\nThe records hold no run.\n\n",
    }
    overview(view, &mut text);
    for part in &view.sections {
        section::write(part, &mut text);
    }
    Ok(text)
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
    trust::write(view, run, &mut table);
    *text += &table.markdown();
    audit(run, text);
    notes(view, text);
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
