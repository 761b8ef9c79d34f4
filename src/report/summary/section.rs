//! An experiment's part of the summary.

use std::collections::BTreeSet;
use std::fmt::Write as _;

use indexmap::IndexSet;

use super::super::format::{self, Table};
use super::super::plots;
use super::super::{Section, view::Entry};
use super::image;
use crate::experiments::schema::Published;
use crate::experiments::{Verdict, fits, fps};
use crate::record::{Cell, Estimate, Measured, Outcome, Picture, PictureKind, StageRecord};
use crate::text;

/// Cells beside each other in one table of stages.
const COLUMNS: usize = 6;
/// Pictures beside each other.
const ACROSS: usize = 4;
/// Notes on cells that stand in the open.
const UNFOLDED: usize = 3;

pub fn write(section: &Section<'_>, text: &mut String) {
    let _ = writeln!(text, "## {}\n", text::markdown(section.id));
    match &section.experiment {
        Some(experiment) => {
            let [title, source] =
                [&experiment.title, &experiment.source].map(|s| text::markdown(s));
            let _ = writeln!(text, "**{}** ({source})\n", title.trim());
            if !experiment.about.is_empty() {
                let _ = writeln!(text, "{}\n", text::paragraphs(&experiment.about));
            }
        }
        None => {
            let problem = section.problem.as_deref().unwrap_or_default();
            let _ = writeln!(text, "No claims and plots: {}\n", text::markdown(problem));
        }
    }
    let figure = section.figure();
    if figure.is_drawn() {
        let file = plots::file_name(section);
        let _ = writeln!(text, "{}\n", image(section.title(), &file));
    }
    for (title, reason) in &figure.missing {
        let title = text::markdown(title);
        let _ = writeln!(text, "The plot *{title}* is left out: {reason}.\n");
    }
    claims(section, text);
    for (title, table) in figure.map_tables() {
        let _ = writeln!(text, "{}:\n", text::markdown(&title));
        *text += &table.markdown();
    }
    frames(section, text);
    published(section, text);
    unmeasured(section, text);
    stages(section, text);
    throughput(section, text);
    quantities(section, text);
    cell_notes(section, text);
    gallery(&section.pictures, text);
}

/// Pictures side by side, each above its cell.
fn gallery(pictures: &[(&Cell, &Picture)], text: &mut String) {
    for row in pictures.chunks(ACROSS) {
        let images = row.iter().map(|(_, picture)| image(&picture.path, &picture.path));
        let mut table = Table::of_markdown(images);
        table.row(row.iter().map(|(cell, picture)| match picture.shows {
            PictureKind::Image => cell.cell.clone(),
            PictureKind::Error => format!("{}, error", cell.cell),
        }));
        *text += &table.markdown();
    }
    if pictures.iter().any(|(_, picture)| picture.shows == PictureKind::Error) {
        *text += "Pictures of the error: red where the picture is too dark, blue where it is too light, in full \
                  colour from ±0.25 on, grey where nothing is compared.\n\n";
    }
}

fn claims(section: &Section<'_>, text: &mut String) {
    let mut table = Table::new(["claim", "verdict", "n", "figure"]);
    for ruling in section.rulings() {
        let verdict = ruling.verdict.to_string();
        let n = match (ruling.verdict, ruling.n) {
            (Verdict::NotRun, _) => "–".to_owned(),
            (_, Some(n)) => n.to_string(),
            (_, None) => "exact".to_owned(),
        };
        table.row([&ruling.text, &verdict, &n, &ruling.reason]);
    }
    table.add_to(text, "");
}

/// Whole frames without stage timing, held against what was published for the same size.
fn frames(section: &Section<'_>, text: &mut String) {
    let head =
        "cell|scene|frame (ms, 95 %)|n|cost of timing|fps|published fps|measured / published|allocated"
            .split('|');
    let mut table = Table::new(head);
    for (cell, measured) in section.timed() {
        let rate = fps(&measured.frame.untimed);
        let published =
            section.experiment.as_ref().and_then(|experiment| experiment.published_for(cell));
        table.row([
            name(cell),
            cell.scene.clone(),
            format::ms(&measured.frame.untimed, &measured.frame.untimed_samples_ns),
            measured.frame.untimed.n.to_string(),
            timing_cost(measured),
            format::three(rate.median),
            published.map_or_else(|| "–".to_owned(), Published::figure),
            published.map_or_else(|| "–".to_owned(), |published| ratio(&rate, published)),
            format::mebibytes(measured.allocated_bytes),
        ]);
    }
    table.add_to(text, "Whole frames, not timed by stage:\n\n");
    if section.timed().any(|(_, measured)| is_marked(measured)) {
        *text += MARKED;
    }
}

