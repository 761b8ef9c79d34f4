//! Claims against records: *supported*, *contradicted*, *near the bound*, *inconclusive* or *not run*.
//!
//! There is one rule of evidence. A test breaks a claim down into comparisons: figures, each with the band that it must lie in.
//! Figures of two cells are compared visit by visit. An exact figure (a count, an error over all pixels) lies in its band or
//! does not. A sampled figure has an interval.
//!
//! - *Supported*: the interval of every comparison lies inside its band.
//! - *Contradicted*: the interval of some comparison lies outside its band. This interval is widened for the number of
//!   comparisons (Bonferroni), because one of many misses more often than one alone.
//! - *Near the bound*: the publication prints no number, so that the bound is our own, and some figure is too near to it: its
//!   interval holds the bound, or it has none and lies within a tenth of the bound, and a quarter of a band with two.
//! - *Inconclusive*: none of these, or visits within less than a minute. The reason says what would settle it.
//! - *Not run*: a figure is missing, or the sizes or the adapter do not allow the test.
//!
//! A sampled figure's interval is over visits ([`fathom_base::visits`]). Claims are read once, when sampling has ended: no verdict steers it, so each
//! interval is one of 95 %, and a claim whose figure lies exactly at a bound is supported with a chance of at most [`CHANCE`].
//!
//! Records that do not tell visits are judged by the rule of their time: intervals over samples, and at a sixth of the level, as a run
//! looked at its samples up to six times and might stop at each.

mod balance;
mod comparisons;
mod evidence;
mod fits;

use indexmap::IndexMap;
use itertools::Itertools;
use serde_json::{Map, Value};
use strum::Display;

use self::evidence::{BoundCheck, Judgement};
use super::expand::label_text;
use super::measure::{self, Measure, Quantity};
use super::schema::{Balance, Cause, Claim, Experiment, FIXED_SHARE, Least, Test};
use fathom_base::statistics;
use fathom_record::{Cell, NoteKind};

pub use balance::SizeRatios;
pub use evidence::{NO_VISIT, RuledFigure};
pub use fits::{Scaling, scaling, thin_out};

/// Looks at the samples of a cell that runs took which told no visits.
const EARLIER_LOOKS: f64 = 6.0;
/// Chance with which a claim is supported whose figure lies exactly at a bound: one side of its interval.
pub const CHANCE: f64 = statistics::ALPHA / 2.0;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Display)]
#[strum(serialize_all = "lowercase")]
pub enum Verdict {
    Contradicted,
    #[strum(to_string = "near the bound")]
    NearBound,
    Inconclusive,
    #[strum(to_string = "not run")]
    NotRun,
    Supported,
}

impl Verdict {
    pub fn is_settled(self) -> bool {
        matches!(self, Verdict::Supported | Verdict::Contradicted)
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Display)]
pub enum ClaimOrigin {
    #[strum(to_string = "claims of the papers")]
    Publication,
    /// Of this project, or of a user.
    #[strum(to_string = "own hypotheses")]
    Own,
}

impl ClaimOrigin {
    pub const ALL: [ClaimOrigin; 2] = [ClaimOrigin::Publication, ClaimOrigin::Own];

    /// As a heading.
    pub fn title(self) -> &'static str {
        match self {
            ClaimOrigin::Publication => "Claims of the papers",
            ClaimOrigin::Own => "Own hypotheses",
        }
    }
}

/// A claim's verdict with the figures it rests on.
#[derive(Clone, Debug, PartialEq)]
pub struct Ruling {
    pub id: String,
    pub text: String,
    pub origin: ClaimOrigin,
    pub verdict: Verdict,
    /// The publication prints no number that the figures are held against.
    pub has_own_bound: bool,
    /// Of a run at the sizes of the quick profile, which are smaller than the publication's.
    pub is_quick: bool,
    /// The figures that decided, with their intervals; why it was not run; or what would settle it.
    pub reason: String,
    /// Smallest number of visits of a figure. None where all are exact or there is none.
    pub n: Option<usize>,
    /// The figures that decided, the furthest outside its band or the nearest to its bound first. Empty where it was not run.
    pub deciding: Vec<RuledFigure>,
    /// The claim's other comparisons, each with its own verdict.
    pub others: Vec<RuledFigure>,
    /// The sizes that were tested, where the claim asks for the publication's balance.
    pub scale: Option<SizeRatios>,
}

