//! Change points of one series: where its level shifted, by ranks alone.
//!
//! Seeded binary segmentation (Kovács, Bühlmann, Li & Munk, *Biometrika* 110 (2023)): the series and overlapping intervals of half,
//! a quarter, … of its length are each searched for their best split; the surest split is taken, and both sides are searched
//! in the same way. Short intervals find a slowdown that was repaired soon after, which a split of the whole series misses.
//!
//! A split compares the normal scores (van der Waerden) of both sides. Under the hypothesis that the runs could have come in any
//! order, its distribution depends on the number of runs only, not on that of the noise: outliers and heavy tails raise no
//! false alarms. Student's t gives its tail (Conover & Iman, *Am. Stat.* 35 (1981)), and the number of arrangements a lower
//! bound. That the best of many splits is looked at is allowed for by the tail of the largest standardized Brownian bridge
//! (Csörgő & Horváth, *Limit Theorems in Change-Point Analysis* (1997), section 1.3) or by the number of splits, whichever is
//! less; that many intervals are searched by the number of intervals.
//!
//! Everything is deterministic.

use statrs::distribution::{ContinuousCDF, Normal, StudentsT};
use statrs::function::factorial::ln_binomial;

use crate::scores::{RankScores, Scores};

/// Chance that a stable series has a change point. By calculation an upper bound; `docs/history.md` has what was measured.
pub const LEVEL: f64 = 0.1;
/// Fewest runs in which a change can reach [`LEVEL`].
pub const MIN_RUNS: usize = 10;
/// Fewest runs on either side of a change: one or two slow nights are no change.
pub const MIN_SIDE: usize = 3;
/// Shortest of the intervals that are searched beside a whole segment.
const MIN_INTERVAL: usize = 20;
/// Share of the level for the whole segment. The rest is for its intervals.
const WHOLE_SHARE: f64 = 0.5;

/// A run from which on the series has another level.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChangePoint {
    /// The first run of the new level, counted from 0.
    pub first: usize,
    /// The least level at which it is found: chance that a stable series has such a change, at most. Of a split of a part, allowed
    /// for what was searched there.
    pub p: f64,
}

/// The change points of a series at [`LEVEL`], in their order. None of a series shorter than [`MIN_RUNS`].
pub fn change_points(values: &[f64], scores: &mut Scores) -> Vec<ChangePoint> {
    let mut change_points = Vec::new();
    search(values, 0, 0.0, scores, &mut change_points);
    change_points.sort_unstable_by_key(|point| point.first);
    settle(values, scores, &mut change_points);
    change_points
}

/// Splits a segment that begins with the run `first` and came about by a split of probability `parent`.
fn search(
    values: &[f64],
    first: usize,
    parent: f64,
    scores: &mut Scores,
    found: &mut Vec<ChangePoint>,
) {
    let Some(split) = surest(values, scores).filter(|split| split.p <= LEVEL) else { return };
    let p = split.p.max(parent);
    found.push(ChangePoint { first: first + split.first, p });
    let (before, after) = values.split_at(split.first);
    search(before, first, p, scores, found);
    search(after, first + split.first, p, scores, found);
}

/// The surest split of a segment over all intervals in it.
fn surest(values: &[f64], scores: &mut Scores) -> Option<ChangePoint> {
    let whole = best_split(values, scores)?;
    let mut surest = ChangePoint { p: (whole.p / WHOLE_SHARE).min(1.0), ..whole };
    let layers = layers(values.len());
    for (length, starts) in &layers {
        let share = (1.0 - WHOLE_SHARE) / (layers.len() * starts.len()) as f64;
        for start in starts {
            let Some(split) = best_split(&values[*start..start + length], scores) else { continue };
            if split.p / share < surest.p {
                surest = ChangePoint { first: start + split.first, p: split.p / share };
            }
        }
    }
    Some(surest)
}

