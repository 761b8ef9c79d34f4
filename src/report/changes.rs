//! What changed from one run to another: what `fathom compare OLD NEW` prints. Exact figures are judged by the exact gate. Times are
//! shown with their ratios and are not judged: two runs share no pairs, so the ratios contain whatever else the machine did in either.

use std::iter;

use indexmap::IndexMap;
use itertools::{Itertools, chain};

use crate::comparison::rows;
use crate::document::{self, Block, Table};
use crate::format::{count_noun, ms, stage_ms, three};
use crate::page::claims::{RuledClaim, ruled_claims};
use crate::{Report, facts, noise, run_conditions, shown_file};
use fathom_experiments::{RuledFigure, Ruling, Verdict};
use fathom_judge::exact::{Difference, DifferenceScope, FigureKind};
use fathom_judge::files::{RunFile, SameCells};
use fathom_judge::matched_cells::{MatchedCells, redefinition};
use fathom_judge::run::Noise;
use fathom_judge::verdict::{Status, Verdicts};
use fathom_record::comparison::{CellId, Gate, Side};
use fathom_record::{Adapter, Cell, Measured, Run};

/// Rows of a block; the rest is counted.
const MAX_ROWS: usize = 8;
/// Cells that a row names.
const MAX_NAMED: usize = 3;

/// What there is to say, the most important first.
pub struct RunChanges {
    /// By what is exact.
    pub status: Status,
    /// What was judged, and what cannot be.
    pub headline: String,
    /// What makes the runs hard to compare, then what changed.
    pub blocks: Vec<Block>,
}

/// A table of at most [`MAX_ROWS`] rows with words above it.
fn block<const N: usize>(
    title: &str,
    lead: Vec<String>,
    heads: [&str; N],
    rows: impl IntoIterator<Item = [String; N]>,
) -> Vec<Block> {
    let mut table = Table::new(title, heads).with_rows(rows);
    let more = table.rows.len().saturating_sub(MAX_ROWS);
    table.rows.truncate(MAX_ROWS);
    let more = (more > 0).then(|| Block::paragraph(format!("… and {more} more")));
    let table = (!table.rows.is_empty()).then_some(Block::Table(table));
    let lead = lead.into_iter().map(Block::paragraph);
    chain![[Block::Heading(title.into())], lead, table, more].collect()
}

impl RunChanges {
    pub fn from_files([base, head]: [&RunFile; 2], gates: &[Gate]) -> anyhow::Result<Self> {
        let SameCells { comparison, cells, untimed } = SameCells::compare([base, head], gates)?;
        let verdicts = &Verdicts::judge(&comparison);
        let views = [base, head].map(|file| Report::new(&file.reading.records, None));
        let timed = cells.pairs.iter().filter(|pair| pair.iter().all(|cell| is_timed(cell)));
        let not_judged = match &untimed {
            None => format!(
                "times of {} not judged: two runs share no pairs",
                count_noun(timed.clone().count(), "cell")
            ),
            Some(reason) => format!("times not compared: {reason}"),
        };
        let frames = facts::representatives(&views[1].sections);
        let is_shown = |cells: &&[&Cell; 2]| {
            untimed.is_none() && frames.iter().any(|frame| std::ptr::eq(frame.cell, cells[1]))
        };
        let times = timed.clone().filter(is_shown).flat_map(time_rows).collect();
        let status = verdicts.status;
        let doubts = comparison.header.notes.iter().cloned().chain(noisy_runs(&views));
        Ok(Self {
            status,
            headline: format!(
                "{status} (status {}): {}; {not_judged}",
                status as u8,
                exact_headline(verdicts)
            ),
            blocks: [
                vec![Block::list(doubts)],
                machine_block(&views, [base, head].map(|file| shown_file(&file.path))),
                claims_block(&views),
                exact_block(verdicts),
                cells_block(&cells),
                times_block(times),
            ]
            .into_iter()
            .flatten()
            .collect(),
        })
    }

