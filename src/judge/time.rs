//! The time gate's verdicts, from the stored pairs alone.
//!
//! A pair's figure is ln(head / base), as drift affects both of its sides. Who is sampled second in a pair finds the caches
//! warmer, by up to 4 % of a sample, so a launch's figure of a cell is the median over all means of a pair in which the base
//! came first and one in which the head did: the median of Hodges and Lehmann (1963) with that effect taken out, and a stall
//! falls on few of them. Between launches of equal builds, in two gates of 41 cells, it scatters 4 to 5 % less than the plain median
//! of the pairs.
//!
//! Launches are looked at three times: after 0.4 n, n and 2 n of them, where n is `--launches`. Each look judges a cell by all launches
//! that it has, with a third of the error that the gate may make, in its interval and in its test: whichever look decides a cell, the
//! errors of all looks together stay below `alpha`. A cell that a look calls slower, faster or the same takes no more samples.
//!
//! Figures of different launches are independent, pairs of one launch are not, as processes carry a bias of their own; so
//! intervals and tests are over launches.

use std::collections::{BTreeMap, BTreeSet};

use super::adapters::AdapterRelation;
use super::rank;
use super::store::Comparison;
use fathom_base::statistics::{Estimate, deviation, median};
use fathom_record::ThrottleReason;
use fathom_record::comparison::{CellId, GateSettings, MAX_LAUNCHES, MAX_PAIRS, Pair};

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum TimeVerdict {
    /// Slower by more than the threshold.
    Slower,
    /// Faster by more than the threshold.
    Faster,
    /// The whole interval lies within the threshold.
    Same,
    /// Neither a change nor its absence is shown.
    Inconclusive,
    /// Times of different adapters.
    NotJudged,
}

/// Looks at the launches of a comparison, each at the same share of its error.
const LOOKS: f64 = 3.0;

/// By what a look judges cells.
struct LookRule {
    /// Error of the tests of all cells together, and of the interval of each.
    level: f64,
    /// Logarithm of a change that just matters.
    bound: f64,
    /// Launches until the last look.
    max_launches: usize,
}

impl LookRule {
    fn new(comparison: &Comparison) -> Self {
        let GateSettings { alpha, threshold, .. } = comparison.header.settings;
        let looks = if has_second_measurement(comparison) { 2.0 } else { LOOKS };
        let max_launches = self::looks(comparison).last().map_or(0, |last| *last as usize);
        Self { level: alpha / looks, bound: (1.0 + threshold).ln(), max_launches }
    }
}

/// The time gate's result for a cell.
#[derive(Clone, Debug, PartialEq)]
pub struct CellTime {
    pub cell: CellId,
    pub verdict: TimeVerdict,
    /// ln(head / base) of each launch that went through all rounds.
    pub launches: Vec<f64>,
    /// Median sample of each side.
    pub base_ns: f64,
    pub head_ns: f64,
    /// Head over base less one, with the interval over launches of this cell alone; none where there are too few launches for it. In
    /// simulated gates intervals cover as often as 1 − `alpha`, at whichever look a cell was decided.
    pub change: Estimate,
    /// Of a change beyond the threshold in either direction, by chance.
    pub p: f64,
    /// Cells among which it was judged.
    pub adjusted_for: usize,
    /// The whole interval lies beyond the threshold, in one direction: the cell alone would have changed.
    pub is_beyond_threshold: bool,
    /// The least slowdown that would be found with the power [`rank::POWER`], from the number of launches and their spread; none
    /// where so few launches among so many cells find nothing. A slower cell would not have been decided so early, so it is of the
    /// launches until the last look.
    pub detectable: Option<f64>,
    /// Where clocks were held down in any launch.
    pub throttled: Option<ThrottledLaunches>,
}

impl CellTime {
    /// What the pairs of one cell say alone; [`together`] adds what they say among others.
    fn from_pairs(cell: &CellId, pairs: &[&Pair], rule: &LookRule) -> Self {
        let mut ratios: BTreeMap<u32, [Vec<f64>; 2]> = BTreeMap::new();
        for pair in pairs {
            let of_launch = ratios.entry(pair.launch).or_default();
            of_launch[pair.first as usize].push((pair.head_ns / pair.base_ns).ln());
        }
        let launches: Vec<f64> = ratios.values().map(launch_ratio).collect();
        let median = |ns: fn(&&Pair) -> f64| median(&pairs.iter().map(ns).collect::<Vec<_>>());
        let centre = rank::centre(&launches, rule.level);
        let bound = rule.bound;
        let is_same = centre.interval.is_some_and(|i| -bound <= i.low && i.high <= bound);
        let slower = rank::above(&launches, bound);
        let faster = rank::below(&launches, -bound);
        Self {
            cell: cell.clone(),
            verdict: if is_same { TimeVerdict::Same } else { TimeVerdict::Inconclusive },
            base_ns: median(|pair| pair.base_ns),
            head_ns: median(|pair| pair.head_ns),
            is_beyond_threshold: centre.interval.is_some_and(|i| i.low > bound || i.high < -bound),
            change: centre.map(f64::exp_m1),
            p: (2.0 * slower.min(faster)).min(1.0),
            adjusted_for: 1,
            detectable: None,
            throttled: ThrottledLaunches::count(pairs),
            launches,
        }
    }