/// Lengths and starts of the intervals of a segment: each layer has intervals of half the length of the one before, which overlap
/// by half.
fn layers(n: usize) -> Vec<(usize, Vec<usize>)> {
    let lengths = (1..).map(|layer| n.div_ceil(1 << layer));
    let lengths = lengths.take_while(|length| *length >= MIN_INTERVAL);
    lengths
        .map(|length| {
            let steps = (n - length).div_ceil(length / 2);
            (length, (0..=steps).map(|step| step * (n - length) / steps).collect())
        })
        .collect()
}

/// The best split of an interval, its probability allowed for the number of splits. None of an interval that is too short.
fn best_split(values: &[f64], scores: &mut Scores) -> Option<ChangePoint> {
    let n = values.len();
    if n < MIN_RUNS {
        return None;
    }
    let RankScores { scores, max_ties } = scores.rank(values);
    let squares: f64 = scores.iter().map(|score| score * score).sum();
    if squares <= f64::EPSILON * n as f64 {
        return None;
    }
    let (first, z) = largest(&scores, squares);
    Some(ChangePoint { first, p: max_split_p_value(split_p_value(z, first, n, max_ties), n) })
}

/// The split whose left side has the mean that is furthest from 0, in standard deviations over all arrangements of the scores.
fn largest(scores: &[f64], squares: f64) -> (usize, f64) {
    let n = scores.len();
    let mut sum = 0.0;
    let mut best = (MIN_SIDE, 0.0);
    for (index, score) in scores[..n - MIN_SIDE].iter().enumerate() {
        sum += score;
        let at = index + 1;
        let arrangements = (at * (n - at)) as f64 / (n * (n - 1)) as f64;
        let z = sum.abs() / (arrangements * squares).sqrt();
        if at >= MIN_SIDE && z > best.1 {
            best = (at, z);
        }
    }
    best
}

/// Probability of one split at least so far from 0, both directions.
///
/// Each set of runs is as probable as any other to come first, so 2 / C(n, k) is the least probability there is. Runs with equal
/// values can change places: no more than those that are not among the most that are equal count.
fn split_p_value(z: f64, at: usize, n: usize, max_equal: usize) -> f64 {
    let freedom = (n - 2) as f64;
    let rest = (n - 1) as f64 - z * z;
    let side = at.min(n - at).min(n - max_equal);
    let min_p = (std::f64::consts::LN_2 - ln_binomial(n as u64, side as u64)).exp();
    if rest <= 0.0 {
        return min_p;
    }
    let t = z * (freedom / rest).sqrt();
    let student = StudentsT::new(0.0, 1.0, freedom).map_or(1.0, |student| 2.0 * student.sf(t));
    student.max(min_p).min(1.0)
}

/// Probability that the largest over all splits is so far from 0, from the probability of one.
fn max_split_p_value(p: f64, n: usize) -> f64 {
    let splits = (n - 2 * MIN_SIDE + 1) as f64;
    (splits * p).min(bridge(p, n)).min(1.0)
}

/// The tail of the supremum of |B(t)| / √(t (1 − t)) of a Brownian bridge B between the outermost splits; 1 where the expansion
/// does not hold.
fn bridge(p: f64, n: usize) -> f64 {
    let x = -Normal::standard().inverse_cdf(p / 2.0);
    if !(2.0..30.0).contains(&x) {
        return 1.0;
    }
    let outermost = MIN_SIDE as f64 / n as f64;
    let length = 2.0 * ((1.0 - outermost) / outermost).ln();
    let density = x * (-x * x / 2.0).exp() / std::f64::consts::TAU.sqrt();
    density * (length * (1.0 - 1.0 / (x * x)) + 4.0 / (x * x))
}

/// Moves each point to the best split between its neighbours: it was found beside changes that were not known yet. Bai,
/// *Econometric Theory* 13 (1997).
fn settle(values: &[f64], scores: &mut Scores, found: &mut [ChangePoint]) {
    for place in 0..found.len() {
        let from = place.checked_sub(1).map_or(0, |before| found[before].first);
        let to = found.get(place + 1).map_or(values.len(), |after| after.first);
        if let Some(split) = best_split(&values[from..to], scores) {
            found[place].first = from + split.first;
        }
    }
}

#[cfg(test)]
mod tests;