    /// For the terminal.
    pub fn into_text(self) -> String {
        document::terminal(&chain![[Block::paragraph(self.headline)], self.blocks].collect_vec())
    }
}

fn cell_name(cell: &Cell) -> String {
    format!("{} {}", cell.experiment, cell.cell)
}

/// Differences of exact figures that say something: what is read back is neither good nor bad.
fn differences<'v>(verdicts: &'v Verdicts<'_>) -> impl Iterator<Item = &'v Difference> {
    let of_cells = verdicts.cells.iter().flat_map(|cell| &cell.differences);
    let all = of_cells.chain(&verdicts.configurations);
    all.filter(|difference| difference.kind != FigureKind::Quantity)
}

fn configuration(difference: &Difference) -> &str {
    match &difference.scope {
        DifferenceScope::Cell(cell) => cell.configuration(),
        DifferenceScope::Stage(name) | DifferenceScope::Configuration(name) => name,
    }
}

fn exact_headline(verdicts: &Verdicts<'_>) -> String {
    let cells = verdicts.comparison.header.cells.iter();
    let all = cells.map(CellId::configuration).unique().count();
    let worse = differences(verdicts).filter(|difference| difference.worse);
    let worse = worse.map(configuration).unique().collect_vec();
    let other = differences(verdicts).map(configuration).unique();
    let other = other.filter(|name| !worse.contains(name)).count();
    let same = all.saturating_sub(worse.len() + other);
    let parts = [(worse.len(), "worse"), (other, "different but not worse"), (same, "same")];
    let told = parts.into_iter().filter(|(count, _)| *count > 0);
    let told = match told.collect_vec().as_slice() {
        [(_, word)] => (*word).to_owned(),
        several => several.iter().map(|(count, word)| format!("{count} {word}")).join(", "),
    };
    format!("exact figures of {}: {told}", count_noun(all, "cell"))
}