    fn has_changed(&self) -> bool {
        matches!(self.verdict, TimeVerdict::Slower | TimeVerdict::Faster)
    }

    /// Standard deviation of a launch's ratio, as a share.
    pub fn scatter(&self) -> f64 {
        deviation(&self.launches)
    }

    /// Clocks were held down more often on the side that was slower: the change may be the machine's.
    pub fn may_be_throttling(&self) -> bool {
        self.throttled.as_ref().is_some_and(|launches| match self.verdict {
            TimeVerdict::Slower => launches.head > launches.base,
            TimeVerdict::Faster => launches.base > launches.head,
            TimeVerdict::Same | TimeVerdict::Inconclusive | TimeVerdict::NotJudged => false,
        })
    }
}

/// Launches in which a cell was sampled while heat or power held clocks down, by side; at least one.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ThrottledLaunches {
    pub base: usize,
    pub head: usize,
    pub reasons: BTreeSet<ThrottleReason>,
}

impl ThrottledLaunches {
    fn count(pairs: &[&Pair]) -> Option<Self> {
        let mut launches = [BTreeSet::new(), BTreeSet::new()];
        let mut reasons = BTreeSet::new();
        for pair in pairs {
            let states = [&pair.machine.base, &pair.machine.head];
            for (state, launches) in states.into_iter().zip(&mut launches) {
                if let Some(state) = state.as_ref().filter(|state| state.is_throttled()) {
                    launches.insert(pair.launch);
                    reasons.extend(state.harmful_reasons().cloned());
                }
            }
        }
        let [base, head] = launches.map(|launches| launches.len());
        (!reasons.is_empty()).then_some(Self { base, head, reasons })
    }
}

/// The result of the time gate.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TimeGate {
    /// In the order asked for; cells without any pair are left out.
    pub cells: Vec<CellTime>,
    /// A cell with one build on both sides: by the first look that found a change, else by all its launches. Its probability is
    /// adjusted for the looks alone.
    pub control: Option<CellTime>,
}

impl TimeGate {
    /// Why no time of this gate can be used, if so: the control differs, though both of its sides are one build.
    pub fn void_reason(&self) -> Option<String> {
        let moved = self.control.as_ref().filter(|control| control.has_changed())?;
        Some(format!(
            "the control {} has one build on both sides and yet differs by {:+.1} %",
            moved.cell,
            100.0 * moved.change.median
        ))
    }
}

/// Pairs of one order that a launch's figure is taken from: all that a launch may have, as half of its pairs have each order.
const MAX_SAMPLES: usize = 2 * MAX_PAIRS as usize;

/// A launch's figure from ln(head / base) of its pairs, by the side that was sampled first.
fn launch_ratio([a, b]: &[Vec<f64>; 2]) -> f64 {
    if a.is_empty() || b.is_empty() {
        return median(if a.is_empty() { b } else { a });
    }
    let (a, b) = (a.iter().take(MAX_SAMPLES), b.iter().take(MAX_SAMPLES));
    let means = a.flat_map(|x| b.clone().map(move |y| (x + y) / 2.0));
    median(&means.collect::<Vec<_>>())
}

/// Pairs by cell, those of the control apart.
type SortedPairs<'a> = BTreeMap<(bool, &'a CellId), Vec<&'a Pair>>;

/// The pairs of the launches before each look, and of all.
///
/// A comparison of an earlier version has a second measurement of the cells that its first left open: these are two looks, and a cell is
/// judged by its pairs of the second alone if it has any.
fn pairs_at_looks(comparison: &Comparison) -> Vec<SortedPairs<'_>> {
    let sorted = |counts: &dyn Fn(&Pair) -> bool| {
        let mut sorted = SortedPairs::new();
        for pair in comparison.pairs.iter().filter(|pair| usable(pair) && counts(pair)) {
            sorted.entry((pair.control, &pair.cell)).or_default().push(pair);
        }
        sorted
    };
    if has_second_measurement(comparison) {
        return [false, true].map(|second| sorted(&|pair| pair.second == second)).into();
    }
    let all = comparison.launches.len();
    let looks = looks(comparison).into_iter().map(|look| look as usize);
    let looks = looks.filter(|look| *look < all).chain([all]);
    let at_look = |look: usize| {
        let before: BTreeSet<u32> =
            comparison.launches[..look].iter().map(|launch| launch.launch).collect();
        sorted(&|pair| before.contains(&pair.launch))
    };
    looks.map(at_look).collect()
}

