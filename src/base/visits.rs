//! Figures over visits: what one interval of time says, and what several do.
//!
//! Noise of a machine lasts. Frames that follow each other show one state of it, however many they are, and their interval does not hold
//! what the next minute gives (`docs/measuring.md` has the figures). So the samples of a cell within [`VISIT_S`] are one visit, a visit
//! gives one number, and intervals are Student's t over the numbers of visits, of times and ratios over their logarithms, widened by
//! [`BETWEEN_RUNS`].

use itertools::Itertools;

use crate::statistics::{self, ALPHA, Estimate, Interval, deviation, mean, median};

/// Visits from which on a figure has an interval. Of three, Student's t is 4.3 standard errors wide to either side.
pub const MIN_VISITS: usize = 4;
/// Samples so long after the first one of a visit are of another, seconds. States of a machine outlast it.
pub const VISIT_S: f64 = 10.0;
/// An interval whose visits lie within less than this is one of these seconds alone, and settles nothing.
pub const MIN_SPAN_S: f64 = 60.0;

/// By how much figures of runs differ more than their visits tell: what lasts longer than a run is in none of them. Of six runs of four minutes on
/// one machine, two quiet and four noisy ones each with their like, intervals then hold the other run's figure as often as is computed.
pub const BETWEEN_RUNS: f64 = 1.3;

/// What noise does to a figure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// It multiplies times and ratios: their logarithms are averaged.
    Factors,
    /// It adds to exponents and distances.
    Sums,
}

impl Scale {
    fn forward(self, value: f64) -> f64 {
        if self == Self::Factors { value.ln() } else { value }
    }

    fn back(self, value: f64) -> f64 {
        if self == Self::Factors { value.exp() } else { value }
    }

    /// Of some values, between the ends also where a logarithm is rounded.
    fn middle(self, values: &[f64], of: impl Fn(&[f64]) -> f64) -> f64 {
        let middle = self.back(of(&values.iter().map(|value| self.forward(*value)).collect_vec()));
        let ends = values.iter().copied().minmax().into_option();
        ends.map_or(middle, |(min, max)| middle.clamp(min, max))
    }

    /// Of what is zero somewhere there are no factors.
    fn fitting(self, values: &[f64]) -> Self {
        if values.iter().all(|value| *value > 0.0) { self } else { Self::Sums }
    }
}

/// The number of each sample's visit, from the second at which it was taken.
pub fn numbers(sampled_at_s: &[f64]) -> Vec<u32> {
    let (mut number, mut first_s) = (0, sampled_at_s.first().copied().unwrap_or_default());
    let of = |at_s: &f64| {
        if at_s - first_s >= VISIT_S {
            (number, first_s) = (number + 1, *at_s);
        }
        number
    };
    sampled_at_s.iter().map(of).collect()
}

/// One number of each visit, in the order of visits: the median of its samples.
pub fn medians(visits: &[u32], samples: &[f64], scale: Scale) -> Vec<f64> {
    let scale = scale.fitting(samples);
    let pairs = visits.iter().copied().zip(samples.iter().copied());
    let visits = pairs.into_group_map().into_iter().sorted_by_key(|(visit, _)| *visit);
    visits.map(|(_, samples)| scale.middle(&samples, median)).collect()
}

/// The figure that these numbers of visits give, with an interval that misses it with a chance of `alpha`; `n` counts visits.
pub fn estimate(visits: &[f64], scale: Scale, alpha: f64) -> Estimate {
    if visits.is_empty() {
        return Estimate::default();
    }
    let (n, scale) = (visits.len(), scale.fitting(visits));
    let values = visits.iter().map(|value| scale.forward(*value)).collect_vec();
    let middle = mean(values.iter().copied());
    let interval = (n >= MIN_VISITS).then(|| {
        let error = BETWEEN_RUNS * deviation(&values) / (n as f64).sqrt();
        let reach = student_t(n - 1, alpha) * error;
        Interval { low: scale.back(middle - reach), high: scale.back(middle + reach) }
    });
    Estimate { median: scale.middle(visits, |values| mean(values.iter().copied())), interval, n }
}

/// The same of a time's samples and the numbers of their visits. Without these, as in records of before, over samples.
pub fn estimate_of_samples(samples: &[f64], visits: &[u32]) -> Estimate {
    if visits.is_empty() {
        return statistics::estimate(samples);
    }
    estimate(&medians(visits, samples, Scale::Factors), Scale::Factors, ALPHA)
}