/// Above this share the cost of timing is marked.
const MARKED_COST: f64 = 0.1;
const COST_MARK: &str = "!";
/// Said of tables with such cells.
const MARKED: &str = "`!`: timing costs more than 10 % of this cell's frame, so its stages take that much less in a frame that is not timed.\n\n";

fn is_marked(measured: &Measured) -> bool {
    measured.frame.timing_cost.median - 1.0 > MARKED_COST
}

/// The cost of timing as a share of the untimed frame.
fn timing_cost(measured: &Measured) -> String {
    let cost = format!("{:+.1} %", 100.0 * (measured.frame.timing_cost.median - 1.0));
    if is_marked(measured) { format!("{cost} {COST_MARK}") } else { cost }
}

/// A cell's name and its number of samples.
fn counted((cell, measured): &(&Cell, &Measured)) -> String {
    let mark = if is_marked(measured) { format!(" {COST_MARK}") } else { String::new() };
    format!("{}, n = {}{mark}", name(cell), measured.frame.untimed.n)
}

fn name(cell: &Cell) -> String {
    cell.cell.replace(',', ", ")
}

fn ratio(rate: &Estimate, published: &Published) -> String {
    let over = |fps: f64| format!("{}×", format::three(rate.median / fps));
    match published.fps_high {
        Some(high) => format!("{} – {}", over(high), over(published.fps)),
        None => over(published.fps),
    }
}

/// Which hardware the published figures come from, and which of them no cell is held against.
fn published(section: &Section<'_>, text: &mut String) {
    let Some(experiment) = &section.experiment else { return };
    let cells = section.cells();
    for published in &experiment.published {
        let met = cells.iter().any(|cell| fits(cell, &published.filter));
        let conditions: Vec<String> = crate::experiments::flatten(&published.filter)
            .iter()
            .map(|(path, value)| format!("{path} {}", crate::experiments::label_text(value)))
            .collect();
        let standing = if met { "" } else { "; no cell of this run has that size" };
        let note =
            if published.note.is_empty() { String::new() } else { format!("; {}", published.note) };
        let _ = writeln!(
            text,
            "- Published: {} fps on {} ({}{}){standing}.",
            text::markdown(&published.figure()),
            text::markdown(&published.hardware),
            text::markdown(&conditions.join(", ")),
            text::markdown(&note)
        );
    }
    if !experiment.published.is_empty() {
        *text += "\n";
    }
}

fn unmeasured(section: &Section<'_>, text: &mut String) {
    let mut table = Table::new(["cell not measured", "", "reason"]);
    for Entry { cell, .. } in &section.entries {
        match &cell.outcome {
            Outcome::Measured(_) => {}
            Outcome::Skipped { reason } => table.row([&name(cell), "skipped", reason]),
            Outcome::Failed { reason } => table.row([&name(cell), "failed", reason]),
        }
    }
    table.add_to(text, "");
}

/// Stage medians with intervals: stages down, cells across.
fn stages(section: &Section<'_>, text: &mut String) {
    let all: Vec<(&Cell, &Measured)> = section.timed().collect();
    if all.is_empty() {
        return;
    }
    *text += "Stages, median ms (95 %), n samples each:\n\n";
    for cells in all.chunks(COLUMNS) {
        let head = ["stage".to_owned(), "clock".to_owned()];
        let mut table = Table::new(head.into_iter().chain(cells.iter().map(counted)));
        for stage in stage_names(cells) {
            let mut clocks = IndexSet::new();
            let mut times = Vec::new();
            for (_, measured) in cells {
                let Some(record) = measured.stages.iter().find(|s| s.stage == stage) else {
                    times.push("–".to_owned());
                    continue;
                };
                clocks.insert(record.clock.name());
                times.push(format::stage_ms(record));
            }
            let head = [stage.to_owned(), clocks.into_iter().collect::<Vec<_>>().join(", ")];
            table.row(head.into_iter().chain(times));
        }
        *text += &table.markdown();
    }
    let unresolved = |measured: &Measured| !measured.stages.iter().all(StageRecord::is_resolved);
    if all.iter().any(|(_, measured)| unresolved(measured)) {
        *text += BELOW_RESOLUTION;
    }
}

