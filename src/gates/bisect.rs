//! Which of many revisions is the first with a step in a figure, told from noisy figures.
//!
//! Each revision keeps a probability, and the next one to measure is near the median of what is left: Horstein's search (1963),
//! as Burnashev and Zigangirov (1974) and Waeber, Frazier and Henderson (2013) analyse it. A revision's figure is ln(figure / that of the good
//! revision), of several launches. Revisions before the step have the mean 0, those from it on the step; each build moves its mean by a little of its
//! own, which more launches do not take away, and each launch scatters. The step is unknown: it is integrated over.

use std::collections::{BTreeMap, BTreeSet};

use fathom_base::statistics::{Interval, mean};

/// How figures scatter, as standard deviations of ln(figure / good figure).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scatter {
    /// Of a launch, before any is seen. Those that are seen replace it.
    pub launch: f64,
    /// Of a build's own mean.
    pub build: f64,
}

impl Scatter {
    /// Of times. Launches of equal builds of a pass of 8 ms, pinned to a core, scattered by 0.7 to 1.4 %. What a build's own placement of
    /// code moves was not measured apart; 0.3 % is assumed.
    pub const TIMES: Scatter = Scatter { launch: 0.01, build: 0.003 };
    /// Of instruction counts: two runs of one build differ by up to 0.04 %, and a stage that did not change by up to 0.03 % (`docs/ci.md`).
    pub const COUNTS: Scatter = Scatter { launch: 4e-4, build: 3e-4 };
    /// Of figures that are 1 where an exact figure is worse and 0 where it is not: the search is then a plain bisection.
    pub const EXACT: Scatter = Scatter { launch: 1e-3, build: 1e-3 };
}

/// So many launches the scatter that is assumed counts for.
const ASSUMED_LAUNCHES: f64 = 4.0;
/// Standard deviation of the step before anything is seen: far beyond the usual ones.
const STEP: f64 = 0.5;
/// The search ends with an answer of this probability.
pub const ENOUGH: f64 = 0.95;
/// What measuring one more revision must promise, of the probability that is open: below this nothing more can be told.
const LEAST_PROMISE: f64 = 1e-3;

/// A search among revisions 1 … n, of which the last is known to have the step. Revision 0 is the good one.
#[derive(Clone, Debug, PartialEq)]
pub struct Search {
    revisions: usize,
    scatter: Scatter,
    figures: BTreeMap<usize, Vec<f64>>,
    /// They cannot be built or measured.
    skipped: BTreeSet<usize>,
}

/// What a search has found.
#[derive(Clone, Debug, PartialEq)]
pub struct Found {
    /// The most probable first revision with the step.
    pub first: usize,
    pub probability: f64,
    /// The fewest revisions that hold the first one with the probability [`ENOUGH`], with their own, in order.
    pub candidates: Vec<(usize, f64)>,
    /// ln of the step, with its 95 % interval, if `first` is right.
    pub step: f64,
    pub interval: Interval,
}

impl Search {
    pub fn new(revisions: usize, scatter: Scatter) -> Self {
        Self { revisions, scatter, figures: BTreeMap::new(), skipped: BTreeSet::new() }
    }

    /// Figures of a revision's launches: ln(figure / that of the good revision).
    pub fn add(&mut self, revision: usize, launches: &[f64]) {
        self.figures.entry(revision).or_default().extend(launches);
    }

    pub fn skip(&mut self, revision: usize) {
        self.skipped.insert(revision);
    }

    /// Variance of a launch: that which is assumed, and those of each revision's launches about their mean.
    fn launch_variance(&self) -> f64 {
        let (mut squares, mut free) =
            (ASSUMED_LAUNCHES * self.scatter.launch.powi(2), ASSUMED_LAUNCHES);
        for launches in self.figures.values().filter(|launches| launches.len() > 1) {
            let middle = mean(launches.iter().copied());
            squares += launches.iter().map(|y| (y - middle).powi(2)).sum::<f64>();
            free += (launches.len() - 1) as f64;
        }
        squares / free
    }