impl Ruling {
    /// On a claim that cannot be tested.
    pub fn not_run(claim: &Claim, reason: String) -> Ruling {
        Ruling {
            id: claim.id.clone(),
            text: claim.text.clone(),
            origin: claim.origin(),
            verdict: Verdict::NotRun,
            has_own_bound: !claim.has_printed_bound(),
            is_quick: false,
            reason,
            n: None,
            deciding: Vec::new(),
            others: Vec::new(),
            scale: None,
        }
    }

    /// Whose bound and which sizes gave the verdict, behind it or behind the claim: ` (our bound, quick profile)`.
    pub fn mark(&self) -> String {
        let marks = [(self.has_own_bound, "our bound"), (self.is_quick, "quick profile")];
        let marks: Vec<&str> = marks.iter().filter(|(is, _)| *is).map(|(_, mark)| *mark).collect();
        if marks.is_empty() || self.verdict == Verdict::NotRun {
            return String::new();
        }
        format!(" ({})", marks.join(", "))
    }

    /// The verdict with its mark.
    pub fn marked(&self) -> String {
        format!("{}{}", self.verdict, self.mark())
    }
}

/// Comparisons that a test asks for, or why it cannot be run.
type Tested = Result<Vec<BoundCheck>, String>;

/// Groups of cells that a claim is tested on, at most: the findings of more cannot be read.
const MAX_GROUPS: usize = 200;

impl Experiment {
    /// Rules on every claim. `software`: the cells were measured on a software driver, so that absolute times do not count.
    pub fn rulings(&self, cells: &[&Cell], software: bool) -> Vec<Ruling> {
        self.claim.iter().map(|claim| self.rule(claim, cells, software)).collect()
    }

    /// How many claims these cells settle: support or contradict.
    pub fn settled(&self, cells: &[&Cell], software: bool) -> usize {
        let rulings = self.rulings(cells, software).into_iter();
        rulings.filter(|ruling| ruling.verdict.is_settled()).count()
    }
}

pub fn claimed_cells<'a>(claim: &Claim, cells: &[&'a Cell]) -> Vec<&'a Cell> {
    let of_test = |cell: &Cell| match &claim.test {
        Test::Ratio(ratio) => ratio.covers(cell),
        test => test.over().is_none_or(|over| cell.axes.contains_key(over)),
    };
    let concerned = |cell: &&&Cell| {
        measure::fits(cell, &claim.filter) && measure::follows(cell, &claim.method) && of_test(cell)
    };
    let cells: Vec<&Cell> = cells.iter().filter(concerned).copied().collect();
    claim.least.as_ref().map_or(cells.clone(), |least| of_least(least, &cells))
}

/// Along the axis the cell whose figure is least. All of them where one has none, as before they are measured.
fn of_least<'a>(least: &Least, cells: &[&'a Cell]) -> Vec<&'a Cell> {
    let value = |cell: &Cell| Some(read(&least.y, cell)?.median());
    let chosen = |group: Vec<&'a Cell>| match group.iter().map(|cell| value(cell)).collect() {
        Option::<Vec<f64>>::None => group,
        Some(values) => {
            let least = values.iter().position_min_by(|a, b| a.total_cmp(b));
            least.map(|index| group[index]).into_iter().collect()
        }
    };
    groups(cells, &least.over).into_iter().flat_map(|(_, group)| chosen(group)).collect()
}