/// Said of a table that has such times.
const BELOW_RESOLUTION: &str = "`<`: shorter than the scatter of a submission's cost, which is taken off fenced times; no \
    ratio or slope is drawn from such a time.\n\n";

/// Stages of the cells in frame order; those that only later cells have come last.
fn stage_names<'a>(cells: &[(&Cell, &'a Measured)]) -> IndexSet<&'a str> {
    cells
        .iter()
        .flat_map(|(_, measured)| &measured.stages)
        .map(|stage| stage.stage.as_str())
        .collect()
}

/// Declared work over time in the cell with the longest frame, where fixed costs matter least.
fn throughput(section: &Section<'_>, text: &mut String) {
    let longest = section
        .timed()
        .max_by(|a, b| a.1.frame.untimed.median.total_cmp(&b.1.frame.untimed.median));
    let Some((cell, measured)) = longest else { return };
    let total_ns: f64 = measured.stages.iter().map(|stage| stage.time.median).sum();
    let mut table = Table::new(["stage", "share of the stages", "photons/s", "fragments/s"]);
    for stage in &measured.stages {
        let resolved = stage.is_resolved();
        let rate = |count: u64| match count {
            count if count > 0 && resolved => format::si(count as f64 / (stage.time.median * 1e-9)),
            _ => "–".to_owned(),
        };
        if stage.work.photons > 0 || stage.work.fragments > 0 {
            table.row([
                stage.stage.clone(),
                share(stage, total_ns),
                rate(stage.work.photons),
                rate(stage.work.fragments),
            ]);
        }
    }
    let cell = text::code(&cell.cell);
    table.add_to(text, &format!("Throughput by declared work in {cell}:\n\n"));
}

fn share(stage: &StageRecord, total_ns: f64) -> String {
    let bound = if stage.is_resolved() { "" } else { "< " };
    bound.to_owned() + &format::percent(stage.time.median / total_ns)
}

fn quantities(section: &Section<'_>, text: &mut String) {
    let cells = section.measured();
    let names: BTreeSet<&str> = cells.flat_map(|(_, cell)| cell.figures().into_keys()).collect();
    if names.is_empty() {
        return;
    }
    let head = ["cell".to_owned()];
    let mut table = Table::new(head.into_iter().chain(names.iter().map(|name| (*name).to_owned())));
    for (cell, measured) in section.measured() {
        let values = names.iter().map(|quantity| {
            let value = measured.figures().get(*quantity).copied();
            value.map_or_else(|| "–".to_owned(), format::three)
        });
        table.row([name(cell)].into_iter().chain(values));
    }
    *text += "Quantities:\n\n";
    *text += &table.markdown();
}

/// Notes and rejected frames of single cells; many of them are folded away.
fn cell_notes(section: &Section<'_>, text: &mut String) {
    let mut lines = String::new();
    for (cell, measured) in section.measured() {
        let rejected = measured
            .rejected
            .iter()
            .map(|rejected| format!("{} frames rejected: {}", rejected.frames, rejected.rejection));
        for note in measured.notes.iter().map(|note| note.text.clone()).chain(rejected) {
            let note = text::markdown(&note);
            let _ = writeln!(lines, "- {}: {note}", text::code(&cell.cell));
        }
    }
    let count = lines.lines().count();
    if count > UNFOLDED {
        let _ = write!(
            text,
            "<details><summary>{count} notes on cells</summary>\n\n{lines}\n</details>\n\n"
        );
    } else if count > 0 {
        let _ = writeln!(text, "{lines}");
    }
}
