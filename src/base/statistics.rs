//! Robust statistics of timing samples: medians with intervals by order statistics, outlier reports, slopes.
//!
//! Everything is f64, deterministic, and in the unit of the samples it is given. No function drops a
//! sample: outliers are reported, and the median does not mind them.
//!
//! An interval exists only where there are enough samples for its level. No distribution is assumed: an interval of the median
//! is bounded by two of the samples, and its coverage follows from the binomial distribution alone.

use itertools::Itertools;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The bounds of an interval, in the unit of the figure.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Interval {
    /// Lower bound.
    pub low: f64,
    /// Upper bound.
    pub high: f64,
}

impl Interval {
    pub fn half_width(&self) -> f64 {
        (self.high - self.low) / 2.0
    }
}

/// A middle value with its 95 % interval. The unit is that of the samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Estimate {
    /// The exponential of the mean over visits of the logarithm, in the samples' unit; where visits are not told the median.
    pub median: f64,
    /// None below four visits, or six samples where visits are not told.
    #[serde(flatten)]
    pub interval: Option<Interval>,
    /// Number of visits; of samples where visits are not told.
    pub n: usize,
}

impl Estimate {
    /// The same in another unit. The factor is positive.
    pub fn scaled(&self, by: f64) -> Estimate {
        self.map(|value| value * by)
    }

    /// The same seen through a function that rises everywhere.
    pub fn map(&self, f: impl Fn(f64) -> f64) -> Estimate {
        let interval =
            self.interval.map(|Interval { low, high }| Interval { low: f(low), high: f(high) });
        Estimate { median: f(self.median), interval, n: self.n }
    }

    /// The ends of the interval; the median twice where there is none.
    pub fn ends(&self) -> [f64; 2] {
        self.interval.map_or([self.median; 2], |Interval { low, high }| [low, high])
    }

    /// Half the width of the interval over the median; infinite where there is no interval.
    pub fn relative_half_width(&self) -> f64 {
        let relative = |interval: Interval| interval.half_width() / self.median.abs();
        self.interval.map_or(f64::INFINITY, relative)
    }
}

/// Chance that an interval of 95 % does not hold the true median.
pub const ALPHA: f64 = 0.05;

/// Modified z-score beyond which a sample is reported. Iglewicz & Hoaglin, *How to Detect and Handle
/// Outliers* (1993): 3.5.
pub const OUTLIER_Z: f64 = 3.5;

/// Scales a median absolute deviation to the standard deviation of a normal distribution, `1 / Φ⁻¹(3/4)`.
pub const MAD_TO_SIGMA: f64 = 1.482_602_218_505_602;

/// Standard deviation of what the samples are drawn from.
pub fn deviation(samples: &[f64]) -> f64 {
    let mean = mean(samples.iter().copied());
    let squares: f64 = samples.iter().map(|x| (x - mean).powi(2)).sum();
    (squares / (samples.len() as f64 - 1.0).max(1.0)).sqrt()
}

/// NaN for no values.
pub fn mean(values: impl IntoIterator<Item = f64>) -> f64 {
    let (sum, count) = values.into_iter().fold((0.0, 0.0), |(sum, n), v| (sum + v, n + 1.0));
    sum / count
}

/// The value below which a share of the samples lies, between neighbours if need be. NaN for no samples.
pub fn quantile(samples: &[f64], share: f64) -> f64 {
    let sorted = sorted(samples);
    let Some(last) = sorted.len().checked_sub(1) else { return f64::NAN };
    // Linear interpolation between order statistics (type 7 of Hyndman & Fan 1996).
    let position = share * last as f64;
    let below = position.floor() as usize;
    let above = (below + 1).min(last);
    sorted[below] + (position - below as f64) * (sorted[above] - sorted[below])
}

/// The middle value, or the mean of the two middle ones. NaN for no samples.
pub fn median(samples: &[f64]) -> f64 {
    median_of_sorted(&sorted(samples))
}

