//! The time gate's verdicts, from the stored pairs alone.
//!
//! A pair's figure is ln(head / base), as drift affects both of its sides. Who is sampled second in a pair finds the caches
//! warmer, by up to 4 % of a sample, so a launch's figure of a cell is the median over all means of a pair in which the base
//! came first and one in which the head did: the median of Hodges and Lehmann (1963) with that effect taken out, and a stall
//! falls on few of them. Between launches of equal builds, in two gates of 41 cells, it scatters 4 to 5 % less than the plain median
//! of the pairs.
//!
//! A cell that the first measurement leaves open is measured a second time, with more pairs; then only the second counts, so that
//! no interval rests on numbers that were looked at before. Each probability counts double for the two chances of an alarm.
//!
//! Cells that the first [`LOOK`] launches show to be the same are not sampled in later ones. Nothing can be called changed
//! then, so that looking costs no false alarm. In simulated gates intervals go on to cover 94 to 97 %.
//!
//! Figures of different launches are independent, pairs of one launch are not, as processes carry a bias of their own; so
//! intervals and tests are over launches.

use std::collections::{BTreeMap, BTreeSet};

use super::adapters::AdapterRelation;
use super::rank;
use super::store::Comparison;
use fathom_base::statistics::{Estimate, deviation, median};
use fathom_record::ThrottleReason;
use fathom_record::comparison::{
    CellId, ComparisonHeader, GateSettings, MAX_LAUNCHES, MAX_PAIRS, Pair,
};

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

/// Launches after which it is looked at what is settled. Of 65 cells of equal builds, beside 12 busy processes on two cores, 35
/// were (llvmpipe).
pub const LOOK: u32 = 8;

/// The time gate's result for a cell.
#[derive(Clone, Debug, PartialEq)]
pub struct CellTime {
    pub cell: CellId,
    pub verdict: TimeVerdict,
    /// ln(head / base) of each launch that went through all rounds, of the measurement that counts.
    pub launches: Vec<f64>,
    /// This was the second.
    pub second: bool,
    /// Median sample of each side.
    pub base_ns: f64,
    pub head_ns: f64,
    /// Head over base less one, with the interval over launches of the measurement that counts; none where there are too few
    /// launches for it. Each measurement's intervals cover 1 − `alpha`. The first measurement decides whether there is a second,
    /// so intervals of a change at the threshold cover 93 %, not 95 %, by calculation (in simulated gates 914 of 1,000).
    pub change: Estimate,
    /// Of a change beyond the threshold in either direction, by chance; and the same adjusted for two measurements of all cells.
    pub p: f64,
    pub adjusted_p: f64,
    /// For how many cells.
    pub adjusted_for: usize,
    /// The whole interval lies beyond the threshold, in one direction.
    pub is_beyond_threshold: bool,
    /// The least slowdown that would be found with the power [`rank::POWER`], from the number of launches and their spread; none
    /// where so few launches among so many cells find nothing.
    pub detectable: Option<f64>,
    /// Where clocks were held down in any launch.
    pub throttled: Option<ThrottledLaunches>,
}

impl CellTime {
    /// What the pairs of one cell say alone; [`together`] adds what they say among others.
    fn from_pairs(cell: &CellId, second: bool, pairs: &[&Pair], settings: &GateSettings) -> Self {
        let mut ratios: BTreeMap<u32, [Vec<f64>; 2]> = BTreeMap::new();
        for pair in pairs {
            let of_launch = ratios.entry(pair.launch).or_default();
            of_launch[pair.first as usize].push((pair.head_ns / pair.base_ns).ln());
        }
        let launches: Vec<f64> = ratios.values().map(launch_ratio).collect();
        let median = |ns: fn(&&Pair) -> f64| median(&pairs.iter().map(ns).collect::<Vec<_>>());
        let centre = rank::centre(&launches, settings.alpha);
        let bound = (1.0 + settings.threshold).ln();
        let is_same = centre.interval.is_some_and(|i| -bound <= i.low && i.high <= bound);
        let slower = rank::above(&launches, bound);
        let faster = rank::below(&launches, -bound);
        Self {
            cell: cell.clone(),
            verdict: if is_same { TimeVerdict::Same } else { TimeVerdict::Inconclusive },
            second,
            base_ns: median(|pair| pair.base_ns),
            head_ns: median(|pair| pair.head_ns),
            is_beyond_threshold: centre.interval.is_some_and(|i| i.low > bound || i.high < -bound),
            change: centre.map(f64::exp_m1),
            p: (2.0 * slower.min(faster)).min(1.0),
            adjusted_p: 1.0,
            adjusted_for: 1,
            detectable: None,
            throttled: ThrottledLaunches::count(pairs),
            launches,
        }
    }

    /// Launches that it would have had if the look had not settled it. A damaged file may ask for any number.
    fn max_launches(&self, settings: &GateSettings) -> usize {
        let n = self.launches.len();
        let is_settled = !self.second && self.verdict == TimeVerdict::Same && n == LOOK as usize;
        if is_settled { n.max(settings.launches.min(MAX_LAUNCHES) as usize) } else { n }
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
    /// The same cell with the base on both sides, in the first measurement and in the second if there is one; their
    /// probabilities are adjusted for these two alone.
    pub controls: Vec<CellTime>,
}

impl TimeGate {
    /// The same times where the sides ran on different adapters: no change of one of them is judged. The control, which ran on one,
    /// stays.
    pub fn unjudged(mut self) -> Self {
        for cell in &mut self.cells {
            (cell.verdict, cell.detectable) = (TimeVerdict::NotJudged, None);
        }
        self
    }

