//! Normal scores: ranks as quantiles of the standard normal distribution.

use std::collections::HashMap;

use statrs::distribution::{ContinuousCDF, Normal};

/// Quantiles for each length that was asked for. Series of a history share few lengths.
#[derive(Default)]
pub struct Scores {
    by_length: HashMap<usize, Vec<f64>>,
}

/// Scores of values, in the order of these.
pub struct RankScores {
    pub scores: Vec<f64>,
    /// Largest number of equal values.
    pub max_ties: usize,
}

impl Scores {
    /// Each value's score Φ⁻¹(rank / (n + 1)); they add up to 0. Equal values share the mean of their scores.
    /// Van der Waerden, *Proc. K. Ned. Akad. Wet. A* 55 (1952).
    pub fn rank(&mut self, values: &[f64]) -> RankScores {
        let quantiles = self.quantiles(values.len());
        let mut order: Vec<usize> = (0..values.len()).collect();
        order.sort_unstable_by(|a, b| values[*a].total_cmp(&values[*b]));
        let mut scores = vec![0.0; values.len()];
        let (mut rank, mut max_ties) = (0, 0);
        for equal in order.chunk_by(|a, b| values[*a] == values[*b]) {
            let shared = &quantiles[rank..rank + equal.len()];
            let mean = shared.iter().sum::<f64>() / equal.len() as f64;
            equal.iter().for_each(|place| scores[*place] = mean);
            rank += equal.len();
            max_ties = max_ties.max(equal.len());
        }
        RankScores { scores, max_ties }
    }

    fn quantiles(&mut self, n: usize) -> &[f64] {
        self.by_length.entry(n).or_insert_with(|| {
            let normal = Normal::standard();
            (1..=n).map(|rank| normal.inverse_cdf(rank as f64 / (n + 1) as f64)).collect()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scores_are_symmetric_and_keep_the_order() {
        let scores = Scores::default().rank(&[3.0, 1.0, 2.0]).scores;
        assert!(scores[0] > scores[2] && scores[2] > scores[1]);
        assert!((scores[0] - 0.674_489_75).abs() < 1e-6, "{scores:?}");
        assert!(scores.iter().sum::<f64>().abs() < 1e-12);
    }

    #[test]
    fn equal_values_have_equal_scores() {
        let ranked = Scores::default().rank(&[1.0, 2.0, 2.0, 5.0]);
        assert_eq!((ranked.scores[1], ranked.max_ties), (ranked.scores[2], 2));
        assert!(Scores::default().rank(&[7.0; 4]).scores.iter().all(|score| score.abs() < 1e-12));
    }
}