/// The median with its 95 % interval. A median of 0 and no interval for no samples.
pub fn estimate(samples: &[f64]) -> Estimate {
    if samples.is_empty() {
        return Estimate::default();
    }
    let sorted = sorted(samples);
    Estimate {
        median: median_of_sorted(&sorted),
        interval: interval_of_sorted(&sorted, ALPHA),
        n: samples.len(),
    }
}

/// The interval that misses the samples' true median with a chance of at most `alpha`; none where so few samples have none.
pub fn median_interval(samples: &[f64], alpha: f64) -> Option<Interval> {
    interval_of_sorted(&sorted(samples), alpha)
}

fn interval_of_sorted(sorted: &[f64], alpha: f64) -> Option<Interval> {
    let rank = lower_rank(sorted.len(), alpha)?;
    Some(Interval { low: sorted[rank - 1], high: sorted[sorted.len() - rank] })
}

/// The largest rank, from 1, such that the samples of this rank from below and from above hold the median between them but for
/// a chance of `alpha`. The number of samples below the median is binomial with odds of one half (Conover, *Practical
/// Nonparametric Statistics* (1999), section 3.2).
fn lower_rank(n: usize, alpha: f64) -> Option<usize> {
    let count = n as f64;
    let mut log_probability = -count * std::f64::consts::LN_2;
    let mut below = log_probability.exp();
    let mut rank = 0;
    while below <= alpha / 2.0 && rank < n {
        rank += 1;
        let drawn = rank as f64;
        log_probability += ((count - drawn + 1.0) / drawn).ln();
        below += log_probability.exp();
    }
    (rank > 0).then_some(rank)
}

/// How many samples lie far from the median, by the modified z-score of their distance.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Outliers {
    /// Samples beyond [`OUTLIER_Z`] above the median.
    pub slow: usize,
    /// Samples beyond [`OUTLIER_Z`] below the median.
    pub fast: usize,
    pub n: usize,
    /// Standard deviation as estimated by the median absolute deviation, in the samples' unit.
    pub sigma: f64,
}

impl Outliers {
    /// Share of all samples, 0 … 1.
    pub fn share(&self) -> f64 {
        (self.slow + self.fast) as f64 / self.n.max(1) as f64
    }
}

/// Counts outliers; none where more than half of the samples are equal, as no spread can be told then.
pub fn outliers(samples: &[f64]) -> Outliers {
    let middle = median(samples);
    let distances: Vec<f64> = samples.iter().map(|x| (x - middle).abs()).collect();
    let sigma = MAD_TO_SIGMA * median(&distances);
    let mut outliers = Outliers { n: samples.len(), sigma, ..Outliers::default() };
    if sigma > 0.0 {
        outliers.slow = samples.iter().filter(|x| (**x - middle) / sigma > OUTLIER_Z).count();
        outliers.fast = samples.iter().filter(|x| (**x - middle) / sigma < -OUTLIER_Z).count();
    }
    outliers
}

/// A fitted exponent `b` of `y = a · x^b`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slope {
    pub slope: f64,
    /// `ln a`.
    pub intercept: f64,
    /// Points fitted.
    pub n: usize,
}

/// The log-log slope of y over x by Theil–Sen. A point counts when both are positive and finite. `None` unless two distinct
/// `x` are left.
pub fn log_log_slope(points: &[(f64, f64)]) -> Option<Slope> {
    let usable = |v: f64| v.is_finite() && v > 0.0;
    let points = points.iter().filter(|(x, y)| usable(*x) && usable(*y));
    let points = points.map(|(x, y)| (x.ln(), y.ln())).collect_vec();
    // Theil–Sen: Sen, *J. Am. Stat. Assoc.* 63 (1968).
    let slopes = slopes(&points);
    let slope = (!slopes.is_empty()).then(|| median_of_sorted(&slopes))?;
    let intercepts = points.iter().map(|(x, y)| y - slope * x).collect_vec();
    Some(Slope { slope, intercept: median(&intercepts), n: points.len() })
}

