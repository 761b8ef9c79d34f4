//! Times of two runs. They share no pairs, so whatever the machine did between the runs is in every ratio.
//!
//! - What all stages have in common, the median of their ratios, is taken off and told once.
//! - How far ratios scatter about that where nothing changed, the runs tell themselves, as most stages did not change: the median
//!   distance from the common ratio gives the scale of an empirical null (Efron, *J. Am. Stat. Assoc.* 99 (2004)) with `TAILS`.
//! - A stage is judged by the median of its ratios over all cells. It is listed if its probability under the null is small among all
//!   stages ([`benjamini_hochberg`]): about 5 % of what is listed is there by chance.
//! - A time in one cell, of a stage that is not listed, is judged among all times by the same rule. It is listed only if the 95 %
//!   intervals of its two medians do not overlap, with the common ratio taken off.

use std::collections::{BTreeMap, BTreeSet};

use indexmap::IndexMap;
use itertools::Itertools;
use statrs::distribution::{ContinuousCDF, StudentsT};

use crate::rank::benjamini_hochberg;
use fathom_base::statistics::{self, ALPHA, MAD_TO_SIGMA, Z_95};
use fathom_record::{Cell, Estimate, Interval, StageRecord};

/// Stages that a common ratio and a scatter are told from: fewer cannot tell a change of the machine from one of a stage.
const MIN_STAGES: usize = 8;
/// Degrees of freedom of Student's distribution. Between two runs of one build on a loaded machine, 574 times: 5 % lay beyond 2.24
/// and 1 % beyond 3.35 times what the middle half gives for a standard deviation. 8 degrees give 2.20 and 3.20, a normal distribution
/// 1.96 and 2.58.
const TAILS: f64 = 8.0;
/// Standard error of a median over that of a mean, of normal samples: √(π/2).
const MEDIAN_EFFICIENCY: f64 = 1.253_314;

/// The time of a stage, or of a frame, in one cell of both runs.
#[derive(Clone, Debug)]
pub struct TimeChange<'a> {
    pub cell: &'a Cell,
    /// None of the whole frame without per-stage timing.
    pub stage: Option<&'a str>,
    /// Of base and head, nanoseconds.
    pub times: [Estimate; 2],
    /// Head over base. The interval has the ends of the two medians' intervals: it leaves 1 out where those do not overlap.
    pub ratio: Estimate,
}

impl<'a> TimeChange<'a> {
    /// None where a side has too few samples for an interval.
    fn new(cell: &'a Cell, stage: Option<&'a str>, times: [Estimate; 2]) -> Option<Self> {
        let [base, head] = times;
        let (b, h) = (base.interval?, head.interval?);
        let interval = Some(Interval { low: h.low / b.high, high: h.high / b.low });
        let n = base.n.min(head.n);
        let ratio = Estimate { median: head.median / base.median, interval, n };
        (b.low > 0.0 && h.low > 0.0).then_some(Self { cell, stage, times, ratio })
    }

    fn unit(&self, common: f64) -> StageShift {
        let of = |time: &Estimate| (time.ends()[1] / time.ends()[0]).ln() / (2.0 * Z_95);
        let error = of(&self.times[0]).hypot(of(&self.times[1]));
        StageShift { log_ratio: (self.ratio.median / common).ln(), error }
    }

    /// The intervals do not overlap, with this ratio taken off.
    fn is_apart(&self, common: f64) -> bool {
        let [low, high] = self.ratio.ends();
        low > common || high < common
    }

    /// The stage, or whose frame it is.
    fn name(&self) -> String {
        self.stage.map_or_else(|| format!("frame of {}", self.cell.pipeline), str::to_owned)
    }
}

/// What is judged among others of its kind.
struct StageShift {
    /// Logarithm of its ratio over the common one.
    log_ratio: f64,
    /// Standard error of that.
    error: f64,
}

/// What units scatter by where nothing changed.
fn null() -> StudentsT {
    StudentsT::new(0.0, 1.0, TAILS).expect("scale and degrees of freedom are positive")
}

/// The scale of their scatter, as most did not change.
fn scale(units: &[StageShift]) -> f64 {
    let off = units.iter().map(|unit| unit.log_ratio.abs()).collect_vec();
    statistics::median(&off) / null().inverse_cdf(0.75)
}