    /// Why no time of this gate can be used, if so: the control differs, though both of its sides are the base.
    pub fn void_reason(&self, alpha: f64) -> Option<String> {
        let mut controls = self.controls.iter();
        let moved = controls.find(|control| control.adjusted_p <= alpha)?;
        Some(format!(
            "the control {} has the base on both sides and yet differs by {:+.1} %",
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

/// Measurements that a cell may go through.
const MEASUREMENTS: f64 = 2.0;

/// Judges `cells` by the pairs of complete launches.
pub fn judge<'a>(
    cells: &'a [CellId],
    pairs: impl IntoIterator<Item = &'a Pair>,
    settings: &GateSettings,
) -> TimeGate {
    let mut sorted: BTreeMap<(&CellId, bool, bool), Vec<&Pair>> = BTreeMap::new();
    for pair in pairs.into_iter().filter(|pair| usable(pair)) {
        let key = (&pair.cell, pair.control, pair.second);
        sorted.entry(key).or_default().push(pair);
    }
    let of = |cell: &CellId, control, second| {
        let pairs = sorted.get(&(cell, control, second))?;
        Some(CellTime::from_pairs(cell, second, pairs, settings))
    };
    let last = |cell: &CellId| of(cell, false, true).or_else(|| of(cell, false, false));
    let controls = sorted.keys().filter(|(_, control, _)| *control);
    let controls = controls.filter_map(|(cell, control, second)| of(cell, *control, *second));
    TimeGate {
        cells: together(cells.iter().filter_map(last).collect(), settings),
        controls: controls.flat_map(|control| together(vec![control], settings)).collect(),
    }
}

/// The cells with their probabilities adjusted together, and the verdicts that follow from these.
fn together(mut cells: Vec<CellTime>, settings: &GateSettings) -> Vec<CellTime> {
    let doubled: Vec<f64> = cells.iter().map(|cell| (MEASUREMENTS * cell.p).min(1.0)).collect();
    // What Holm's first step leaves to each of two directions.
    let level = settings.alpha / 2.0 / MEASUREMENTS / cells.len().max(1) as f64;
    let bound = (1.0 + settings.threshold).ln();
    let count = cells.len();
    for (cell, adjusted_p) in cells.iter_mut().zip(rank::holm(&doubled)) {
        (cell.adjusted_p, cell.adjusted_for) = (adjusted_p, count);
        if adjusted_p <= settings.alpha {
            let slower = cell.change.median > 0.0;
            cell.verdict = if slower { TimeVerdict::Slower } else { TimeVerdict::Faster };
        }
        let shift = rank::detectable(cell.max_launches(settings), level);
        let slowdown = |shift: f64| (bound + shift * deviation(&cell.launches)).exp_m1();
        cell.detectable = shift.map(slowdown);
    }
    cells
}

/// Cells of which a complete first measurement tells neither a change nor that there is none, and a second one may.
pub fn open(comparison: &Comparison) -> Vec<CellId> {
    let ComparisonHeader { cells, settings, .. } = &comparison.header;
    let is_judged = AdapterRelation::from_header(&comparison.header).is_judged();
    if !is_judged || !is_first_complete(comparison) {
        return Vec::new();
    }
    let first = comparison.pairs.iter().filter(|pair| !pair.second);
    let cells = judge(cells, first, settings).cells.into_iter();
    let open =
        cells.filter(|cell| cell.verdict == TimeVerdict::Inconclusive && cell.detectable.is_some());
    open.map(|cell| cell.cell).collect()
}

/// Launches before the look; none where it could spare less than half of them.
pub fn launches_before_look(settings: &GateSettings) -> Option<u32> {
    (settings.launches >= 2 * LOOK).then_some(LOOK)
}

/// Cells that the launches before the look show to be unchanged. At half the level, as the last launch tells again.
pub fn unchanged_cells(comparison: &Comparison) -> BTreeSet<CellId> {
    let ComparisonHeader { cells, settings, .. } = &comparison.header;
    let Some(look) = launches_before_look(settings) else { return BTreeSet::new() };
    let first = comparison.launches.iter().filter(|launch| !launch.second);
    let first: BTreeSet<u32> = first.map(|launch| launch.launch).take(look as usize).collect();
    if first.len() < look as usize {
        return BTreeSet::new();
    }
    let settings = GateSettings { alpha: settings.alpha / 2.0, ..settings.clone() };
    let pairs = comparison.pairs.iter().filter(|pair| first.contains(&pair.launch));
    let same = judge(cells, pairs, &settings).cells.into_iter();
    same.filter(|cell| cell.verdict == TimeVerdict::Same).map(|cell| cell.cell).collect()
}

/// The first measurement has all its launches, or nothing is left to measure.
pub fn is_first_complete(comparison: &Comparison) -> bool {
    let settings = &comparison.header.settings;
    let settled = unchanged_cells(comparison);
    let is_settled = |pair: &Pair| pair.control || settled.contains(&pair.cell);
    comparison.launches_of(false) >= settings.launches as usize
        || !settled.is_empty() && comparison.pairs.iter().all(is_settled)
}

fn usable(pair: &Pair) -> bool {
    let positive = |ns: f64| ns.is_finite() && ns > 0.0;
    positive(pair.base_ns) && positive(pair.head_ns)
}

#[cfg(test)]
mod tests;
