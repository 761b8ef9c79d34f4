//! Wilcoxon's signed-rank test with its exact distribution, and the interval of Hodges and Lehmann that goes with it.
//!
//! Hollander, Wolfe & Chicken, *Nonparametric Statistical Methods* (2014), section 3.1 to 3.3. All that is assumed of the
//! samples is that they are independent and scatter evenly to both sides of their centre.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use fathom_base::statistics::{Estimate, Interval, median};

/// Probability of each rank sum 0 … n(n + 1)/2 of `n` samples that scatter evenly about 0. Computed once for each `n`.
pub fn rank_sums(n: usize) -> Arc<Vec<f64>> {
    static KNOWN: Mutex<BTreeMap<usize, Arc<Vec<f64>>>> = Mutex::new(BTreeMap::new());
    let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
    known.entry(n).or_insert_with(|| Arc::new(convolved(n))).clone()
}

fn convolved(n: usize) -> Vec<f64> {
    let mut probability = vec![1.0];
    for rank in 1..=n {
        // Each rank is in the sum or not, with even odds.
        let mut next = vec![0.0; probability.len() + rank];
        for (sum, p) in probability.iter().enumerate() {
            next[sum] += p / 2.0;
            next[sum + rank] += p / 2.0;
        }
        probability = next;
    }
    probability
}

/// How many of the least rank sums of `n` samples are together no more probable than `level`; as many of the largest are.
pub(crate) fn extreme_sums(n: usize, level: f64) -> usize {
    let mut below = 0.0;
    let is_extreme = |p: &&f64| {
        below += **p;
        below <= level
    };
    rank_sums(n).iter().take_while(is_extreme).count()
}

/// Walsh averages in their order: the means of all pairs of samples, each with itself too.
fn walsh(samples: &[f64]) -> Vec<f64> {
    let means = |i: usize| samples[i..].iter().map(move |b| (samples[i] + b) / 2.0);
    let mut walsh: Vec<f64> = (0..samples.len()).flat_map(means).collect();
    walsh.sort_by(f64::total_cmp);
    walsh
}

/// The samples' centre, the median of the Walsh averages (Hodges and Lehmann), with its interval of at least the coverage
/// `1 − alpha`; none where no interval of so few samples reaches it.
pub fn centre(samples: &[f64], alpha: f64) -> Estimate {
    let walsh = walsh(samples);
    let interval = match extreme_sums(samples.len(), alpha / 2.0) {
        0 => None,
        beyond => Some(Interval { low: walsh[beyond - 1], high: walsh[walsh.len() - beyond] }),
    };
    Estimate { median: median(&walsh), interval, n: samples.len() }
}

/// Probability of samples at least so high when their centre is `bound` or less.
///
/// Equal distances are ranked against the finding and a distance of 0 counts as below, so that ties only raise it.
pub fn above(samples: &[f64], bound: f64) -> f64 {
    let distribution = rank_sums(samples.len());
    let sum = rank_sum(samples, bound);
    distribution[sum..].iter().sum()
}

/// Probability of samples at least so low when their centre is `bound` or more.
pub fn below(samples: &[f64], bound: f64) -> f64 {
    let mirrored: Vec<f64> = samples.iter().map(|x| -x).collect();
    above(&mirrored, -bound)
}

/// Sum of the ranks of the samples above `bound`.
fn rank_sum(samples: &[f64], bound: f64) -> usize {
    let mut distances: Vec<f64> = samples.iter().map(|x| x - bound).collect();
    distances.sort_by(|a, b| {
        let by_size = a.abs().total_cmp(&b.abs());
        by_size.then(b.total_cmp(a))
    });
    let ranked = distances.iter().zip(1..);
    ranked.filter(|(distance, _)| **distance > 0.0).map(|(_, rank)| rank).sum()
}

/// Probabilities adjusted for their number by Holm's procedure, in the order given: what is at most `alpha` may be rejected
/// with a chance of at most `alpha` of any false rejection. Holm, *Scand. J. Statist.* 6 (1979).
pub fn holm(probabilities: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..probabilities.len()).collect();
    order.sort_by(|a, b| probabilities[*a].total_cmp(&probabilities[*b]));
    let mut adjusted = vec![1.0; probabilities.len()];
    let mut running_max = 0.0_f64;
    for (done, index) in order.iter().enumerate() {
        let left = (probabilities.len() - done) as f64;
        running_max = running_max.max((left * probabilities[*index]).min(1.0));
        adjusted[*index] = running_max;
    }
    adjusted
}

/// Probabilities adjusted for so many tests, in the order given: of what is at most `alpha`, a share of at most `alpha` is expected to
/// be false. Benjamini & Hochberg, *J. R. Statist. Soc. B* 57 (1995); it holds too where the tests go together (Benjamini &
/// Yekutieli, *Ann. Statist.* 29 (2001)).
pub fn benjamini_hochberg(probabilities: &[f64], tests: usize) -> Vec<f64> {
    let mut order: Vec<usize> = (0..probabilities.len()).collect();
    order.sort_by(|a, b| probabilities[*b].total_cmp(&probabilities[*a]));
    let mut adjusted = vec![1.0; probabilities.len()];
    let mut running_min = 1.0_f64;
    for (done, index) in order.iter().enumerate() {
        let rank = (probabilities.len() - done) as f64;
        running_min = running_min.min(probabilities[*index] * tests as f64 / rank);
        adjusted[*index] = running_min;
    }
    adjusted
}