    /// How much is known of a revision's mean after so many launches: one over its variance.
    fn weight(&self, launches: usize) -> f64 {
        match launches {
            0 => 0.0,
            n => 1.0 / (self.scatter.build.powi(2) + self.launch_variance() / n as f64),
        }
    }

    /// Of the revisions from one on: the sum of weights, and of weights times means.
    fn beyond(&self, first: usize) -> (f64, f64) {
        let from = self.figures.range(first..).filter(|(_, launches)| !launches.is_empty());
        from.fold((0.0, 0.0), |(weights, sums), (_, launches)| {
            let weight = self.weight(launches.len());
            (weights + weight, sums + weight * mean(launches.iter().copied()))
        })
    }

    /// That revisions 1 … n are the first with the step.
    pub fn probabilities(&self) -> Vec<f64> {
        let logs = (1..=self.revisions).map(|first| {
            // The marginal likelihood over that of no step at all.
            let (weights, sum) = self.beyond(first);
            let spread = weights + STEP.powi(-2);
            0.5 * sum * sum / spread - 0.5 * (spread * STEP * STEP).ln()
        });
        let logs: Vec<f64> = logs.collect();
        let most = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let shares: Vec<f64> = logs.iter().map(|log| (log - most).exp()).collect();
        let sum: f64 = shares.iter().sum();
        shares.iter().map(|share| share / sum).collect()
    }

    /// The revision to measure next, by so many launches; none where the answer is there, or nothing more can be told.
    pub fn next(&self, launches: usize) -> Option<usize> {
        let probabilities = self.probabilities();
        let found = self.found();
        if found.probability >= ENOUGH {
            return None;
        }
        let mut before = 0.0;
        let mut best = (LEAST_PROMISE, None);
        for revision in 1..self.revisions {
            before += probabilities[revision - 1];
            let known = self.figures.get(&revision).map_or(0, Vec::len);
            // How much farther apart, in squared deviations, the two means will be held; Bhattacharyya's bound of a wrong choice.
            let gain = self.weight(known + launches) - self.weight(known);
            let told = 1.0 - (-gain * found.step.powi(2) / 8.0).exp();
            let promise = before * (1.0 - before) * told;
            if !self.skipped.contains(&revision) && promise > best.0 {
                best = (promise, Some(revision));
            }
        }
        best.1
    }

    pub fn found(&self) -> Found {
        let probabilities = self.probabilities();
        let numbered = || (1..).zip(probabilities.iter().copied());
        let mut sorted: Vec<(usize, f64)> = numbered().collect();
        sorted.sort_by(|a, b| b.1.total_cmp(&a.1));
        let (first, probability) = sorted.first().copied().unwrap_or((self.revisions, 0.0));
        let mut held = 0.0;
        let enough = sorted.iter().take_while(|(_, share)| {
            let open = held < ENOUGH;
            held += share;
            open
        });
        let mut candidates: Vec<(usize, f64)> = enough.copied().collect();
        candidates.sort_by_key(|(revision, _)| *revision);
        let (weights, sum) = self.beyond(first);
        let (step, half) = (sum / weights, 1.96 / weights.sqrt());
        let interval = Interval { low: step - half, high: step + half };
        Found { first, probability, candidates, step, interval }
    }

