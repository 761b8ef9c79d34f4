//! What the pairs of the time gate say: a function of stored lines alone.
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
//! Figures of different launches are independent, pairs of one launch are not, as processes carry a bias of their own; so
//! intervals and tests are over launches.

use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;

use super::adapters::AdapterRelation;
use super::rank;
use super::store::StoredComparison;
use fathom_base::statistics::median;
use fathom_record::comparison::{CellId, ComparisonHeader, GateSettings, MOST_PAIRS, Pair, Side};
use fathom_record::{MachineState, ThrottleReason};

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
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

/// What the time gate says of a cell.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CellTime {
    pub cell: CellId,
    pub verdict: TimeVerdict,
    /// Launches that went through all rounds, of the measurement that counts.
    pub launches: usize,
    /// This was the second.
    pub second: bool,
    /// Median sample of each side.
    pub base_ns: f64,
    pub head_ns: f64,
    /// Head over base less one, with the interval over launches of the measurement that counts; none where there are too few
    /// launches for it. Each measurement's intervals cover 1 − `alpha`. The first measurement decides whether there is a second,
    /// so intervals of a change at the threshold cover 93 %, not 95 %, by calculation (in simulated gates 914 of 1,000).
    pub change: f64,
    pub interval: Option<(f64, f64)>,
    /// Of a change beyond the threshold in either direction, by chance; and the same adjusted for two measurements of all cells.
    pub p: f64,
    pub adjusted_p: f64,
    /// Standard deviation between launches.
    pub spread: f64,
    /// The least slowdown that would be found with the power [`rank::POWER`], from the spread and the number of launches;
    /// none where so few launches among so many cells find nothing.
    pub detectable: Option<f64>,
    /// Where clocks were held down in any launch.
    pub throttled: Option<ThrottledLaunches>,
}

impl CellTime {
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
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ThrottledLaunches {
    pub base: usize,
    pub head: usize,
    pub reasons: BTreeSet<ThrottleReason>,
}

impl ThrottledLaunches {
    fn of(pairs: &[&Pair]) -> Option<Self> {
        let states = |state: fn(&Pair) -> Option<&MachineState>| {
            let known = pairs.iter().filter_map(move |pair| Some((pair.launch, state(pair)?)));
            known.filter(|(_, state)| state.is_throttled())
        };
        let of_base = states(|pair| pair.machine.base.as_ref());
        let of_head = states(|pair| pair.machine.head.as_ref());
        let launches = |states: &mut dyn Iterator<Item = (u32, &MachineState)>| {
            states.map(|(launch, _)| launch).collect::<BTreeSet<u32>>().len()
        };
        let reasons = of_base.clone().chain(of_head.clone());
        let reasons: BTreeSet<ThrottleReason> =
            reasons.flat_map(|(_, state)| state.harmful().cloned()).collect();
        (!reasons.is_empty()).then(|| Self {
            base: launches(&mut of_base.clone()),
            head: launches(&mut of_head.clone()),
            reasons,
        })
    }
}

/// What the time gate says.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
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
    pub fn void(&self, alpha: f64) -> Option<String> {
        let mut controls = self.controls.iter();
        let moved = controls.find(|control| control.adjusted_p <= alpha)?;
        Some(format!(
            "the control {} has the base on both sides and yet differs by {:+.1} %",
            moved.cell,
            100.0 * moved.change
        ))
    }
}

/// Pairs of one order that a launch's figure is taken from: all that a launch may have, as half of its pairs have each order.
const MOST_SAMPLES: usize = 2 * MOST_PAIRS as usize;

/// ln(head / base) of one launch's pairs, by the side that was sampled first.
#[derive(Default)]
struct Ratios {
    base_first: Vec<f64>,
    head_first: Vec<f64>,
}

impl Ratios {
    fn middle(&self) -> f64 {
        let (a, b) = (&self.base_first, &self.head_first);
        if a.is_empty() || b.is_empty() {
            return median(if a.is_empty() { b } else { a });
        }
        let (a, b) = (a.iter().take(MOST_SAMPLES), b.iter().take(MOST_SAMPLES));
        let means = a.flat_map(|x| b.clone().map(move |y| (x + y) / 2.0));
        median(&means.collect::<Vec<_>>())
    }
}

/// The figures of one cell.
struct Figures {
    cell: CellId,
    second: bool,
    /// ln(head / base) of each launch.
    launches: Vec<f64>,
    base_ns: f64,
    head_ns: f64,
    throttled: Option<ThrottledLaunches>,
}