/// How far times of stages scatter between two runs, as shares.
#[derive(Clone, Copy, Debug)]
pub struct RunScatter {
    pub between: f64,
    /// A change of one stage that is surely listed: its probability is small enough even if it is the only one
    /// (the first step of [`benjamini_hochberg`]).
    pub visible: f64,
}

impl RunScatter {
    fn estimate(units: &[StageShift]) -> Option<Self> {
        let scale = (units.len() >= MIN_STAGES).then(|| scale(units))?;
        let farthest = null().inverse_cdf(1.0 - ALPHA / 2.0 / units.len() as f64);
        Some(Self { between: scale.exp_m1(), visible: (farthest * scale).exp_m1() })
    }
}

/// Which of these units changed; none among too few.
fn judge(units: &[StageShift]) -> Vec<bool> {
    if units.len() < MIN_STAGES {
        return vec![false; units.len()];
    }
    let null = null();
    let errors = units.iter().map(|unit| unit.error.powi(2)).collect_vec();
    // What the errors of the samples do not explain.
    let between = (scale(units).powi(2) - statistics::median(&errors)).max(0.0);
    let probability = |unit: &StageShift| match unit.log_ratio.abs() {
        off if off > 0.0 => 2.0 * null.sf(off / (between + unit.error.powi(2)).sqrt()),
        _ => 1.0,
    };
    let probabilities = units.iter().map(probability).collect_vec();
    let adjusted = benjamini_hochberg(&probabilities, probabilities.len());
    adjusted.into_iter().map(|adjusted| adjusted <= ALPHA).collect()
}

#[derive(Clone, Copy, Debug)]
pub struct CommonShift {
    /// The median of the stages' ratios, and those between which half of the stages lie.
    pub ratio: f64,
    pub half: Interval,
}

/// Times of one stage, or of the frames of one pipeline, that changed.
#[derive(Clone, Debug)]
pub struct StageChange<'a> {
    pub name: String,
    /// Cells in which its times were compared.
    pub cells: usize,
    /// The median of those that changed, over their cells.
    pub ratio: Estimate,
    /// The furthest from the common ratio first.
    pub changes: Vec<TimeChange<'a>>,
}

pub struct TimeChanges<'a> {
    pub all: Vec<TimeChange<'a>>,
    /// Stages of cells that another clock timed in the other run, or too short or with too few samples in one of them.
    pub uncompared: usize,
    pub stages: usize,
    /// None of too few stages.
    pub common: Option<CommonShift>,
    pub scatter: Option<RunScatter>,
    /// Stages that changed in the median of their cells, then those that did in some cells: what costs or saves most time first.
    pub changed: Vec<StageChange<'a>>,
}

impl<'a> TimeChanges<'a> {
    pub fn compare(cells: &[[&'a Cell; 2]]) -> Self {
        let (mut all, mut uncompared) = (Vec::new(), 0);
        for cell in cells {
            uncompared += add(*cell, &mut all);
        }
        let mut stages = IndexMap::<String, Vec<TimeChange<'a>>>::new();
        for time in &all {
            stages.entry(time.name()).or_default().push(time.clone());
        }
        let ratios = stages.values().map(|times| median_ratio(times).median).collect_vec();
        let common = (ratios.len() >= MIN_STAGES).then(|| CommonShift {
            ratio: statistics::median(&ratios),
            half: Interval {
                low: statistics::quantile(&ratios, 0.25),
                high: statistics::quantile(&ratios, 0.75),
            },
        });
        let changed = common.map_or_else(Vec::new, |common| changed(&stages, &all, common.ratio));
        let scatter =
            common.and_then(|common| RunScatter::estimate(&stage_units(&stages, common.ratio)));
        Self { all, uncompared, stages: stages.len(), common, scatter, changed }
    }

    pub fn frames(&self) -> impl Iterator<Item = &TimeChange<'a>> {
        self.all.iter().filter(|time| time.stage.is_none())
    }

    /// How many times have intervals that do not overlap, with no more said than that.
    pub fn count_disjoint(&self) -> usize {
        self.all.iter().filter(|time| time.is_apart(1.0)).count()
    }
}

/// Adds the times of a cell, and counts the stages that cannot be compared.
fn add<'a>([base, head]: [&'a Cell; 2], all: &mut Vec<TimeChange<'a>>) -> usize {
    let Some((b, h)) = base.measured().zip(head.measured()) else { return 0 };
    if !(b.is_timed() && h.is_timed()) {
        return 0;
    }
    all.extend(TimeChange::new(head, None, [b.frame.untimed, h.frame.untimed]));
    let before: BTreeMap<&str, &StageRecord> =
        b.stages.iter().map(|stage| (stage.stage.as_str(), stage)).collect();
    let mut uncompared = 0;
    for stage in &h.stages {
        let Some(before) = before.get(stage.stage.as_str()) else { continue };
        let comparable = before.clock == stage.clock && before.is_resolved() && stage.is_resolved();
        let change = TimeChange::new(head, Some(&stage.stage), [before.time, stage.time]);
        match change.filter(|_| comparable) {
            Some(change) => all.push(change),
            None => uncompared += 1,
        }
    }
    uncompared
}

