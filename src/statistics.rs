//! Robust statistics of timing samples: medians with bootstrap intervals, outlier reports, slopes.
//!
//! Everything is f64, deterministic, and in the unit of the samples it is given. No function drops a
//! sample: outliers are reported, and the median does not mind them.

use itertools::Itertools;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

/// A median with its bootstrap 95 % interval. The unit is that of the samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    pub median: f64,
    pub low: f64,
    pub high: f64,
    pub n: usize,
}

impl Estimate {
    /// The same in another unit.
    pub fn scaled(&self, by: f64) -> Estimate {
        Estimate { median: self.median * by, low: self.low * by, high: self.high * by, n: self.n }
    }
}

/// Resamples of a bootstrap. Efron & Tibshirani, *An Introduction to the Bootstrap* (1993), section 13.3:
/// about 1,000 for a percentile interval.
pub const RESAMPLES: usize = 1_000;
/// Samples beyond which the median's interval comes from ranks: resampling takes a thousand times their number.
const MOST_RESAMPLED: usize = 20_000;

/// Modified z-score beyond which a sample is reported. Iglewicz & Hoaglin, *How to Detect and Handle
/// Outliers* (1993): 3.5.
pub const OUTLIER_Z: f64 = 3.5;

/// The interval's two tails, 2.5 % each.
const TAILS: (f64, f64) = (0.025, 0.975);

/// Seed of every bootstrap, so that the figures of a record can be recomputed from its samples.
const SEED: u64 = 0x00fa_7403;

/// Scales a median absolute deviation to the standard deviation of a normal distribution, `1 / Φ⁻¹(3/4)`.
pub const MAD_TO_SIGMA: f64 = 1.482_602_218_505_602;

/// NaN for no values.
pub fn mean(values: impl IntoIterator<Item = f64>) -> f64 {
    let (sum, count) = values.into_iter().fold((0.0, 0.0), |(sum, n), v| (sum + v, n + 1.0));
    sum / count
}

/// The value below which a share of the samples lies, between neighbours if need be. NaN for no samples.
pub fn quantile(samples: &[f64], share: f64) -> f64 {
    quantile_of_sorted(&sorted(samples), share)
}

/// The middle value, or the mean of the two middle ones. NaN for no samples.
pub fn median(samples: &[f64]) -> f64 {
    median_of_sorted(&sorted(samples))
}

/// The median with its percentile-bootstrap 95 % interval; of more than 20,000 samples with the interval of
/// order statistics, which is then the same for all that can be seen. All NaN-free for finite samples; `n = 0` and zeros for none.
pub fn estimate(samples: &[f64]) -> Estimate {
    if samples.is_empty() {
        return Estimate::default();
    }
    let sorted = sorted(samples);
    let (low, high) = if sorted.len() > MOST_RESAMPLED {
        let (low, high) = ranks(sorted.len());
        (sorted[low - 1], sorted[high - 1])
    } else {
        let mut bootstrap = MedianBootstrap::new();
        let medians = (0..RESAMPLES).map(|_| bootstrap.draw(&sorted));
        let medians = medians.sorted_by(f64::total_cmp).collect_vec();
        (quantile_of_sorted(&medians, TAILS.0), quantile_of_sorted(&medians, TAILS.1))
    };
    Estimate { median: median_of_sorted(&sorted), low, high, n: samples.len() }
}

/// The median ratio of paired samples, `a / b`, with its interval.
pub fn ratio_estimate(pairs: &[(f64, f64)]) -> Estimate {
    estimate(&pairs.iter().map(|(a, b)| a / b).collect_vec())
}

/// Half the width of the median's 95 % interval over the median, from order statistics: cheap enough to
/// ask after every sample. Infinite below six samples, where no such interval reaches 95 %.
pub fn relative_half_width(samples: &[f64]) -> f64 {
    if samples.len() < 6 {
        return f64::INFINITY;
    }
    let sorted = sorted(samples);
    let (low, high) = ranks(sorted.len());
    (sorted[high - 1] - sorted[low - 1]) / 2.0 / median_of_sorted(&sorted).abs()
}