/// Samples that stand for all in [`detectable`].
const TRIALS: usize = 2_000;
/// Seed of their noise.
const SEED: u64 = 0x00fa_7404;
/// Chance with which a detectable shift is found. Cohen, *Statistical Power Analysis* (1988), section 2.4: 0.80.
pub const POWER: f64 = 0.8;

/// The least shift, in standard deviations of normal noise, by which [`above`] of `n` samples falls to `level` with the chance
/// [`POWER`]. None where no samples reach that level.
pub fn detectable(n: usize, level: f64) -> Option<f64> {
    static KNOWN: Mutex<BTreeMap<(usize, u64), Option<f64>>> = Mutex::new(BTreeMap::new());
    let key = (n, level.to_bits());
    let known = || KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
    let found = known().get(&key).copied();
    found.unwrap_or_else(|| {
        let shift = simulated(n, level);
        known().insert(key, shift);
        shift
    })
}

/// By how much noise must be raised until its rank sum rejects: the rank sum is the number of Walsh averages above 0, so this is
/// one of them.
fn simulated(n: usize, level: f64) -> Option<f64> {
    let last = extreme_sums(n, level).checked_sub(1)?;
    let mut random = Pcg64::seed_from_u64(SEED);
    let mut noise = || -> Vec<f64> { (0..n).map(|_| normal(&mut random)).collect() };
    let mut min_shifts: Vec<f64> = (0..TRIALS).map(|_| -walsh(&noise())[last]).collect();
    min_shifts.sort_by(f64::total_cmp);
    Some(min_shifts[(POWER * TRIALS as f64) as usize])
}

/// A standard normal number. Box & Muller, *Ann. Math. Statist.* 29 (1958).
pub(crate) fn normal(random: &mut Pcg64) -> f64 {
    let radius = (-2.0 * (1.0 - random.random::<f64>()).ln()).sqrt();
    radius * (std::f64::consts::TAU * random.random::<f64>()).cos()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rank_sums_are_those_of_the_tables() {
        let lower = |n: usize, sum: usize| rank_sums(n)[..=sum].iter().sum::<f64>();
        // Hollander & Wolfe, table A.4.
        assert!((lower(12, 13) - 0.0212).abs() < 5e-5);
        assert!((lower(12, 14) - 0.0261).abs() < 5e-5);
        assert!((lower(8, 5) - 0.0391).abs() < 5e-5);
        assert_eq!(lower(12, 0), 1.0 / 4096.0);
        assert!((rank_sums(30).iter().sum::<f64>() - 1.0).abs() < 1e-12);
    }

    /// The example of Hollander & Wolfe, section 3.1: depression scores of nine patients before and after.
    #[test]
    #[expect(clippy::approx_constant, reason = "a score of 3.14")]
    fn the_textbook_example_comes_out() {
        let before = [1.83, 0.50, 1.62, 2.48, 1.68, 1.88, 1.55, 3.06, 1.30];
        let after = [0.878, 0.647, 0.598, 2.05, 1.06, 1.29, 1.06, 3.14, 1.29];
        let change: Vec<f64> = after.iter().zip(before).map(|(a, b)| a - b).collect();
        assert!((below(&change, 0.0) - 0.0195).abs() < 5e-5);
        let centre = centre(&change, 0.04);
        let Interval { low, high } = centre.interval.unwrap();
        for (found, expected) in [(centre.median, -0.46), (low, -0.786), (high, -0.010)] {
            assert!((found - expected).abs() < 1e-9, "{centre:?}");
        }
    }

    #[test]
    fn few_samples_have_no_interval_and_no_small_probability() {
        assert_eq!(centre(&[1.0, 1.1, 1.2, 1.3, 1.4], 0.05).interval, None);
        assert_eq!(above(&[1.0, 2.0], 0.0), 0.25);
        assert_eq!(above(&[], 0.0), 1.0);
        assert_eq!(detectable(5, 0.01), None);
        assert!(detectable(12, 0.001).is_some());
    }

    #[test]
    fn ties_and_zeros_only_raise_the_probability() {
        assert_eq!(above(&[0.0; 4], 0.0), 1.0);
        assert_eq!(above(&[1.0, 1.0, 1.0, -1.0], 0.0), 7.0 / 16.0);
        assert!(above(&[1.0, 1.0, 1.0, 0.9], 0.0) <= 1.0 / 16.0);
    }

    #[test]
    fn holm_is_monotone_and_its_first_step_is_bonferroni() {
        let adjusted = holm(&[0.01, 0.04, 0.001, 0.03]);
        let expected = [0.03, 0.06, 0.004, 0.06];
        assert!(adjusted.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-15));
        assert!(holm(&[]).is_empty());
        assert_eq!(holm(&[0.9, 0.8]), [1.0, 1.0]);
    }

    #[test]
    fn a_detectable_shift_is_found_with_the_power_stated() {
        let level = 0.05 / 80.0;
        let shift = detectable(12, level).unwrap();
        let mut random = Pcg64::seed_from_u64(12);
        let mut is_found = |_: &u32| {
            let samples: [f64; 12] = std::array::from_fn(|_| shift + normal(&mut random));
            above(&samples, 0.0) <= level
        };
        let found = (0..2_000).filter(&mut is_found).count() as f64 / 2_000.0;
        assert!((found - POWER).abs() < 0.04, "shift {shift}: {found}");
    }
}