/// The runs whose machine was not quiet.
fn noisy_runs(views: &[Report<'_>; 2]) -> impl Iterator<Item = String> {
    Side::BOTH.into_iter().zip(views).filter_map(|(side, view)| {
        let verdict = view.verdict.as_ref().filter(|verdict| verdict.noise != Noise::Quiet)?;
        Some(format!("{side}: {}", noise::headline(verdict)))
    })
}

/// Claims of both runs whose verdicts differ. First those that are settled in both runs, then those that no longer are, then those that
/// now are.
fn claims_block(views: &[Report<'_>; 2]) -> Vec<Block> {
    let all = ruled_claims(views.iter()).into_iter().filter(|claim| claim.rulings.len() == 2);
    let all = all.collect_vec();
    let changed = all.iter().filter(|claim| !claim.verdicts().all_equal());
    let changed = changed.sorted_by_key(|claim| {
        let settled = claim.verdicts().map(Verdict::is_settled).collect_vec();
        [[true, true], [true, false], [false, true]]
            .iter()
            .position(|known| *known == *settled)
            .unwrap_or(3)
    });
    let lead = format!("{} of {} changed verdict", changed.len(), count_noun(all.len(), "claim"));
    let heads = ["Verdict", "Experiment", "Claim", "Figure that decided"];
    block("Claims", vec![lead], heads, changed.map(claim_row))
}

fn claim_row(claim: &RuledClaim<'_>) -> [String; 4] {
    let [base, head] = &claim.rulings[..] else { unreachable!("a claim of two runs") };
    // The figure that decided; the reason where there is none.
    let figure = |ruling: &Ruling| match ruling.deciding.first() {
        Some(figure) => RuledFigure::text(figure),
        None => ruling.reason.clone(),
    };
    let asked = head.ruling.deciding.first().or(base.ruling.deciding.first());
    let asked = asked.map_or_else(String::new, |f| format!("; {} is asked", f.limits()));
    let redefined = if base.claim == head.claim { "" } else { "; its definition changed" };
    let [from, to] = [figure(base.ruling), figure(head.ruling)];
    [
        format!("{} → {}", base.ruling.verdict, head.ruling.marked()),
        claim.section.id.to_owned(),
        head.ruling.text.clone(),
        format!("{from} → {to}{asked}{redefined}"),
    ]
}

fn is_timed(cell: &Cell) -> bool {
    cell.measured().is_some_and(Measured::is_timed)
}

/// The frame and each stage that both runs timed in a cell.
fn time_rows([base, head]: &[&Cell; 2]) -> Vec<[String; 5]> {
    let Some((b, h)) = base.measured().zip(head.measured()) else { return Vec::new() };
    let row = |time: &str, [before, after]: [String; 2], ratio: f64| {
        [cell_name(head), time.to_owned(), before, after, three(ratio)]
    };
    let frames = [b, h].map(|of| ms(&of.frame.untimed));
    let frame = row("frame", frames, h.frame.untimed.median / b.frame.untimed.median);
    let stages = h.stages.iter().filter_map(|after| {
        let before = b.stages.iter().find(|before| before.stage == after.stage)?;
        let has_ratio = before.clock == after.clock && before.is_resolved() && after.is_resolved();
        let ratio = if has_ratio { after.time.median / before.time.median } else { f64::NAN };
        Some(row(&after.stage, [before, after].map(stage_ms), ratio))
    });
    iter::once(frame).chain(stages).collect()
}

fn times_block(rows: Vec<[String; 5]>) -> Vec<Block> {
    let lead = "of a frame of each pipeline: medians with the 95 % intervals of each run, not judged; no ratio where clocks differ or cannot tell a time from none";
    let heads = ["Cell", "Time", "Base (ms)", "Head (ms)", "Head / base"];
    let has_rows = !rows.is_empty();
    let table = Block::Table(Table::new("Times", heads).with_rows(rows));
    let all = vec![Block::Heading("Times".into()), Block::paragraph(lead), table];
    if has_rows { all } else { Vec::new() }
}

/// Differences grouped by figure: errors first, what became worse first.
fn exact_block(verdicts: &Verdicts<'_>) -> Vec<Block> {
    let mut groups = IndexMap::<(bool, bool, &str), Vec<&Difference>>::new();
    for difference in differences(verdicts) {
        let is_error = difference.kind == FigureKind::Error;
        let key = (!difference.worse, !is_error, difference.figure.as_str());
        groups.entry(key).or_default().push(difference);
    }
    groups.sort_by(|a, _, b, _| (a.0, a.1).cmp(&(b.0, b.1)));
    let row = |((better, ..), group): (&(bool, bool, &str), &Vec<&Difference>)| {
        let share = |d: &&&Difference| ((d.head - d.base) / d.base).abs();
        let largest =
            group.iter().max_by(|a, b| share(a).total_cmp(&share(b))).expect("a group holds one");
        let cells = group.iter().map(|difference| configuration(difference)).unique().count();
        let word = if *better { "not worse" } else { "worse" };
        let place = match &largest.scope {
            DifferenceScope::Cell(cell) => cell.to_string(),
            _ => configuration(largest).to_owned(),
        };
        [word.to_owned(), count_noun(cells, "cell"), rows::format_change(largest), place]
    };
    let rows = groups.iter().map(row).collect_vec();
    let mut lead = vec![match rows.len() {
        0 => "no figure differs".to_owned(),
        count => format!("in some cell another value of {}", count_noun(count, "figure")),
    }];
    let faults = verdicts.faults.iter().map(rows::fault).collect_vec();
    if let Some(first) = faults.first() {
        lead.push(format!("{}, such as: {first}", count_noun(faults.len(), "missing figure")));
    }
    let heads = ["Change", "In", "Figure, where it moved most", "Cell"];
    block("Errors and other exact figures", lead, heads, rows)
}

/// What of machine, program and conditions differs.
fn machine_block(views: &[Report<'_>; 2], paths: [String; 2]) -> Vec<Block> {
    let views = views.each_ref();
    let [base, head] = views.map(|view| view.run().map(identity).unwrap_or_default());
    let differing = base.iter().zip(&head).filter(|(base, head)| base != head);
    let row = |((name, base), (_, head)): (&RunFact, &RunFact)| {
        let told =
            |value: &Option<String>| value.clone().unwrap_or_else(|| "not recorded".to_owned());
        [(*name).to_owned(), told(base), told(head)]
    };
    let rows = differing.map(row).collect_vec();
    let started = |view: &Report<'_>| view.run().map_or("", |run| &run.started_at).to_owned();
    let [from, to] = views.map(started);
    let [base_path, head_path] = paths;
    let mut lead = vec![format!("{base_path}, started {from} → {head_path}, started {to}")];
    if rows.is_empty() {
        let mut values = base.iter().filter_map(|(_, value)| value.as_deref());
        lead.push(format!("as far as recorded the same: {}", values.join("; ")));
    }
    block("Machine and program", lead, ["What", "Base", "Head"], rows)
}

/// Something of a run, and what the records say of it.
type RunFact = (&'static str, Option<String>);

/// What two runs must have in common to differ by the program's change alone; none where it is not recorded.
fn identity(run: &Run) -> Vec<RunFact> {
    let Adapter { backend, driver, driver_info, host_threads, .. } = &run.adapter;
    vec![
        ("adapter", Some(format!("{}, {backend}", run.adapter.title()))),
        ("driver", Some(format!("{driver} {driver_info}"))),
        ("threads of the host", Some(format!("{host_threads} threads"))),
        ("host", run.conditions.host.clone()),
        ("machine", run.conditions.machine.as_ref().map(facts::machine)),
        ("program", Some(facts::program(run))),
        ("profile", Some(format!("profile {}", run.profile))),
        ("shaders", Some(format!("shaders {}", run.shader_checks))),
        ("clocks and conditions", Some(run_conditions(run))),
    ]
}

fn cells_block(cells: &MatchedCells<'_>) -> Vec<Block> {
    let reason = |cell: &Cell| cell.outcome.words().join(": ");
    let name_with = |cell, why: String| format!("{} ({why})", cell_name(cell));
    let pairs = |measured: [bool; 2]| {
        let is_so =
            move |pair: &&[&Cell; 2]| pair.map(|cell| cell.measured().is_some()) == measured;
        cells.pairs.iter().filter(is_so)
    };
    let names = |cells: &[&Cell]| cells.iter().map(|cell| cell_name(cell)).collect_vec();
    let [lost, gained] = [pairs([true, false]), pairs([false, true])];
    let redefined = cells.redefined.iter();
    let kinds = [
        ("no longer measured", lost.map(|[_, head]| name_with(head, reason(head))).collect()),
        ("missing", names(&cells.missing)),
        ("measured in another way", redefined.map(|p| name_with(p[1], redefinition(*p))).collect()),
        ("new", names(&cells.new)),
        ("measured only now", gained.map(|[base, head]| name_with(head, reason(base))).collect()),
    ];
    let row = |(kind, all): (&str, Vec<String>)| {
        let more = if all.len() > MAX_NAMED { "; …" } else { "" };
        let named = all.iter().take(MAX_NAMED).join("; ");
        [kind.to_owned(), count_noun(all.len(), "cell"), named + more]
    };
    let both = count_noun(pairs([true; 2]).count(), "cell");
    let lead = format!("{both} measured in both runs in the same way");
    let rows = kinds.into_iter().filter(|(_, all)| !all.is_empty()).map(row);
    block("Cells", vec![lead], ["What became of them", "How many", "Which"], rows)
}

#[cfg(test)]
mod tests;