fn has_second_measurement(comparison: &Comparison) -> bool {
    comparison.launches.iter().any(|launch| launch.second)
}

/// Judges the cells of a comparison by the pairs of its complete launches.
pub fn judge(comparison: &Comparison) -> TimeGate {
    let rule = LookRule::new(comparison);
    let looks = pairs_at_looks(comparison);
    let by_last_look = |cell: &CellId| {
        let pairs = looks.iter().rev().find_map(|look| look.get(&(false, cell)))?;
        Some(CellTime::from_pairs(cell, pairs, &rule))
    };
    let cells = comparison.header.cells.iter().filter_map(by_last_look).collect();
    let mut cells = together(cells, &rule);
    if !AdapterRelation::from_header(&comparison.header).is_judged() {
        for cell in &mut cells {
            (cell.verdict, cell.detectable) = (TimeVerdict::NotJudged, None);
        }
    }
    let controls = looks.iter().filter_map(|look| {
        let ((_, cell), pairs) = look.iter().find(|((is_control, _), _)| *is_control)?;
        together(vec![CellTime::from_pairs(cell, pairs, &rule)], &rule).pop()
    });
    let controls: Vec<CellTime> = controls.collect();
    let moved = controls.iter().find(|control| control.has_changed());
    TimeGate { control: moved.or(controls.last()).cloned(), cells }
}

/// The cells with their probabilities adjusted together, and the verdicts that follow from these.
fn together(mut cells: Vec<CellTime>, rule: &LookRule) -> Vec<CellTime> {
    let probabilities: Vec<f64> = cells.iter().map(|cell| cell.p).collect();
    let count = cells.len();
    // What Holm's first step leaves to each of two directions.
    let level = rule.level / 2.0 / count.max(1) as f64;
    for (cell, adjusted_p) in cells.iter_mut().zip(rank::holm(&probabilities)) {
        cell.adjusted_for = count;
        if adjusted_p <= rule.level {
            let slower = cell.change.median > 0.0;
            cell.verdict = if slower { TimeVerdict::Slower } else { TimeVerdict::Faster };
        }
        let own = cell.launches.len();
        let is_open = cell.verdict == TimeVerdict::Inconclusive;
        let launches = if is_open { own } else { own.max(rule.max_launches) };
        let slowdown = |shift: f64| (rule.bound + shift * deviation(&cell.launches)).exp_m1();
        cell.detectable = rank::detectable(launches, level).map(slowdown);
    }
    cells
}

/// Launches after which a comparison is looked at. It ends with n where nothing is judged or n launches decide nothing.
pub fn looks(comparison: &Comparison) -> Vec<u32> {
    let GateSettings { launches, alpha, .. } = comparison.header.settings;
    let n = launches.min(MAX_LAUNCHES);
    if has_second_measurement(comparison) {
        return vec![2 * n];
    }
    if !AdapterRelation::from_header(&comparison.header).is_judged() {
        return vec![n];
    }
    let decides = rank::extreme_sums(n as usize, alpha / LOOKS / 2.0) > 0;
    let last = if decides { 2 * n } else { n };
    let mut looks = vec![(2 * n).div_ceil(5), n, last];
    looks.dedup();
    looks
}

/// Cells that the last look so far has decided. By the launches until then alone: a comparison that is resumed leaves out the same.
pub fn decided_cells(comparison: &Comparison) -> BTreeSet<CellId> {
    let mut looks = looks(comparison).into_iter().rev();
    let all = comparison.launches.len();
    let Some(look) = looks.find(|look| *look as usize <= all) else { return BTreeSet::new() };
    let mut before = comparison.clone();
    before.launches.truncate(look as usize);
    let cells = judge(&before).cells.into_iter();
    let decided = cells.filter(|cell| cell.verdict != TimeVerdict::Inconclusive);
    decided.map(|cell| cell.cell).collect()
}

fn usable(pair: &Pair) -> bool {
    let positive = |ns: f64| ns.is_finite() && ns > 0.0;
    positive(pair.base_ns) && positive(pair.head_ns)
}

#[cfg(test)]
mod tests;