impl Figures {
    fn of(cell: &CellId, second: bool, pairs: &[&Pair]) -> Option<Self> {
        let mut ratios: BTreeMap<u32, Ratios> = BTreeMap::new();
        for pair in pairs {
            let ratio = (pair.head_ns / pair.base_ns).ln();
            let ratios = ratios.entry(pair.launch).or_default();
            match pair.first {
                Side::Base => ratios.base_first.push(ratio),
                Side::Head => ratios.head_first.push(ratio),
            }
        }
        let middle = |ns: fn(&Pair) -> f64| {
            let all: Vec<f64> = pairs.iter().map(|pair| ns(pair)).collect();
            median(&all)
        };
        (!ratios.is_empty()).then(|| Self {
            cell: cell.clone(),
            second,
            launches: ratios.values().map(Ratios::middle).collect(),
            base_ns: middle(|pair| pair.base_ns),
            head_ns: middle(|pair| pair.head_ns),
            throttled: ThrottledLaunches::of(pairs),
        })
    }

    /// Probability of launches so far beyond the threshold, to either side, where the change is within it.
    fn p(&self, threshold: f64) -> f64 {
        let bound = (1.0 + threshold).ln();
        let slower = rank::above(&self.launches, bound);
        let faster = rank::below(&self.launches, -bound);
        (2.0 * slower.min(faster)).min(1.0)
    }

    fn judged(
        self,
        settings: &GateSettings,
        p: f64,
        adjusted_p: f64,
        shift: Option<f64>,
    ) -> CellTime {
        let bound = (1.0 + settings.threshold).ln();
        let centre = rank::centre(&self.launches, settings.alpha);
        let verdict = if adjusted_p <= settings.alpha {
            if centre.estimate > 0.0 { TimeVerdict::Slower } else { TimeVerdict::Faster }
        } else if -bound <= centre.low && centre.high <= bound {
            TimeVerdict::Same
        } else {
            TimeVerdict::Inconclusive
        };
        let spread = deviation(&self.launches);
        let interval = (centre.low.is_finite() && centre.high.is_finite())
            .then(|| (centre.low.exp_m1(), centre.high.exp_m1()));
        CellTime {
            verdict,
            launches: self.launches.len(),
            second: self.second,
            base_ns: self.base_ns,
            head_ns: self.head_ns,
            change: centre.estimate.exp_m1(),
            interval,
            p,
            adjusted_p,
            spread,
            detectable: shift.map(|shift| (bound + shift * spread).exp_m1()),
            throttled: self.throttled,
            cell: self.cell,
        }
    }
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
    let figures = |cell: &CellId, second: bool| {
        let pairs = sorted.get(&(cell, false, second))?;
        Figures::of(cell, second, pairs)
    };
    let last = |cell: &CellId| figures(cell, true).or_else(|| figures(cell, false));
    let measured: Vec<Figures> = cells.iter().filter_map(last).collect();
    let controls = sorted.iter().filter(|((_, control, _), _)| *control);
    let controls =
        controls.filter_map(|((cell, _, second), pairs)| Figures::of(cell, *second, pairs));
    TimeGate {
        cells: judged(measured, settings),
        controls: controls.flat_map(|control| judged(vec![control], settings)).collect(),
    }
}

/// Verdicts on figures whose probabilities are adjusted together.
fn judged(measured: Vec<Figures>, settings: &GateSettings) -> Vec<CellTime> {
    let p: Vec<f64> = measured.iter().map(|cell| cell.p(settings.threshold)).collect();
    let doubled: Vec<f64> = p.iter().map(|p| (MEASUREMENTS * p).min(1.0)).collect();
    let adjusted = rank::holm(&doubled);
    // What Holm's first step leaves to each of two directions.
    let level = settings.alpha / 2.0 / MEASUREMENTS / measured.len().max(1) as f64;
    let judged = measured.into_iter().zip(p).zip(adjusted);
    let judged = judged.map(|((cell, p), adjusted_p)| {
        let shift = rank::detectable(cell.launches.len(), level);
        cell.judged(settings, p, adjusted_p, shift)
    });
    judged.collect()
}

/// Cells of which a complete first measurement tells neither a change nor that there is none, and a second one may.
pub fn open(comparison: &StoredComparison) -> Vec<CellId> {
    let ComparisonHeader { cells, settings, .. } = &comparison.header;
    let is_judged = AdapterRelation::in_header(&comparison.header).is_judged();
    if !is_judged || comparison.launches_of(false) < settings.launches as usize {
        return Vec::new();
    }
    let first = comparison.pairs.iter().filter(|pair| !pair.second);
    let gate = judge(cells, first, settings);
    let open = gate
        .cells
        .into_iter()
        .filter(|cell| cell.verdict == TimeVerdict::Inconclusive && cell.detectable.is_some());
    open.map(|cell| cell.cell).collect()
}

fn usable(pair: &Pair) -> bool {
    let positive = |ns: f64| ns.is_finite() && ns > 0.0;
    positive(pair.base_ns) && positive(pair.head_ns)
}

fn deviation(samples: &[f64]) -> f64 {
    let n = samples.len() as f64;
    let mean = samples.iter().sum::<f64>() / n;
    let squares: f64 = samples.iter().map(|x| (x - mean).powi(2)).sum();
    (squares / (n - 1.0).max(1.0)).sqrt()
}

#[cfg(test)]
mod tests;