/// Ranks, from 1, of the samples that bound the median's 95 % interval: `(n − 1.96 √n) / 2` and `1 + (n + 1.96 √n) / 2`
/// (Conover, *Practical Nonparametric Statistics* (1999), section 3.2).
fn ranks(n: usize) -> (usize, usize) {
    let n = n as f64;
    let reach = 1.96 * n.sqrt();
    let low = ((n - reach) / 2.0).floor().max(1.0) as usize;
    let high = (1.0 + (n + reach) / 2.0).ceil().min(n) as usize;
    (low, high)
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
    let mut found = Outliers { n: samples.len(), sigma, ..Outliers::default() };
    if sigma > 0.0 {
        found.slow = samples.iter().filter(|x| (**x - middle) / sigma > OUTLIER_Z).count();
        found.fast = samples.iter().filter(|x| (**x - middle) / sigma < -OUTLIER_Z).count();
    }
    found
}

/// A fitted exponent `b` of `y = a · x^b` with its 95 % interval.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slope {
    pub slope: f64,
    pub low: f64,
    pub high: f64,
    /// `ln a`.
    pub intercept: f64,
    /// Points fitted.
    pub n: usize,
}

/// The log-log slope of medians over `x` by Theil–Sen, with a bootstrap interval: each point's samples are
/// resampled and the slope fitted anew, so the interval holds the noise of the measurement.
///
/// A point counts when `x` and the median of its samples are positive and finite. `None` unless two
/// distinct `x` are left.
pub fn log_log_slope(points: &[(f64, &[f64])]) -> Option<Slope> {
    let usable = |y: f64| y.is_finite() && y > 0.0;
    let points: Vec<(f64, Vec<f64>)> = points
        .iter()
        .filter(|(x, samples)| usable(*x) && usable(median(samples)))
        .map(|(x, samples)| (x.ln(), sorted(samples)))
        .collect();
    let medians: Vec<(f64, f64)> =
        points.iter().map(|(x, y)| (*x, median_of_sorted(y).ln())).collect();
    let slope = theil_sen(&medians)?;

    // A resample of a single sample is that sample.
    let noiseless = points.iter().all(|(_, samples)| samples.len() == 1);
    let resamples = if noiseless { 1 } else { RESAMPLES };
    let mut bootstrap = MedianBootstrap::new();
    let slopes = (0..resamples).filter_map(|_| {
        let draws = points.iter().map(|(x, samples)| (*x, bootstrap.draw(samples).ln()));
        theil_sen(&draws.filter(|(_, y)| y.is_finite()).collect_vec())
    });
    let slopes = slopes.sorted_by(f64::total_cmp).collect_vec();
    let intercepts: Vec<f64> = medians.iter().map(|(x, y)| y - slope * x).collect();
    Some(Slope {
        slope,
        low: quantile_of_sorted(&slopes, TAILS.0),
        high: quantile_of_sorted(&slopes, TAILS.1),
        intercept: median(&intercepts),
        n: medians.len(),
    })
}

/// The median slope over all pairs of points with distinct `x`. Sen, *J. Am. Stat. Assoc.* 63 (1968).
fn theil_sen(points: &[(f64, f64)]) -> Option<f64> {
    let slopes = points.iter().array_combinations().map(|[a, b]| (b.1 - a.1) / (b.0 - a.0));
    let mut slopes = slopes.filter(|slope| slope.is_finite()).collect_vec();
    (!slopes.is_empty()).then(|| median_in_place(&mut slopes))
}

/// The same value as [`median`] in linear time.
fn median_in_place(samples: &mut [f64]) -> f64 {
    let n = samples.len();
    let (below, upper, _) = samples.select_nth_unstable_by(n / 2, f64::total_cmp);
    let lower = below.iter().copied().max_by(f64::total_cmp);
    match lower {
        Some(lower) if n.is_multiple_of(2) => (lower + *upper) / 2.0,
        _ => *upper,
    }
}

/// Draws medians of resamples with replacement. As the samples are sorted, a resample's median follows
/// from how often each rank was drawn, without sorting.
struct MedianBootstrap {
    random: Pcg64,
    counts: Vec<u32>,
}

impl MedianBootstrap {
    fn new() -> Self {
        Self { random: Pcg64::seed_from_u64(SEED), counts: Vec::new() }
    }

    fn draw(&mut self, sorted: &[f64]) -> f64 {
        let n = sorted.len();
        self.counts.clear();
        self.counts.resize(n, 0);
        for _ in 0..n {
            self.counts[self.random.random_range(0..n)] += 1;
        }
        let (lower, upper) = ((n - 1) / 2, n / 2);
        (self.rank(sorted, lower) + self.rank(sorted, upper)) / 2.0
    }