fn median_ratio(times: &[TimeChange<'_>]) -> Estimate {
    statistics::estimate(&times.iter().map(|time| time.ratio.median).collect_vec())
}

fn changed<'a>(
    stages: &IndexMap<String, Vec<TimeChange<'a>>>,
    all: &[TimeChange<'a>],
    common: f64,
) -> Vec<StageChange<'a>> {
    let by_stage = judge(&stage_units(stages, common));
    let named = stages.iter().zip(by_stage).filter(|(_, changed)| *changed);
    let whole: Vec<(&String, Vec<TimeChange<'a>>)> =
        named.map(|((name, times), _)| (name, times.clone())).collect();
    let listed: BTreeSet<&String> = whole.iter().map(|(name, _)| *name).collect();
    let by_time = judge(&all.iter().map(|time| time.unit(common)).collect_vec());
    let mut some = IndexMap::<(&String, bool), Vec<TimeChange<'a>>>::new();
    for (time, changed) in all.iter().zip(by_time) {
        let (name, _) = stages.get_key_value(&time.name()).expect("each time is of a stage");
        if changed && time.is_apart(common) && !listed.contains(name) {
            let slower = time.ratio.median > common;
            some.entry((name, slower)).or_default().push(time.clone());
        }
    }
    let cost = |time: &TimeChange<'_>| time.times[1].median - common * time.times[0].median;
    let of = |(name, mut found): (&String, Vec<TimeChange<'a>>)| {
        let off = |time: &TimeChange<'_>| time.unit(common).log_ratio.abs();
        found.sort_by(|a, b| off(b).total_cmp(&off(a)));
        let ratio = median_ratio(&found);
        StageChange { name: name.clone(), cells: stages[name].len(), ratio, changes: found }
    };
    let weight = |change: &StageChange<'_>| change.changes.iter().map(cost).sum::<f64>().abs();
    let heaviest = |changes: Vec<StageChange<'a>>| {
        changes.into_iter().sorted_by(|a, b| weight(b).total_cmp(&weight(a)))
    };
    let some = some.into_iter().map(|((name, _), found)| (name, found));
    heaviest(whole.into_iter().map(of).collect()).chain(heaviest(some.map(of).collect())).collect()
}

/// A unit for each stage: the median over its cells, whose error follows from how far cells lie from the median of their stage.
fn stage_units(stages: &IndexMap<String, Vec<TimeChange<'_>>>, common: f64) -> Vec<StageShift> {
    let medians = stages.values().map(|times| median_ratio(times).median).collect_vec();
    let inner = stages.values().zip(&medians).filter(|(times, _)| times.len() > 2);
    let inner = inner.flat_map(|(times, median)| {
        times.iter().map(move |time| (time.ratio.median / median).ln().abs())
    });
    let inner = inner.collect_vec();
    let spread = if inner.is_empty() { 0.0 } else { MAD_TO_SIGMA * statistics::median(&inner) };
    let of = |(times, median): (&Vec<TimeChange<'_>>, &f64)| StageShift {
        log_ratio: (median / common).ln(),
        error: MEDIAN_EFFICIENCY * spread / (times.len() as f64).sqrt(),
    };
    stages.values().zip(&medians).map(of).collect()
}
