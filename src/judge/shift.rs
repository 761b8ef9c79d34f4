//! By how much two sides of a change differ.

use super::change_points::MIN_SIDE;
use fathom_base::statistics::{Estimate, Interval, Z_95, median};

/// The shift from the first side to the second with its 95 % interval: the median of all differences (Hodges and Lehmann) and the
/// interval of Mann and Whitney's test. Hollander, Wolfe & Chicken, *Nonparametric Statistical Methods* (2014), sections 4.2 and 4.3.
/// `n` is the number of differences' runs. The place of a change is chosen where the sides differ most, so the interval of a small
/// shift covers less.
pub fn shift(before: &[f64], after: &[f64]) -> Estimate {
    let mut differences: Vec<f64> =
        after.iter().flat_map(|b| before.iter().map(move |a| b - a)).collect();
    differences.sort_unstable_by(f64::total_cmp);
    let (n, all) = (before.len() + after.len(), differences.len() as f64);
    let reach = Z_95 * (all * (n + 1) as f64 / 12.0).sqrt();
    let below = (all / 2.0 - reach).floor();
    let enough = before.len().min(after.len()) >= MIN_SIDE && below >= 1.0;
    let interval = enough.then(|| Interval {
        low: differences[below as usize - 1],
        high: differences[differences.len() - below as usize],
    });
    Estimate { median: median(&differences), interval, n }
}

/// The interval excludes zero.
pub fn excludes_zero(interval: Interval) -> bool {
    interval.low > 0.0 || interval.high < 0.0
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    use super::*;

    #[test]
    fn a_shift_is_found_and_its_interval_covers_it() {
        let mut random = Pcg64::seed_from_u64(5);
        let mut side = |n: usize, at: f64| -> Vec<f64> {
            (0..n).map(|_| at + random.random::<f64>()).collect()
        };
        let mut covered = 0;
        for _ in 0..400 {
            let found = shift(&side(20, 0.0), &side(12, 0.3));
            let Interval { low, high } = found.interval.unwrap();
            covered += usize::from(low <= 0.3 && 0.3 <= high);
        }
        // 95 % of 400, and two standard deviations.
        assert!((371..=392).contains(&covered), "{covered}");
    }

    #[test]
    fn few_runs_have_no_interval_and_equal_ones_none_that_is_wide() {
        assert_eq!(shift(&[1.0; 3], &[2.0; 3]).interval, None);
        let exact = shift(&[1.0; 30], &[2.0; 30]);
        assert_eq!(exact.interval, Some(Interval { low: 1.0, high: 1.0 }));
        assert_eq!((exact.median, exact.n), (1.0, 60));
    }
}