/// The sets of cells whose times a claim holds against each other, each in the order of its axis. None where it asks for no time.
pub(super) fn compared_cells<'a>(claim: &Claim, cells: &[&'a Cell]) -> Vec<Vec<&'a Cell>> {
    let concerned = claimed_cells(claim, cells);
    match (&claim.test, claim.test.over()) {
        _ if !claim.test.measures().iter().any(|measure| measure.reads_times()) => Vec::new(),
        (_, Some(over)) => groups(&concerned, over).into_iter().map(|(_, group)| group).collect(),
        (Test::Ratio(_) | Test::EqualTime(_), None) => vec![concerned],
        (_, None) => Vec::new(),
    }
}

impl Experiment {
    fn rule(&self, claim: &Claim, all: &[&Cell], software: bool) -> Ruling {
        if let Some(reason) = &claim.not_run {
            return Ruling::not_run(claim, reason.clone());
        }
        let cells = claimed_cells(claim, all);
        let runs_it = |cell: &&Cell| measure::follows(cell, &claim.method);
        if !claim.method.is_empty() && !all.iter().any(runs_it) {
            return Ruling::not_run(claim, "no cell runs the publication's method".to_owned());
        }
        let groups = match groups_of(&claim.test, &cells) {
            Ok(groups) => groups,
            Err(reason) => return Ruling::not_run(claim, reason),
        };
        let mut scales = Vec::new();
        let (mut comparisons, mut not_run) = (Vec::new(), Vec::new());
        for CellGroup { prefix, cells } in groups {
            let missing = not_computed(&claim.test, &cells);
            let balanced = match claim.balance {
                Some(Balance::Published) => balance::select(&self.balance, &claim.test, cells),
                Some(Balance::Free(_)) | None => Ok((cells, None)),
            };
            let tested = balanced
                .and_then(|(cells, scale)| Ok((scale, test_group(&claim.test, &cells, software)?)));
            match tested {
                Ok((scale, more)) => {
                    scales.extend(scale);
                    comparisons.extend(more.into_iter().map(|c| c.prefixed(&prefix)));
                }
                Err(reason) => not_run.push(prefix + missing.as_ref().unwrap_or(&reason)),
            }
        }
        let n = comparisons.iter().filter_map(BoundCheck::n).min();
        match evidence::judge(&comparisons, !claim.has_printed_bound()) {
            Some(Judgement { verdict, reason, deciding, others })
                if not_run.is_empty() || verdict < Verdict::NotRun =>
            {
                let scale = SizeRatios::join(&scales);
                let cause = cause(claim, verdict, software);
                let reason = cause.map_or(reason.clone(), |cause| format!("{reason}. {cause}"));
                Ruling { verdict, n, deciding, others, scale, ..Ruling::not_run(claim, reason) }
            }
            _ => Ruling { n, ..Ruling::not_run(claim, not_run.join("; ")) },
        }
    }
}

/// Why a cell that was measured has no figure for the test, where its record says so. Times are not computed.
fn not_computed(test: &Test, cells: &[&Cell]) -> Option<String> {
    if test.y().reads_times() {
        return None;
    }
    cells.iter().filter(|cell| read_positive(test.y(), cell).is_none()).find_map(|cell| {
        let notes = &cell.measured()?.notes;
        let note = notes.iter().find(|note| note.kind == NoteKind::NotComputed)?;
        Some(format!("{}: {}", cell.cell, note.text))
    })
}

/// Why a contradicted claim does not hold, where that is known of this kind of adapter.
fn cause(claim: &Claim, verdict: Verdict, software: bool) -> Option<String> {
    match claim.cause.as_ref().filter(|_| verdict == Verdict::Contradicted)? {
        Cause::Hardware(why) => software.then(|| format!("The hardware decides: {why}")),
        Cause::Paper(why) => Some(format!("The paper decides: {why}")),
    }
}

