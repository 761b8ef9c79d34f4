//! The changes of all series of a history, and how sure each is among so many.

use std::iter::once;

use itertools::Itertools;
use rayon::prelude::*;

use super::controls::{Controls, MAX_SIDE, MachineShift};
use super::stored::{FigureSeries, StoredRuns};
use fathom_judge::change_points::{MIN_RUNS, change_points};
use fathom_judge::rank::benjamini_hochberg;
use fathom_judge::scores::Scores;
use fathom_judge::shift::shift;
use fathom_record::Estimate;

/// A change is sure where, of all changes that are as sure or surer, at most this share is expected to be false. Benjamini &
/// Hochberg, *J. R. Stat. Soc. B* 57 (1995).
pub const FALSE_SHARE: f64 = 0.05;

/// By how much a figure changed, the later runs against the earlier ones.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Size {
    /// Relative: 0.05 is 5 % more.
    Share(Estimate),
    /// In the figure's unit, where a value is not positive.
    Difference(Estimate),
}

impl Size {
    fn between(before: &[f64], after: &[f64]) -> Size {
        let before = &before[before.len().saturating_sub(MAX_SIDE)..];
        let after = &after[..after.len().min(MAX_SIDE)];
        if before.iter().chain(after).all(|value| *value > 0.0) {
            let logarithms = |values: &[f64]| values.iter().map(|v| v.ln()).collect::<Vec<f64>>();
            return Size::Share(shift(&logarithms(before), &logarithms(after)).map(f64::exp_m1));
        }
        Size::Difference(shift(before, after))
    }

    /// For the order of a table: doubling and halving are of one size.
    fn magnitude(&self) -> f64 {
        match self {
            Size::Share(share) => share.median.ln_1p().abs(),
            Size::Difference(_) => f64::INFINITY,
        }
    }

    pub fn estimate(&self) -> &Estimate {
        let (Size::Share(estimate) | Size::Difference(estimate)) = self;
        estimate
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SeriesChange {
    /// Place of its series in [`StoredRuns::series`].
    pub series: usize,
    /// The first point of the new level in that series.
    pub point: usize,
    /// Places in [`StoredRuns::runs`] of the last run before and the first one after.
    pub runs: [usize; 2],
    pub size: Size,
    /// Runs of the level before, and of the one after.
    pub n: [usize; 2],
    /// Chance that a stable series has such a change, at most.
    pub p: f64,
    /// Share of false changes that is expected among those as sure as this or surer, 0 … 1.
    pub false_share: f64,
    /// What the machine did meanwhile. Where it did a part, `size` is what is left.
    pub machine: MachineShift,
}

/// What is said of a change, the most important first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, strum::Display)]
#[strum(serialize_all = "lowercase")]
pub enum Certainty {
    Sure,
    Possible,
    /// The controls share it: no change of a commit.
    #[strum(to_string = "machine drift")]
    Drift,
}

impl SeriesChange {
    pub fn certainty(&self) -> Certainty {
        match self.machine {
            MachineShift::Whole(_) => Certainty::Drift,
            _ if self.false_share <= FALSE_SHARE => Certainty::Sure,
            _ => Certainty::Possible,
        }
    }

    pub fn is_sure(&self) -> bool {
        self.certainty() == Certainty::Sure
    }
}

#[derive(Clone, Debug, Default, PartialEq)]
pub struct HistoryChanges {
    /// Sure ones first, those of the machine last, each kind by size, largest first.
    pub changes: Vec<SeriesChange>,
    /// Series that were long enough to be searched.
    pub searched: usize,
    /// Series that were too short.
    pub too_short: usize,
}

impl HistoryChanges {
    pub fn find(stored: &StoredRuns) -> HistoryChanges {
        let is_long = |series: &&FigureSeries| series.points.len() >= MIN_RUNS;
        let searched = stored.series.iter().filter(is_long).count();
        let controls = &Controls::from_runs(stored);
        let numbered = stored.series.par_iter().enumerate();
        let mut changes: Vec<SeriesChange> = numbered
            .map_init(Scores::default, |scores, (place, series)| {
                search_series(place, series, scores, controls)
            })
            .flatten()
            .collect();
        set_false_share(&mut changes, searched);
        changes.sort_by(|a, b| {
            let by_size = b.size.magnitude().total_cmp(&a.size.magnitude());
            let by_place = (a.series, a.point).cmp(&(b.series, b.point));
            a.certainty().cmp(&b.certainty()).then(by_size).then(by_place)
        });
        HistoryChanges { changes, searched, too_short: stored.series.len() - searched }
    }

    pub fn in_series(&self, series: usize) -> Vec<&SeriesChange> {
        let mut sure_changes: Vec<&SeriesChange> =
            self.changes.iter().filter(|c| c.series == series).collect();
        sure_changes.sort_by_key(|change| change.point);
        sure_changes
    }

    /// How many are of this kind.
    pub fn count(&self, certainty: Certainty) -> usize {
        self.changes.iter().filter(|change| change.certainty() == certainty).count()
    }
}

fn search_series(
    place: usize,
    series: &FigureSeries,
    scores: &mut Scores,
    controls: &Controls,
) -> Vec<SeriesChange> {
    let values: Vec<f64> = series.points.iter().map(|point| point.value.median).collect();
    let points = change_points(&values, scores);
    let inner = points.iter().map(|point| point.first);
    let bounds: Vec<usize> = once(0).chain(inner).chain([values.len()]).collect();
    let change =
        points.iter().zip(bounds.into_iter().tuple_windows()).map(|(point, (from, at, to))| {
            let machine = controls.judge(series, [from, at, to]);
            SeriesChange {
                series: place,
                point: at,
                runs: [at - 1, at].map(|at| series.points[at].run),
                size: match machine {
                    MachineShift::Partly { left, .. } => Size::Share(left.map(f64::exp_m1)),
                    _ => Size::between(&values[from..at], &values[at..to]),
                },
                n: [at - from, to - at],
                p: point.p,
                false_share: 1.0,
                machine,
            }
        });
    change.collect()
}

/// Each series is searched once, and both sides of each change once more.
fn set_false_share(changes: &mut [SeriesChange], searched: usize) {
    let p: Vec<f64> = changes.iter().map(|change| change.p).collect();
    let shares = benjamini_hochberg(&p, searched + 2 * p.len());
    changes.iter_mut().zip(shares).for_each(|(change, share)| change.false_share = share);
}

#[cfg(test)]
mod tests;