/// The slopes over all pairs of points with distinct `x`, sorted.
fn slopes(points: &[(f64, f64)]) -> Vec<f64> {
    let slopes = points
        .iter()
        .array_combinations()
        .map(|[a, b]| (b.1 - a.1) / (b.0 - a.0))
        .filter(|slope| slope.is_finite());
    slopes.sorted_unstable_by(f64::total_cmp).collect()
}

/// Quantile of the standard normal distribution for an interval of 95 %.
pub const Z_95: f64 = 1.959_964;

fn sorted(samples: &[f64]) -> Vec<f64> {
    samples.iter().copied().sorted_by(f64::total_cmp).collect()
}

fn median_of_sorted(sorted: &[f64]) -> f64 {
    match sorted.len() {
        0 => f64::NAN,
        n => (sorted[(n - 1) / 2] + sorted[n / 2]) / 2.0,
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    use super::*;

    /// The chance that two ranks of `n` samples do not hold the median between them, by adding up the binomial distribution.
    fn missed(n: usize, rank: usize) -> f64 {
        let choose = |k: usize| (0..k).fold(1.0, |all, i| all * (n - i) as f64 / (i + 1) as f64);
        2.0 * (0..rank).map(choose).sum::<f64>() / 2f64.powi(n as i32)
    }

    /// Few by adding up the binomial distribution, many near those of the normal distribution.
    #[test]
    fn ranks_are_the_innermost_that_keep_the_level() {
        let n = 1e6_f64;
        let rank = lower_rank(n as usize, 0.05).unwrap() as f64;
        assert!((rank - (n - 1.96 * n.sqrt()) / 2.0).abs() < 3.0, "{rank}");
        for alpha in [0.05, 0.01, 0.003] {
            for n in 1..200 {
                match lower_rank(n, alpha) {
                    None => assert!(missed(n, 1) > alpha, "n = {n}"),
                    Some(rank) => {
                        assert!(missed(n, rank) <= alpha + 1e-12, "n = {n}, rank {rank}");
                        let inner = rank + 1;
                        assert!(2 * inner > n || missed(n, inner) > alpha, "n = {n}");
                    }
                }
            }
        }
    }

    #[test]
    fn no_interval_of_95_percent_below_six_samples() {
        assert_eq!(estimate(&[1.0; 5]).interval, None);
        assert_eq!(estimate(&[1.0; 5]).relative_half_width(), f64::INFINITY);
        let six = estimate(&[3.0, 1.0, 2.0, 5.0, 4.0, 6.0]);
        assert_eq!(six.interval, Some(Interval { low: 1.0, high: 6.0 }));
        for (alpha, min_n) in [(0.05, 6), (0.01, 8), (0.05 / 6.0, 8)] {
            assert_eq!((lower_rank(min_n - 1, alpha), lower_rank(min_n, alpha)), (None, Some(1)));
        }
    }

    /// The sum of twelve uniform numbers, as good as normal.
    fn normal(random: &mut Pcg64) -> f64 {
        (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0
    }

    /// Log-normal body with one sample in ten up to 30 times slower: the shape of frame times on a shared machine.
    fn heavy_tailed(random: &mut Pcg64, n: usize) -> Vec<f64> {
        (0..n)
            .map(|_| {
                let body = (0.15 * normal(random)).exp();
                let stall =
                    if random.random_bool(0.1) { 1.0 + 29.0 * random.random::<f64>() } else { 1.0 };
                20.0 * body * stall
            })
            .collect()
    }

    #[test]
    fn median_of_odd_even_and_none() {
        assert_eq!(median(&[3.0, 1.0, 2.0]), 2.0);
        assert_eq!(median(&[4.0, 1.0, 3.0, 2.0]), 2.5);
        assert!(median(&[]).is_nan());
        assert_eq!(estimate(&[]), Estimate::default());
    }

    /// In how many of `trials` the interval from `n` samples holds a value.
    fn covered(random: &mut Pcg64, trials: u32, n: usize, value: f64) -> usize {
        let holds = |e: Estimate| e.interval.is_some_and(|i| i.low <= value && value <= i.high);
        (0..trials).filter(|_| holds(estimate(&heavy_tailed(random, n)))).count()
    }

    #[test]
    fn the_interval_covers_the_true_median_of_heavy_tails_and_no_other() {
        let mut random = Pcg64::seed_from_u64(1);
        let truth = median(&heavy_tailed(&mut random, 400_001));
        for n in [6, 9, 20, 50] {
            let coverage = covered(&mut random, 400, n, truth) as f64 / 400.0;
            // At least 95 %, and more where ranks are few; two standard deviations over 400 trials are 2.2 %.
            assert!((0.928..=0.995).contains(&coverage), "n = {n}: coverage {coverage}");
        }
        let covered = covered(&mut random, 200, 50, 1.2 * truth);
        assert!(covered < 60, "a median 20 % off was covered {covered} times in 200");
    }

    #[test]
    fn outliers_are_counted_on_their_side() {
        let mut samples: Vec<f64> = (0..100).map(|i| 10.0 + 0.01 * f64::from(i % 10)).collect();
        assert_eq!(outliers(&samples).share(), 0.0);
        samples[3] = 50.0;
        samples[40] = 80.0;
        samples[70] = 1.0;
        let found = outliers(&samples);
        assert_eq!((found.slow, found.fast, found.n), (2, 1, 100));
        assert_eq!(outliers(&[1.0, 1.0, 1.0, 9.0]).slow, 0, "no spread, no verdict");
    }

    #[test]
    fn mad_estimates_the_deviation_of_normal_noise() {
        let mut random = Pcg64::seed_from_u64(6);
        let samples = (0..20_000).map(|_| normal(&mut random)).collect_vec();
        assert!((outliers(&samples).sigma - 1.0).abs() < 0.03);
    }

    #[test]
    fn slope_of_a_power_law_is_its_exponent() {
        for exponent in [0.0, 0.5, 1.0, 2.0_f64] {
            let points = [1e4, 4e4, 1.6e5, 6.4e5, 1e6].map(|x: f64| (x, 3.0 * x.powf(exponent)));
            let fit = log_log_slope(&points).expect("points enough");
            assert!((fit.slope - exponent).abs() < 1e-9, "{exponent}: {fit:?}");
            assert!((fit.intercept - 3f64.ln()).abs() < 1e-9, "{exponent}: {fit:?}");
            assert_eq!(fit.n, 5);
        }
    }

    #[test]
    fn one_wild_point_does_not_turn_the_slope() {
        let points =
            (1..=9).map(|i| (f64::from(i), f64::from(i) * if i == 8 { 20.0 } else { 1.0 }));
        let fit = log_log_slope(&points.collect_vec()).expect("points enough");
        assert!((fit.slope - 1.0).abs() < 1e-9, "{fit:?}");
        assert!(fit.intercept.abs() < 1e-9);
    }

    #[test]
    fn no_slope_without_two_distinct_positive_points() {
        assert!(log_log_slope(&[]).is_none());
        for point in [(2.0, 3.0), (2.0, 1.0), (0.0, 1.0), (1.0, 0.0)] {
            assert!(log_log_slope(&[point, (2.0, 3.0)]).is_none(), "{point:?}");
        }
    }

    proptest! {
        #[test]
        fn an_estimate_lies_within_the_samples_and_follows_their_scale_and_not_their_order(
            samples in prop::collection::vec(-1e6f64..1e6, 1..60),
            scale in 0.01f64..100.0,
        ) {
            let e = estimate(&samples);
            let (min, max) = samples.iter().copied().minmax().into_option().unwrap();
            let [low, high] = e.ends();
            prop_assert!(min <= low && low <= e.median && e.median <= high && high <= max);
            prop_assert_eq!(e.interval.is_some(), samples.len() >= 6);
            let reversed = estimate(&samples.iter().rev().map(|x| x * scale).collect_vec());
            let close = |a: f64, b: f64| (a - b * scale).abs() <= 1e-9 * a.abs().max(1.0);
            prop_assert!(close(reversed.median, e.median) && reversed.n == e.n);
            prop_assert!(close(reversed.ends()[0], low) && close(reversed.ends()[1], high));
        }
    }
}