/// Cells that are tested together: those that differ in the test's axis only, or all where it has none.
struct CellGroup<'a> {
    /// What they have in common, before the name of each figure; empty where there is one group.
    prefix: String,
    cells: Vec<&'a Cell>,
}

fn groups_of<'a>(test: &Test, cells: &[&'a Cell]) -> Result<Vec<CellGroup<'a>>, String> {
    let Some(over) = test.over() else {
        return Ok(vec![CellGroup { prefix: String::new(), cells: cells.to_vec() }]);
    };
    let groups = groups(cells, over);
    if groups.is_empty() {
        return Err(format!("no cell along `{over}`"));
    }
    if groups.len() > MAX_GROUPS {
        return Err(format!(
            "{} groups of cells along `{over}` are more than the {MAX_GROUPS} that are tested: use `where`",
            groups.len()
        ));
    }
    let several = groups.len() > 1;
    let named = groups.into_iter().map(|(name, cells)| {
        let prefix = if several { format!("{name}: ") } else { String::new() };
        CellGroup { prefix, cells }
    });
    Ok(named.collect())
}

/// Cells that have the axis, grouped by the values of all their other axes.
pub fn groups<'a>(cells: &[&'a Cell], over: &str) -> Vec<(String, Vec<&'a Cell>)> {
    by_other_axes(cells.iter().copied(), over, |cell| &cell.axes).into_iter().collect()
}

/// The same of anything that has axes.
pub(super) fn by_other_axes<'a, T>(
    cells: impl IntoIterator<Item = T>,
    over: &str,
    axes: impl Fn(&T) -> &'a Map<String, Value>,
) -> IndexMap<String, Vec<T>> {
    let mut groups = IndexMap::<String, Vec<T>>::new();
    for cell in cells.into_iter().filter(|cell| axes(cell).contains_key(over)) {
        let others = axes(&cell).iter().filter(|(name, _)| *name != over);
        let others = others.map(|(name, value)| format!("{name}={}", label_text(value)));
        groups.entry(others.collect::<Vec<_>>().join(", ")).or_default().push(cell);
    }
    groups
}

fn test_group(test: &Test, cells: &[&Cell], software: bool) -> Tested {
    match test {
        Test::Within { y, low, high } => comparisons::each(y, [*low, *high], cells, software),
        Test::Ratio(ratio) => comparisons::ratio(ratio, cells),
        Test::EqualTime(_) if software => {
            Err("the times of a software driver are not those of a GPU, whose caches and texture units decide".to_owned())
        }
        Test::EqualTime(test) => fits::equal_time(test, cells),
        Test::Slope { y, x, expected, tolerance, max_fixed_share, .. } => {
            let fit = scaling(y, x, cells, max_fixed_share.unwrap_or(FIXED_SHARE))?;
            fits::slope(&fit, *expected, *tolerance)
        }
        Test::Affine { y, x, tolerance, .. } => fits::affine(y, x, *tolerance, cells),
        Test::Monotone { y, x, direction, .. } => comparisons::monotone(y, x, *direction, cells),
        Test::Band { y, x, low, high, .. } => comparisons::band(y, x, [*low, *high], cells),
    }
}

/// The value in a cell, where it was measured and is not negative: a rate may be 0.
fn read(y: &Measure, cell: &Cell) -> Option<Quantity> {
    let reading = y.read(cell, cell.measured()?)?;
    let median = reading.median();
    (median >= 0.0 && median.is_finite()).then_some(reading)
}

/// The same where it is positive.
fn read_positive(y: &Measure, cell: &Cell) -> Option<Quantity> {
    read(y, cell).filter(|reading| reading.median() > 0.0)
}

fn format_ms(ns: f64) -> String {
    format!("{:.3} ms", ns * 1e-6)
}

fn too_few(count: usize, needed: &str) -> String {
    let cells = if count == 1 { "cell" } else { "cells" };
    format!("{count} measured {cells}, and {needed}")
}

#[cfg(test)]
mod tests;
