//! What changed from one run to another: what `fathom compare` of two files of records prints. Exact figures are those of the exact
//! gate. Times stand beside each other and are not judged: two runs share no pairs, so whatever the machine did between them is in
//! every ratio.

use std::iter;
use std::path::{Path, PathBuf};

use indexmap::IndexMap;
use itertools::{Itertools, chain};

use crate::comparison::rows;
use crate::document::{self, Block, Table};
use crate::format::{count_noun, ms, stage_ms, three};
use crate::{Report, facts, noise, run_conditions, shown_file};
use fathom_experiments::Ruling;
use fathom_experiments::schema::Claim;
use fathom_judge::adapters::AdapterRelation;
use fathom_judge::changes::cells::{CellMatches, CellRemark, MAX_NAMED};
use fathom_judge::changes::claims::{self, ClaimChange};
use fathom_judge::exact::{Difference, DifferenceScope, FigureKind};
use fathom_judge::files::{RunFile, SameCells};
use fathom_judge::run::Noise;
use fathom_judge::verdict::{Status, Verdicts};
use fathom_record::comparison::{CellId, Gate, Side};
use fathom_record::{Adapter, Cell, Run};

/// Rows of a block; the rest is counted.
const MAX_ROWS: usize = 8;

/// What there is to say, the most important first.
pub struct RunChanges {
    /// By what is exact.
    pub status: Status,
    /// What was judged, and what cannot be.
    pub headline: String,
    /// Why the runs are hard to compare, then what changed.
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
        let SameCells { comparison, untimed } = SameCells::compare([base, head], gates)?;
        let verdicts = &Verdicts::judge(&comparison);
        let views = [base, head].map(|file| Report::new(&file.reading.records, None));
        let views = [&views[0], &views[1]];
        let paths = [&base.path, &head.path].map(PathBuf::as_path);
        let cells = CellMatches::match_runs(views.map(cells));
        let times = cells.both.iter().map(time_rows).filter(|rows| !rows.is_empty()).collect_vec();
        let not_judged = match &untimed {
            None => format!(
                "times of {} not judged: two runs share no pairs",
                count_noun(times.len(), "cell")
            ),
            Some(reason) => format!("times not compared: {reason}"),
        };
        let times = if untimed.is_none() { times.concat() } else { Vec::new() };
        let doubts = [comparison.header.notes.clone(), caveats(views)].concat();
        Ok(Self {
            status: verdicts.status,
            headline: format!("{}; {not_judged}", exact_headline(verdicts)),
            blocks: [
                vec![Block::list(doubts)],
                claims_block(views),
                exact_block(verdicts),
                machine_block(views, paths),
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

fn cells<'a>(view: &Report<'a>) -> Vec<&'a Cell> {
    view.entries().map(|entry| entry.cell).collect()
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

/// Why what is told below may not be a change of the program.
fn caveats([base, head]: [&Report<'_>; 2]) -> Vec<String> {
    let mut doubts = Vec::new();
    if let (Some(b), Some(h)) = (base.run(), head.run()) {
        let adapter = |adapter: &Adapter| format!("{}, {}", adapter.title(), adapter.driver_info);
        let adapters = format!("{} → {}", adapter(&b.adapter), adapter(&h.adapter));
        match AdapterRelation::between(&b.adapter, &h.adapter) {
            AdapterRelation::Same => {}
            AdapterRelation::OtherVersion => {
                doubts.push(format!("two versions of the driver: {adapters}"))
            }
            AdapterRelation::Different => doubts.push(format!("two adapters: {adapters}")),
        }
        let hosts = [&b.conditions.host, &h.conditions.host];
        if let [Some(one), Some(other)] = hosts
            && one != other
        {
            doubts.push("two machines: their host ids differ".to_owned());
        }
        if b.profile != h.profile {
            let profiles = format!("two profiles, {} and {}", b.profile, h.profile);
            doubts.push(format!("{profiles}: most cells differ in size and are not compared"));
        }
    }
    for (view, side) in [base, head].into_iter().zip(Side::BOTH) {
        let verdict = view.verdict.as_ref().filter(|verdict| verdict.noise != Noise::Quiet);
        doubts.extend(verdict.map(|verdict| format!("{side}: {}", noise::headline(verdict))));
    }
    doubts
}

fn rulings<'a>(view: &'a Report<'a>) -> impl Iterator<Item = (&'a str, &'a Claim, &'a Ruling)> {
    view.sections
        .iter()
        .flat_map(|section| section.claims().map(|(claim, ruling)| (section.id, claim, ruling)))
}

fn claims_block(views: [&Report<'_>; 2]) -> Vec<Block> {
    let (count, changed) = claims::changed(views.map(rulings));
    let row = |claim: &ClaimChange<'_>| {
        let [from, to] = [claim.rulings[0].verdict.to_string(), claim.rulings[1].marked()];
        let text = claim.rulings[1].text.clone();
        [format!("{from} → {to}"), claim.experiment.to_owned(), text, claim.figures()]
    };
    let lead = format!("{} of {} changed verdict", changed.len(), count_noun(count, "claim"));
    let heads = ["Verdict", "Experiment", "Claim", "Figure that decided"];
    block("Claims", vec![lead], heads, changed.iter().map(row))
}

/// The frame and each stage that both runs timed in a cell: none is chosen, as a choice would judge.
fn time_rows([base, head]: &[&Cell; 2]) -> Vec<[String; 5]> {
    let both = base.measured().zip(head.measured());
    let Some((b, h)) = both.filter(|(b, h)| b.is_timed() && h.is_timed()) else {
        return Vec::new();
    };
    let row = |time: &str, [before, after]: [String; 2], ratio: f64| {
        [cell_name(head), time.to_owned(), before, after, three(ratio)]
    };
    let frames = [b, h].map(|of| ms(&of.frame.untimed, &of.frame.untimed_samples_ns));
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
    let lead = "medians with the 95 % intervals of each run, not judged; no ratio where clocks differ or cannot tell a time from none";
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
        let most =
            group.iter().max_by(|a, b| share(a).total_cmp(&share(b))).expect("a group holds one");
        let cells = group.iter().map(|difference| configuration(difference)).unique().count();
        let word = if *better { "not worse" } else { "worse" };
        let place = match &most.scope {
            DifferenceScope::Cell(cell) => cell.to_string(),
            _ => configuration(most).to_owned(),
        };
        [word.to_owned(), count_noun(cells, "cell"), rows::format_change(most), place]
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
fn machine_block(views: [&Report<'_>; 2], paths: [&Path; 2]) -> Vec<Block> {
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
    let [base_path, head_path] = paths.map(shown_file);
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

fn cells_block(cells: &CellMatches<'_>) -> Vec<Block> {
    let kinds: [(&str, &[CellRemark<'_>]); 5] = [
        ("no longer measured", &cells.lost),
        ("missing", &cells.missing),
        ("measured in another way", &cells.redefined),
        ("new", &cells.new),
        ("measured only now", &cells.gained),
    ];
    let row = |(kind, told): (&str, &[CellRemark<'_>])| {
        let named = told.iter().take(MAX_NAMED).map(|(cell, why)| match why.as_str() {
            "" => cell_name(cell),
            why => format!("{} ({why})", cell_name(cell)),
        });
        let more = (told.len() > MAX_NAMED).then(|| "…".to_owned());
        [kind.to_owned(), count_noun(told.len(), "cell"), named.chain(more).join("; ")]
    };
    let kinds = kinds.into_iter().filter(|(_, told)| !told.is_empty());
    let lead =
        format!("{} measured in both runs in the same way", count_noun(cells.both.len(), "cell"));
    block("Cells", vec![lead], ["What became of them", "How many", "Which"], kinds.map(row))
}

#[cfg(test)]
mod tests;