    /// The drawn value of a zero-based rank.
    fn rank(&self, sorted: &[f64], rank: usize) -> f64 {
        let mut below = 0;
        for (count, value) in self.counts.iter().zip(sorted) {
            below += *count as usize;
            if below > rank {
                return *value;
            }
        }
        sorted[sorted.len() - 1]
    }
}

fn sorted(samples: &[f64]) -> Vec<f64> {
    samples.iter().copied().sorted_by(f64::total_cmp).collect()
}

fn median_of_sorted(sorted: &[f64]) -> f64 {
    match sorted.len() {
        0 => f64::NAN,
        n => (sorted[(n - 1) / 2] + sorted[n / 2]) / 2.0,
    }
}

/// Linear interpolation between order statistics (type 7 of Hyndman & Fan 1996).
fn quantile_of_sorted(sorted: &[f64], share: f64) -> f64 {
    let Some(last) = sorted.len().checked_sub(1) else {
        return f64::NAN;
    };
    let position = share * last as f64;
    let below = position.floor() as usize;
    let above = (below + 1).min(last);
    sorted[below] + (position - below as f64) * (sorted[above] - sorted[below])
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn intervals_of_many_samples_are_those_of_the_bootstrap() {
        let mut random = Pcg64::seed_from_u64(3);
        let samples = heavy_tailed(&mut random, MOST_RESAMPLED + 1);
        let [by_ranks, resampled] = [&samples[..], &samples[1..]].map(estimate);
        assert_eq!([by_ranks.n, resampled.n], [MOST_RESAMPLED + 1, MOST_RESAMPLED]);
        let width = |estimate: &Estimate| estimate.high - estimate.low;
        let off = |a: f64, b: f64| (a - b).abs() / width(&resampled);
        assert!(off(by_ranks.low, resampled.low) < 0.15, "{by_ranks:?} {resampled:?}");
        assert!(off(by_ranks.high, resampled.high) < 0.15, "{by_ranks:?} {resampled:?}");
        assert!(by_ranks.low < by_ranks.median && by_ranks.median < by_ranks.high);
    }

    #[test]
    fn medians_in_place_are_medians() {
        let mut random = Pcg64::seed_from_u64(4);
        for n in 1..40 {
            let mut samples = heavy_tailed(&mut random, n);
            let expected = median(&samples);
            assert_eq!(median_in_place(&mut samples), expected);
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
        let holds = |e: Estimate| e.low <= value && value <= e.high;
        (0..trials).filter(|_| holds(estimate(&heavy_tailed(random, n)))).count()
    }

    #[test]
    fn bootstrap_interval_covers_the_true_median_of_heavy_tails() {
        let mut random = Pcg64::seed_from_u64(1);
        let truth = median(&heavy_tailed(&mut random, 400_001));
        for n in [20, 50] {
            let coverage = covered(&mut random, 400, n, truth) as f64 / 400.0;
            // Binomial deviation at 95 % over 400 trials is 1.1 %; the percentile bootstrap falls short a little.
            assert!((0.91..=0.99).contains(&coverage), "n = {n}: coverage {coverage}");
        }
    }

    #[test]
    fn coverage_fails_for_a_perturbed_truth() {
        let mut random = Pcg64::seed_from_u64(2);
        let wrong = 1.2 * median(&heavy_tailed(&mut random, 100_001));
        let covered = covered(&mut random, 200, 50, wrong);
        assert!(covered < 60, "a median 20 % off was covered {covered} times in 200");
    }

    #[test]
    fn interval_narrows_with_the_root_of_n() {
        let mut random = Pcg64::seed_from_u64(3);
        let mut width = |n| {
            let estimates = (0..40).map(|_| estimate(&heavy_tailed(&mut random, n)));
            median(&estimates.map(|e| e.high - e.low).collect_vec())
        };
        let ratio = width(25) / width(400);
        assert!((3.0..=5.5).contains(&ratio), "expected about 4, got {ratio}");
    }

    #[test]
    fn half_width_agrees_with_the_bootstrap() {
        let mut random = Pcg64::seed_from_u64(4);
        let ratios: Vec<f64> = (0..60)
            .map(|_| {
                let samples = heavy_tailed(&mut random, 60);
                let e = estimate(&samples);
                relative_half_width(&samples) / ((e.high - e.low) / 2.0 / e.median)
            })
            .collect();
        let typical = median(&ratios);
        assert!((0.9..=1.4).contains(&typical), "{typical}");
        assert_eq!(relative_half_width(&[1.0; 5]), f64::INFINITY);
        assert_eq!(relative_half_width(&[1.0; 6]), 0.0);
    }

    #[test]
    fn ratios_of_pairs_cancel_common_drift() {
        let mut random = Pcg64::seed_from_u64(5);
        let pairs: Vec<(f64, f64)> = (0..80)
            .map(|i| {
                let drift = 1.0 + 0.3 * (i as f64 / 10.0).sin();
                let mut noise = || 1.0 + 0.02 * (random.random::<f64>() - 0.5);
                (1.01 * drift * noise(), drift * noise())
            })
            .collect();
        let ratio = ratio_estimate(&pairs);
        assert!((ratio.median - 1.01).abs() < 0.004, "{ratio:?}");
        assert!(ratio.high - ratio.low < 0.01, "{ratio:?}");
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

    fn power_law(exponent: f64, random: &mut Pcg64) -> Vec<(f64, Vec<f64>)> {
        let point = |x: f64| {
            let scale = 3.0 * x.powf(exponent);
            (x, heavy_tailed(random, 30).iter().map(|t| t / 20.0 * scale).collect())
        };
        [1e4, 4e4, 1.6e5, 6.4e5, 1e6].map(point).into()
    }

    fn fit(points: &[(f64, Vec<f64>)]) -> Slope {
        let points = points.iter().map(|(x, samples)| (*x, samples.as_slice())).collect_vec();
        log_log_slope(&points).expect("points enough")
    }

    #[test]
    fn slope_of_a_power_law_is_its_exponent() {
        let mut random = Pcg64::seed_from_u64(7);
        for exponent in [0.0, 0.5, 1.0, 2.0] {
            let fit = fit(&power_law(exponent, &mut random));
            assert!((fit.slope - exponent).abs() < 0.06, "{exponent}: {fit:?}");
            assert!(fit.low <= fit.slope && fit.slope <= fit.high, "{exponent}: {fit:?}");
            assert_eq!(fit.n, 5);
        }
    }

    #[test]
    fn slope_interval_covers_the_exponent() {
        let mut random = Pcg64::seed_from_u64(8);
        let trials = 100;
        let holds = |fit: Slope| fit.low <= 1.0 && 1.0 <= fit.high;
        let covered = (0..trials).filter(|_| holds(fit(&power_law(1.0, &mut random)))).count();
        assert!(covered >= 90, "covered {covered} times in {trials}");
    }

    #[test]
    fn one_wild_point_does_not_turn_the_slope() {
        let points: Vec<(f64, Vec<f64>)> = (1..=9)
            .map(|i| (f64::from(i), vec![f64::from(i) * if i == 8 { 20.0 } else { 1.0 }]))
            .collect();
        let fit = fit(&points);
        assert!((fit.slope - 1.0).abs() < 1e-9, "{fit:?}");
        assert!(fit.intercept.abs() < 1e-9);
    }

    #[test]
    fn no_slope_without_two_distinct_positive_points() {
        assert!(log_log_slope(&[]).is_none());
        assert!(log_log_slope(&[(1.0, &[1.0])]).is_none());
        assert!(log_log_slope(&[(2.0, &[1.0]), (2.0, &[3.0])]).is_none());
        assert!(log_log_slope(&[(0.0, &[1.0]), (2.0, &[3.0])]).is_none());
        assert!(log_log_slope(&[(1.0, &[0.0]), (2.0, &[3.0])]).is_none());
    }

    proptest! {
        #[test]
        fn estimate_follows_scale_and_order(
            samples in prop::collection::vec(0.1f64..1e6, 1..60),
            scale in 0.01f64..100.0,
        ) {
            let plain = estimate(&samples);
            let scaled: Vec<f64> = samples.iter().rev().map(|x| x * scale).collect();
            let scaled = estimate(&scaled);
            let close = |a: f64, b: f64| (a - b * scale).abs() <= 1e-9 * a.abs();
            prop_assert!(close(scaled.median, plain.median));
            prop_assert!(close(scaled.low, plain.low));
            prop_assert!(close(scaled.high, plain.high));
        }

        #[test]
        fn interval_holds_the_median_and_stays_within_the_samples(
            samples in prop::collection::vec(-1e6f64..1e6, 1..60),
        ) {
            let e = estimate(&samples);
            let (min, max) = samples.iter().fold((f64::INFINITY, f64::NEG_INFINITY),
                |(low, high), x| (low.min(*x), high.max(*x)));
            prop_assert!(min <= e.low && e.low <= e.median && e.median <= e.high && e.high <= max);
            prop_assert_eq!(e, estimate(&samples));
        }
    }
}
