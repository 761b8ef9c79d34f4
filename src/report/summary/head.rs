//! The first screen: the device, the tally of verdicts, the slowest stages, how far to trust the run, and findings.

use std::fmt::Write as _;

use indexmap::IndexSet;
use itertools::Itertools;

use super::super::facts::{self, SlowStage};
use super::super::format::Table;
use super::super::noise::RunVerdict;
use super::super::{CELLS_CSV, LeftOut, ReportView, Section, page, trust};
use super::{cut, link};
use fathom_base::text;
use fathom_experiments::{Ruling, Whose};
use fathom_record::{OVER_BUDGET, Outcome, Run};

/// Pipelines whose slowest stage the first screen names.
const MOST_PIPELINES: usize = 10;
/// Notes that are shown.
const MOST_NOTES: usize = 5;

pub fn write(view: &ReportView<'_>, text: &mut String) {
    let Some(run) = view.run() else {
        *text += "# fathom\n\nThe records hold no run.\n\n";
        return;
    };
    *text += &format!("# fathom on {}\n\n", text::markdown(&run.adapter.title()));
    if run.adapter.software {
        *text += "> **Software driver.** Absolute times and frame rates say little about a GPU; ratios, \
                  exponents and shares are what to read.\n\n";
    }
    for line in RunVerdict::of(view).iter().flat_map(RunVerdict::lines) {
        let _ = writeln!(text, "- {}", text::markdown(&line));
    }
    text.push('\n');
    let mut table = Table::new(["", ""]);
    device(run, &mut table);
    results(view, &mut table);
    if let Some(run) = trust::worst(view) {
        let clock = format!("{}. {}", trust::conditions(run), trust::verdict(run));
        table.row(["clock", &clock]);
    }
    trust::facts(view).iter().for_each(|fact| table.row([fact.about, &fact.words]));
    *text += &table.markdown();
    let rest = [link("page", page::FILE), link(CELLS_CSV.file, CELLS_CSV.file)].join(" and ");
    let _ = writeln!(text, "\nEvery cell, picture and plot: {rest}.\n");
    notes(view, text);
}

fn device(run: &Run, table: &mut Table) {
    let adapter = &run.adapter;
    let kind = if adapter.software { "software driver" } else { "hardware" };
    table.row([
        "device".to_owned(),
        format!(
            "{} ({kind}, {}, {} {})",
            adapter.title(),
            adapter.backend,
            adapter.driver,
            adapter.driver_info
        ),
    ]);
    table.row([
        "run".to_owned(),
        format!(
            "{}{}, profile {}, shaders {}, started {}",
            run.shard.as_ref().map_or_else(String::new, |shard| format!("shard {shard}, ")),
            facts::program(run),
            run.profile,
            run.shader_checks,
            run.started_at
        ),
    ]);
    if let Some(machine) = &run.conditions.machine {
        table.row(["machine", &facts::machine(machine)]);
    }
    let command = text::code(&run.command.join(" "));
    table.row_of_markdown(["command".to_owned(), command.replace('|', "\\|")]);
}

fn results(view: &ReportView<'_>, table: &mut Table) {
    table.row(["cells".to_owned(), cells(view)]);
    for (whose, tally) in tallies(view) {
        table.row([whose.to_string(), tally]);
    }
    let slowest = slowest(view);
    if !slowest.is_empty() {
        table.row(["slowest stage of each pipeline".to_owned(), slowest]);
    }
}

fn cells(view: &ReportView<'_>) -> String {
    let mut counts = [0; 4];
    for entry in view.entries() {
        counts[match entry.cell.outcome {
            Outcome::Measured(_) => 0,
            Outcome::Skipped { .. } => 1,
            Outcome::Failed { .. } => 2,
            Outcome::OverBudget => 3,
        }] += 1;
    }
    let [measured, skipped, failed, over_budget] = counts;
    format!("{measured} measured, {skipped} skipped, {failed} failed, {over_budget} {OVER_BUDGET}")
}

/// `65 supported, 17 contradicted, 3 near the bound, 1 inconclusive, 10 not run, of 96; 30 (our bound)`
pub fn tallies(view: &ReportView<'_>) -> impl Iterator<Item = (Whose, String)> {
    facts::tallies(view).map(|(whose, counts)| {
        let each = counts.iter().map(|(verdict, count)| format!("{count} {verdict}")).join(", ");
        let all: usize = counts.iter().map(|(_, count)| count).sum();
        let rulings = view.sections.iter().flat_map(Section::rulings);
        let marks = rulings.filter(|ruling| ruling.whose == whose).map(Ruling::mark).counts();
        let marks = marks.into_iter().filter(|(mark, _)| !mark.is_empty()).sorted();
        let marks = marks.map(|(mark, count)| format!("{count}{mark}")).join(", ");
        let marks = if marks.is_empty() { marks } else { format!("; {marks}") };
        (whose, format!("{each}, of {all}{marks}"))
    })
}

/// The slowest stage of the first pipelines: `underwater: caustics/splat 41 % (39 – 43); hsao: …`
pub fn slowest(view: &ReportView<'_>) -> String {
    facts::slowest_stages(view).take(MOST_PIPELINES).map(slow).join("; ")
}

fn slow(SlowStage { frame, stage }: SlowStage<'_>) -> String {
    format!("{}: {} {}", frame.cell.pipeline, stage.stage.stage, facts::share(&stage.share))
}

/// Notes on the run, and the stand-ins that cells ran on, once each.
fn notes(view: &ReportView<'_>, text: &mut String) {
    let of_runs = view.runs.iter().flat_map(|run| &run.notes).map(|note| &note.text);
    let stand_ins = view.entries().flat_map(|entry| &entry.cell.stand_ins);
    let mut all: IndexSet<String> = of_runs.chain(stand_ins).cloned().collect();
    all.extend(
        view.left_out.iter().map(|LeftOut { what, reason }| format!("left out: {what}: {reason}")),
    );
    all.extend(view.sections.iter().flat_map(left_out));
    let adapters: IndexSet<String> = view.runs.iter().map(|run| run.adapter.title()).collect();
    if adapters.len() > 1 {
        all.insert(
            "These records hold cells of several adapters; cells.csv names the adapter of each."
                .to_owned(),
        );
    }
    all.extend(facts::still_open(view));
    if view.standing.is_none() && view.ends.last().is_none_or(|end| end.interrupted) {
        all.insert("The run ended early. What was measured until then is shown.".to_owned());
    }
    let (shown, more) = cut(all.into_iter().collect(), MOST_NOTES);
    for note in &shown {
        let _ = writeln!(text, "- Note: {}", text::markdown(note));
    }
    if !shown.is_empty() {
        let rest = if more.is_empty() { more } else { format!("-{more}\n") };
        let _ = writeln!(text, "{rest}");
    }
}

/// What an experiment cannot show, and why.
fn left_out(section: &Section<'_>) -> Vec<String> {
    let problem = section.problem.as_ref();
    let problem =
        problem.map(|problem| format!("{} has no claims and plots: {problem}", section.id));
    let missing = section.figure().missing.iter();
    let missing = missing.map(|(title, reason)| {
        format!("The plot “{title}” of {} is left out: {reason}", section.id)
    });
    problem.into_iter().chain(missing).collect()
}