/// Student's t beyond which, to either side, lies a chance of `alpha`. The distribution function is that of Abramowitz and Stegun,
/// *Handbook of Mathematical Functions* (1964), equations 26.7.3 and 26.7.4.
pub fn student_t(degrees: usize, alpha: f64) -> f64 {
    // By halving the angle whose tangent is t over the root of the degrees of freedom.
    let [mut low, mut high] = [0.0, std::f64::consts::FRAC_PI_2];
    for _ in 0..60 {
        let middle = (low + high) / 2.0;
        if within(degrees, middle) < 1.0 - alpha { low = middle } else { high = middle }
    }
    (degrees as f64).sqrt() * low.tan()
}

fn within(degrees: usize, angle: f64) -> f64 {
    let (sin, cos) = angle.sin_cos();
    let is_odd = degrees % 2 == 1;
    let (mut term, mut sum) = (if is_odd { cos } else { 1.0 }, 0.0);
    for k in (if is_odd { 3 } else { 2 }..=degrees).step_by(2) {
        sum += term;
        term *= cos * cos * (k - 1) as f64 / k as f64;
    }
    if is_odd { (angle + sin * sum) * std::f64::consts::FRAC_2_PI } else { sin * sum }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    use super::*;

    #[test]
    fn samples_within_ten_seconds_of_the_first_are_one_visit() {
        assert!(numbers(&[]).is_empty());
        assert_eq!(numbers(&[5.0, 9.0, 14.9, 15.0, 24.0, 40.0]), [0, 0, 0, 1, 1, 2]);
        let medians = medians(&[0, 0, 0, 1, 1], &[1.0, 4.0, 100.0, 2.0, 8.0], Scale::Factors);
        assert!(medians.iter().all(|median| (median - 4.0).abs() < 1e-12), "{medians:?}");
        assert_eq!(super::medians(&[3, 3], &[0.0, 2.0], Scale::Factors), [1.0]);
    }

    /// Abramowitz and Stegun, table 26.10.
    #[test]
    fn students_t_is_that_of_the_tables() {
        for (degrees, alpha, t) in [
            (1, 0.05, 12.706),
            (3, 0.05, 3.182),
            (3, 0.0001, 28.0),
            (4, 0.01, 4.604),
            (11, 0.05, 2.201),
            (30, 0.01, 2.750),
        ] {
            assert!((student_t(degrees, alpha) - t).abs() < 1e-3, "{degrees} {alpha}");
        }
    }

    #[test]
    fn an_estimate_follows_the_scale_of_its_visits_and_has_an_interval_from_four_on() {
        let visits = [3.0, 5.0, 4.0, 7.0];
        assert_eq!(estimate(&visits[..3], Scale::Factors, ALPHA).interval, None);
        assert_eq!(estimate(&[], Scale::Factors, ALPHA), Estimate::default());
        let factors = estimate(&visits, Scale::Factors, ALPHA);
        let thousandth = estimate(&visits.map(|v| v / 1e3), Scale::Factors, ALPHA).scaled(1e3);
        let sums = estimate(&visits, Scale::Sums, ALPHA);
        let moved = estimate(&visits.map(|v| v - 100.0), Scale::Factors, ALPHA);
        let pairs = [(factors, thousandth, 0.0), (sums, moved, 100.0)];
        for (a, b, by) in pairs {
            let [a, b] = [a, b].map(|e| [e.median, e.ends()[0], e.ends()[1]]);
            assert!(a.iter().zip(b).all(|(a, b)| (a - b - by).abs() < 1e-9), "{a:?} {b:?}");
        }
        assert!(factors.ends()[0] > 0.0 && sums.ends()[0] < factors.ends()[0]);
    }

    fn holds(interval: Option<Interval>, value: f64) -> bool {
        interval.is_some_and(|i| i.low <= value && value <= i.high)
    }

    /// Log times of a machine whose noise lasts for 0.45 s, and whose states last for 10 s on average.
    struct Machine {
        random: Pcg64,
        noise: f64,
        state: f64,
        state_ends_s: f64,
        now_s: f64,
    }

    impl Machine {
        fn new(seed: u64) -> Self {
            let random = Pcg64::seed_from_u64(seed);
            Self { random, noise: 0.0, state: 0.0, state_ends_s: 0.0, now_s: 0.0 }
        }

        fn normal(&mut self) -> f64 {
            (0..12).map(|_| self.random.random::<f64>()).sum::<f64>() - 6.0
        }

        /// The logarithm of a frame that ends so many seconds after the one before.
        fn frame(&mut self, after_s: f64) -> f64 {
            self.now_s += after_s;
            while self.state_ends_s <= self.now_s {
                self.state = 0.1 * self.normal();
                self.state_ends_s -= 10.0 * (1.0 - self.random.random::<f64>()).ln();
            }
            let kept = (-after_s / 0.45).exp();
            self.noise = kept * self.noise + (1.0 - kept * kept).sqrt() * self.normal();
            self.state + 0.05 * self.noise + 0.03 * self.normal()
        }
    }

    #[test]
    fn visits_hold_the_truth_where_as_many_samples_of_one_stretch_do_not() {
        const TRIALS: usize = 2_000;
        let mut held = [0; 2];
        for seed in 0..TRIALS as u64 {
            let mut machine = Machine::new(seed);
            let batch: Vec<f64> = (0..12).map(|_| machine.frame(0.1).exp()).collect();
            let visit = |machine: &mut Machine| [30.0, 0.1].map(|s| machine.frame(s).exp());
            let visits: Vec<f64> = (0..6).flat_map(|_| visit(&mut machine)).collect();
            let numbers = [0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 5, 5];
            let of_visits = estimate_of_samples(&visits, &numbers);
            let found = [of_visits.interval, statistics::estimate(&batch).interval];
            for (held, interval) in held.iter_mut().zip(found) {
                *held += usize::from(holds(interval, 1.0));
            }
        }
        let [visits, batch] = held.map(|held| held as f64 / TRIALS as f64);
        assert!(visits >= 0.93 && batch < 0.7, "{visits} and {batch}");
    }

    /// CPU time of frames in microseconds, four of each of 30 visits over 30 minutes: eight cells on llvmpipe and on SwiftShader, as the same
    /// objects, made again and in a new process (`docs/measuring.md`).
    fn recorded() -> Vec<Vec<Vec<f64>>> {
        let frames = |visit: &str| visit.split(' ').map(|us| us.parse().unwrap()).collect();
        let visits = |line: &str| line.split('\t').skip(3).map(frames).collect();
        include_str!("recorded_noise.tsv").lines().map(visits).collect()
    }

    /// With which the interval of so many visits holds the figure of the next ones, where noise is normal and has no memory.
    fn computed_rate(visits: usize, next: usize) -> f64 {
        let reach = student_t(visits - 1, ALPHA) / (1.0 + visits as f64 / next as f64).sqrt();
        within(visits - 1, (reach / ((visits - 1) as f64).sqrt()).atan())
    }

    /// In how many stretches the interval of the first visits holds the figure of the next, by visits and by samples, and how many there are.
    fn count_held(series: &[Vec<Vec<f64>>], visits: usize, next: usize) -> ([f64; 2], f64) {
        let (mut held, mut all) = ([0.0; 2], 0.0);
        for of_cell in series {
            for stretch in of_cell.chunks_exact(visits + next) {
                let estimates = [&stretch[..visits], &stretch[visits..]].map(|part| {
                    let numbers = (0..).zip(part).flat_map(|(n, of)| vec![n; of.len()]);
                    let (numbers, samples) = (numbers.collect_vec(), part.concat());
                    [estimate_of_samples(&samples, &numbers), statistics::estimate(&samples)]
                });
                for (by, held) in held.iter_mut().enumerate() {
                    let [before, after] = estimates.map(|both| both[by]);
                    *held += f64::from(u8::from(holds(before.interval, after.median)));
                }
                all += 1.0;
            }
        }
        (held, all)
    }

    #[test]
    fn recorded_visits_hold_the_next_as_often_as_computed_and_samples_do_not() {
        let (series, sizes) = (recorded(), [4, 6, 12]);
        assert!(series.len() == 48 && series.iter().all(|visits| visits.len() == 30));
        let (mut by, mut expected, mut variance) = ([0.0; 2], 0.0, 0.0);
        for (visits, next) in sizes.into_iter().cartesian_product(sizes) {
            let ([of_visits, of_samples], all) = count_held(&series, visits, next);
            let rate = computed_rate(visits, next);
            by = [by[0] + of_visits, by[1] + of_samples];
            (expected, variance) = (expected + all * rate, variance + all * rate * (1.0 - rate));
            // The eight cells of a visit share the state of the machine.
            let error = (rate * (1.0 - rate) * 8.0 / all).sqrt();
            let of_all = of_visits / all;
            assert!(of_all >= rate - 2.0 * error, "{visits} and {next}: {of_all} of {rate}");
        }
        let least = expected - 2.0 * variance.sqrt();
        assert!(by[0] >= least && by[1] < least, "{by:?} of {expected}");
    }
}