    /// Launches that were measured.
    pub fn launches(&self) -> usize {
        self.figures.values().map(Vec::len).sum()
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    use super::*;

    /// Launches of the ends, and of a revision each time it is chosen.
    const ENDS: usize = 20;
    const BATCH: usize = 4;
    const REVISIONS: usize = 24;
    /// A bisection with a whole comparison at each step: 2⁵ ≥ 24, and the ends.
    const PLAIN: usize = 5 * ENDS + ENDS;

    /// A history in which one revision brings a step.
    struct History {
        first: usize,
        step: f64,
        /// Of each build.
        own: Vec<f64>,
        launch: f64,
        random: Pcg64,
    }

    impl History {
        fn new(seed: u64, step: f64, scatter: Scatter) -> Self {
            let mut random = Pcg64::seed_from_u64(seed);
            let first = random.random_range(1..=REVISIONS);
            let own = (0..=REVISIONS).map(|_| scatter.build * normal(&mut random)).collect();
            Self { first, step, own, launch: scatter.launch, random }
        }

        fn launches(&mut self, revision: usize, count: usize) -> Vec<f64> {
            let step = if revision >= self.first { self.step } else { 0.0 };
            let middle = step + self.own[revision];
            // One launch in twenty is disturbed.
            let launch = |_| {
                let heavy = if self.random.random_bool(0.05) { 3.0 } else { 1.0 };
                middle + heavy * self.launch * normal(&mut self.random)
            };
            (0..count).map(launch).collect()
        }

        fn search(&mut self, broken: &[usize]) -> Search {
            let mut search = Search::new(REVISIONS, Scatter::TIMES);
            search.add(REVISIONS, &self.launches(REVISIONS, ENDS));
            while let Some(revision) = search.next(BATCH) {
                if broken.contains(&revision) {
                    search.skip(revision);
                } else {
                    search.add(revision, &self.launches(revision, BATCH));
                }
                assert!(search.launches() < 20 * PLAIN);
            }
            search
        }
    }

    /// Box and Muller.
    fn normal(random: &mut Pcg64) -> f64 {
        let (u, v): (f64, f64) = (1.0 - random.random::<f64>(), random.random());
        (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
    }

    #[test]
    fn the_revision_is_found_in_fewer_launches_and_with_the_probability_that_is_told() {
        const HISTORIES: u64 = 400;
        let scatter = Scatter { launch: 0.014, build: 0.003 };
        for (step, least_found) in [(0.05, 0.95), (0.02, 0.5)] {
            let (mut found, mut sure, mut right, mut launches, mut held) = (0, 0, 0, 0, 0);
            for seed in 0..HISTORIES {
                let mut history = History::new(seed, step, scatter);
                let search = history.search(&[]);
                let answer = search.found();
                let hit = answer.first == history.first;
                found += usize::from(hit);
                if answer.probability >= 0.9 {
                    (sure, right) = (sure + 1, right + usize::from(hit));
                }
                held += usize::from(answer.candidates.iter().any(|c| c.0 == history.first));
                launches += search.launches();
            }
            let share = |count: usize| count as f64 / HISTORIES as f64;
            let mean_launches = launches as f64 / HISTORIES as f64;
            println!(
                "step {step}: found {}, sure {} of which right {}, held {}, launches {mean_launches}",
                share(found),
                share(sure),
                right as f64 / sure as f64,
                share(held)
            );
            assert!(share(found) >= least_found, "{found}");
            assert!(right as f64 >= 0.85 * sure as f64, "{right} of {sure}");
            assert!(share(held) >= 0.9, "{held}");
            assert!(step < 0.05 || mean_launches <= 0.6 * PLAIN as f64, "{mean_launches}");
        }
    }

    #[test]
    fn revisions_that_do_not_build_stay_together() {
        let mut history = History::new(3, 0.1, Scatter { launch: 0.005, build: 0.001 });
        history.first = 10;
        let search = history.search(&[9, 10, 11]);
        let Found { candidates, step, interval, .. } = search.found();
        let named: Vec<usize> = candidates.iter().map(|(revision, _)| *revision).collect();
        assert_eq!(named, [9, 10, 11, 12]);
        assert!(candidates.iter().all(|(_, share)| (0.2..0.3).contains(share)), "{candidates:?}");
        assert!(interval.low < 0.1 && 0.1 < interval.high && (step - 0.1).abs() < 0.01);
    }

    #[test]
    fn a_single_revision_needs_no_search() {
        let mut search = Search::new(1, Scatter::COUNTS);
        search.add(1, &[0.01]);
        assert_eq!(search.next(BATCH), None);
        assert_eq!((search.found().first, search.found().probability), (1, 1.0));
    }
}
