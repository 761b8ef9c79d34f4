//! Finds the first of many revisions with a step in a figure, by noisy measurements.
//!
//! Each revision keeps a probability, and the next one to measure is near the median of what is left: Horstein's search (1963),
//! as Burnashev and Zigangirov (1974) and Waeber, Frazier and Henderson (2013) analyse it. A revision's figure is ln(figure / that of the good
//! revision), of several launches. Revisions before the step have the mean 0, those from it on the step. Another revision may bring a smaller
//! step of its own. Each build moves its mean by a little of its own, which more launches do not take away, as a drift of the machine does; how much
//! is not known. Launches scatter with heavy tails, and more in some batches than in others. What is unknown is integrated over.

use std::collections::{BTreeMap, BTreeSet};

use fathom_base::statistics::{Interval, Z_95};

/// How figures scatter, as standard deviations of ln(figure / good figure).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scatter {
    /// Of a launch, before any is seen. Those that are seen replace it.
    pub launch: f64,
    /// Of a build's own mean.
    pub build: f64,
    /// Of the step that another revision may bring.
    pub other: f64,
}

impl Scatter {
    /// Of times. Launches of equal builds of a pass of 8 ms, pinned to a core, scattered by 0.7 to 1.4 %. What a build's own placement of
    /// code moves was not measured apart; 0.3 % is assumed.
    pub const TIMES: Scatter = Scatter { launch: 0.01, build: 0.003, other: 0.03 };
    /// Of instruction counts: two runs of one build differ by up to 0.04 %, and a stage that did not change by up to 0.03 % (`docs/ci.md`).
    pub const COUNTS: Scatter = Scatter { launch: 4e-4, build: 3e-4, other: 0.01 };
    /// Of figures that are 1 where an exact figure is worse and 0 where it is not: the search is then a plain bisection.
    pub const EXACT: Scatter = Scatter { launch: 1e-3, build: 1e-3, other: 1e-3 };
}

/// So many launches the scatter that is assumed counts for.
const ASSUMED_LAUNCHES: f64 = 4.0;
/// Degrees of freedom of Student's t, by which launches scatter: one that is off by several deviations counts little.
const FREEDOM: f64 = 3.0;
/// Rounds of reweighting, after which means and scatter no longer move.
const ROUNDS: usize = 30;
/// Standard deviation of the step before anything is seen: far beyond the usual ones.
const STEP: f64 = 0.5;
/// Probability that there is such a step.
const OTHER: f64 = 0.5;
/// Multiples of the assumed scatter of builds, with their probabilities.
const BUILDS: [(f64, f64); 3] = [(1.0, 0.5), (2.0, 0.3), (4.0, 0.2)];
/// The search ends with an answer of this probability.
pub const MIN_CERTAINTY: f64 = 0.95;
/// The search ends where one more measurement is expected to settle less than this share of the open probability.
const MIN_PROMISE: f64 = 1e-3;

/// A search among revisions 1 … n, of which the last is known to have the step. Revision 0 is the good one.
#[derive(Clone, Debug, PartialEq)]
pub struct Search {
    revisions: usize,
    scatter: Scatter,
    /// By batch.
    figures: BTreeMap<usize, Vec<Vec<f64>>>,
    /// They cannot be built or measured.
    skipped: BTreeSet<usize>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct StepEstimate {
    /// The most probable first revision with the step.
    pub first: usize,
    pub probability: f64,
    /// The fewest revisions that hold the first one with the probability [`MIN_CERTAINTY`], with their own, in order.
    pub candidates: Vec<(usize, f64)>,
    /// ln of the step, with its 95 % interval, if `first` is right.
    pub step: f64,
    pub interval: Interval,
}

impl Search {
    pub fn new(revisions: usize, scatter: Scatter) -> Self {
        Self { revisions, scatter, figures: BTreeMap::new(), skipped: BTreeSet::new() }
    }

    /// Figures of a revision's launches, measured one after the other: ln(figure / that of the good revision).
    pub fn add(&mut self, revision: usize, launches: &[f64]) {
        if !launches.is_empty() {
            self.figures.entry(revision).or_default().push(launches.to_vec());
        }
    }

    pub fn skip(&mut self, revision: usize) {
        self.skipped.insert(revision);
    }

    /// Squared scale of a launch, and the mean of each revision with one over its variance, builds left out. Launches are by Student's t:
    /// expectation and maximization in turn (Lange, Little and Taylor, *J. Am. Stat. Assoc.* 84, 1989). A batch that scatters more than
    /// all do counts by its own scale: the machine was busier then.
    fn launches_by_t(&self) -> (f64, BTreeMap<usize, RevisionMean>) {
        let batches = self.figures.values().flatten();
        let middle = |launches: &Vec<f64>| fathom_base::statistics::median(launches);
        let mut fits: Vec<(f64, f64)> = batches.clone().map(|own| (middle(own), 0.0)).collect();
        let assumed = self.scatter.launch.powi(2);
        let mut variance = assumed;
        for _ in 0..ROUNDS {
            let (mut squares, mut free) = (ASSUMED_LAUNCHES * assumed, ASSUMED_LAUNCHES);
            for (launches, fit) in batches.clone().zip(&mut fits) {
                *fit = robust_mean(launches, fit.0, variance);
                squares += fit.1;
                free += (launches.len() - 1) as f64;
            }
            variance = squares / free;
        }
        let mut fits = fits.into_iter();
        let mut known = |batches: &Vec<Vec<f64>>| {
            let mut known = RevisionMean::default();
            for (launches, (mean, _)) in batches.iter().zip(&mut fits) {
                let squares: f64 = launches.iter().map(|launch| (launch - mean).powi(2)).sum();
                let own = (variance + squares) / launches.len() as f64;
                let weight = precision(launches.len(), own.max(variance));
                known.mean += weight * mean;
                known.weight += weight;
            }
            RevisionMean { mean: known.mean / known.weight, ..known }
        };
        let known = self.figures.iter().map(|(revision, batches)| (*revision, known(batches)));
        let known = known.collect();
        (variance, known)
    }

    /// What the launches say, with this scatter of builds.
    fn likelihood(&self, build: f64, known: &BTreeMap<usize, RevisionMean>) -> Likelihoods {
        let mut seen = Likelihoods::new(self.revisions, self.scatter.other);
        for (revision, known) in known {
            let (weight, mean) = (with_build(build, known.weight), known.mean);
            seen.evidence += 0.5 * (weight.ln() - weight * mean * mean);
            seen.own[*revision] = (weight, weight * mean);
        }
        for first in (0..=self.revisions).rev() {
            let ((weight, sum), (later, sums)) = (seen.own[first], seen.beyond[first + 1]);
            seen.beyond[first] = (later + weight, sums + sum);
        }
        seen
    }

    /// For revisions 1 … n: the probability that it is the first with the step, and the step if it is.
    fn steps(&self) -> Vec<StepMass> {
        let (_, known) = self.launches_by_t();
        let mut steps = StepMasses::new(self.revisions);
        let no_other = if self.revisions > 1 { 1.0 - OTHER } else { 1.0 };
        for (multiple, share) in BUILDS {
            let seen = self.likelihood(multiple * self.scatter.build, &known);
            let with_other = share * OTHER / (self.revisions - 1).max(1) as f64;
            for first in 1..=self.revisions {
                let (log, step, variance) = seen.one(first);
                steps.add(first, log + (share * no_other).ln(), step, variance);
                for other in (1..=self.revisions).filter(|other| *other != first) {
                    let (log, step, variance, of_other) = seen.two(first, other);
                    // The larger of two steps is the one that is searched for.
                    if step.abs() >= of_other.abs() {
                        steps.add(first, log + with_other.ln(), step, variance);
                    }
                }
            }
        }
        steps.shared()
    }

    /// The revision to measure next, by so many launches; none where the answer is there, or nothing more can be told.
    pub fn next(&self, launches: usize) -> Option<usize> {
        let steps = self.steps();
        let found = most_probable(&steps);
        let (variance, known) = self.launches_by_t();
        if found.probability >= MIN_CERTAINTY {
            return None;
        }
        let mut before = 0.0;
        let mut best = (MIN_PROMISE, None);
        for revision in 1..self.revisions {
            before += steps[revision - 1].mass;
            let known = known.get(&revision).map_or(0.0, |known| known.weight);
            // How much farther apart, in squared deviations, the two means will be held; Bhattacharyya's bound of a wrong choice.
            let weight = |launches| with_build(self.scatter.build, launches);
            let gain = weight(known + precision(launches, variance)) - weight(known);
            let told = 1.0 - (-gain * found.step.powi(2) / 8.0).exp();
            let promise = before * (1.0 - before) * told;
            if !self.skipped.contains(&revision) && promise > best.0 {
                best = (promise, Some(revision));
            }
        }
        best.1
    }

    pub fn estimate(&self) -> StepEstimate {
        most_probable(&self.steps())
    }

    /// Launches that were measured.
    pub fn launches(&self) -> usize {
        self.figures.values().flatten().map(Vec::len).sum()
    }
}

fn most_probable(steps: &[StepMass]) -> StepEstimate {
    let mut sorted: Vec<(usize, f64)> =
        (1..).zip(steps).map(|(first, step)| (first, step.mass)).collect();
    sorted.sort_by(|a, b| b.1.total_cmp(&a.1));
    let (first, probability) = sorted.first().copied().unwrap_or((steps.len(), 0.0));
    let mut held = 0.0;
    let enough = sorted.iter().take_while(|(_, share)| {
        let open = held < MIN_CERTAINTY;
        held += share;
        open
    });
    let mut candidates: Vec<(usize, f64)> = enough.copied().collect();
    candidates.sort_by_key(|(revision, _)| *revision);
    let StepMass { mean: step, variance, .. } = steps[first - 1];
    let half = Z_95 * variance.sqrt();
    let interval = Interval { low: step - half, high: step + half };
    StepEstimate { first, probability, candidates, step, interval }
}

/// What a revision's launches say of its mean.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct RevisionMean {
    mean: f64,
    /// One over the mean's variance.
    weight: f64,
}

/// A better mean of launches by Student's t, and the sum of their squared deviations from the one before, both weighted.
fn robust_mean(launches: &[f64], mean: f64, variance: f64) -> (f64, f64) {
    let (mut shares, mut sum, mut squares) = (0.0, 0.0, 0.0);
    for launch in launches {
        let square = (launch - mean).powi(2);
        let share = (FREEDOM + 1.0) / (FREEDOM + square / variance);
        shares += share;
        sum += share * launch;
        squares += share * square;
    }
    (sum / shares, if launches.len() > 1 { squares } else { 0.0 })
}

/// One over the variance of a mean of so many launches by Student's t: that of a normal one is by a factor smaller.
fn precision(launches: usize, variance: f64) -> f64 {
    launches as f64 * (FREEDOM + 1.0) / (variance * (FREEDOM + 3.0))
}

/// The same of a revision's mean, which its build moves.
fn with_build(build: f64, weight: f64) -> f64 {
    if weight > 0.0 { 1.0 / (build * build + 1.0 / weight) } else { 0.0 }
}

/// A step of one revision, over all that is unknown.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct StepMass {
    mass: f64,
    /// While masses are added: sums of means and of squares, by their masses.
    mean: f64,
    variance: f64,
}

struct StepMasses {
    steps: Vec<StepMass>,
    /// ln of the mass that counts as 1: the largest so far.
    log_scale: f64,
}

impl StepMasses {
    fn new(revisions: usize) -> Self {
        Self { steps: vec![StepMass::default(); revisions], log_scale: f64::NEG_INFINITY }
    }

    fn add(&mut self, first: usize, log: f64, mean: f64, variance: f64) {
        if log > self.log_scale {
            let by = (self.log_scale - log).exp();
            self.steps.iter_mut().for_each(|step| {
                (step.mass, step.mean) = (step.mass * by, step.mean * by);
                step.variance *= by;
            });
            self.log_scale = log;
        }
        let (mass, step) = ((log - self.log_scale).exp(), &mut self.steps[first - 1]);
        step.mass += mass;
        step.mean += mass * mean;
        step.variance += mass * (variance + mean * mean);
    }

    /// The masses sum to 1, and means and variances are those of each step.
    fn shared(self) -> Vec<StepMass> {
        let sum: f64 = self.steps.iter().map(|step| step.mass).sum();
        let shared = |step: StepMass| {
            let mass = step.mass.max(f64::MIN_POSITIVE);
            let mean = step.mean / mass;
            let variance = (step.variance / mass - mean * mean).max(0.0);
            StepMass { mass: step.mass / sum, mean, variance }
        };
        self.steps.into_iter().map(shared).collect()
    }
}

/// Weights of revisions, and weights times means; and what they say of steps.
struct Likelihoods {
    /// ln of the likelihood without any step.
    evidence: f64,
    own: Vec<(f64, f64)>,
    /// Sums of those from a revision on.
    beyond: Vec<(f64, f64)>,
    /// Precisions of the step and of another one before anything is seen.
    precision: f64,
    of_other: f64,
}

impl Likelihoods {
    fn new(revisions: usize, other: f64) -> Self {
        // The good revision is number 0, and nothing is beyond the last.
        let none = vec![(0.0, 0.0); revisions + 2];
        let [precision, of_other] = [STEP, other].map(|deviation| deviation.powi(-2));
        Self { evidence: 0.0, own: none.clone(), beyond: none, precision, of_other }
    }

    /// Of one step: ln of the marginal likelihood, the step and its variance.
    fn one(&self, first: usize) -> (f64, f64, f64) {
        let (weights, sum) = self.beyond[first];
        let spread = weights + self.precision;
        let log = 0.5 * (sum * sum / spread - (spread / self.precision).ln());
        (self.evidence + log, sum / spread, 1.0 / spread)
    }

    /// Of two steps: the same, and the other step.
    fn two(&self, first: usize, other: usize) -> (f64, f64, f64, f64) {
        let ((weights, sum), (others, sum_of_other)) = (self.beyond[first], self.beyond[other]);
        let (both, _) = self.beyond[first.max(other)];
        let (a, d) = (weights + self.precision, others + self.of_other);
        let determinant = a * d - both * both;
        let step = (d * sum - both * sum_of_other) / determinant;
        let of_other = (a * sum_of_other - both * sum) / determinant;
        let squares = step * sum + of_other * sum_of_other;
        let log = 0.5 * (squares - (determinant / (self.precision * self.of_other)).ln());
        (self.evidence + log, step, d / determinant, of_other)
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    use super::*;
    use crate::rank::normal;

    /// Launches of the ends, and of a revision each time it is chosen.
    const ENDS: usize = 20;
    const BATCH: usize = 4;
    const REVISIONS: usize = 24;
    /// A bisection with a whole comparison at each step: 2⁵ ≥ 24, and the ends.
    const PLAIN: usize = 5 * ENDS + ENDS;

    struct StepHistory {
        first: usize,
        step: f64,
        /// Of each build.
        own: Vec<f64>,
        launch: f64,
        /// What one launch in twenty is off by, to either side.
        off: f64,
        /// Every sixth batch scatters so many times as much.
        storm: f64,
        batches: usize,
        /// The machine's drift over the search: its extent, and where in it the search begins.
        drift: (f64, f64),
        launched: usize,
        random: Pcg64,
    }

    impl StepHistory {
        fn new(seed: u64, step: f64, scatter: Scatter) -> Self {
            let mut random = Pcg64::seed_from_u64(seed);
            let first = random.random_range(1..=REVISIONS);
            let own = (0..=REVISIONS).map(|_| scatter.build * normal(&mut random)).collect();
            let drift = (0.0, random.random());
            let (launch, batches) = (scatter.launch, random.random_range(0..6));
            let (off, storm, launched) = (0.0, 1.0, 0);
            Self { first, step, own, launch, off, storm, batches, drift, launched, random }
        }

        /// Another revision brings this step.
        fn with_other(mut self, step: f64) -> Self {
            let other = (self.first + self.random.random_range(1..REVISIONS)) % REVISIONS;
            let other = if other == 0 { REVISIONS } else { other };
            self.own[other..].iter_mut().for_each(|own| *own += step);
            self
        }

        fn launches(&mut self, revision: usize, count: usize) -> Vec<f64> {
            let step = if revision >= self.first { self.step } else { 0.0 };
            let middle = step + self.own[revision];
            self.batches += 1;
            let stormy = if self.batches.is_multiple_of(6) { self.storm } else { 1.0 };
            let launch = |_| {
                let cycles = self.launched as f64 / PLAIN as f64 + self.drift.1;
                let drift = self.drift.0 * (std::f64::consts::TAU * cycles).sin();
                self.launched += 1;
                // One launch in twenty is disturbed.
                let disturbed = self.random.random_bool(0.05);
                let heavy = if disturbed { 3.0 } else { 1.0 };
                let side = if self.random.random() { 1.0 } else { -1.0 };
                let off = if disturbed { side * self.off } else { 0.0 };
                middle + drift + off + stormy * heavy * self.launch * normal(&mut self.random)
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
                // As the command's default.
                if search.launches() >= ENDS + 120 {
                    break;
                }
            }
            search
        }
    }

    /// How searches of many histories ended: shares of all, and means.
    #[derive(Debug, Default)]
    struct SearchStats {
        found: f64,
        /// Stated with 0.9 or more.
        sure: f64,
        /// Of the sure ones.
        right: f64,
        /// The step is among the candidates.
        held: f64,
        launches: f64,
    }

    /// Of 50, a share of 90 % gives fewer than 37 once in 1,000 times, one of 95 % fewer than 42, and one of 50 % fewer than 14.
    const RIGHT: f64 = 0.74;
    const HELD: f64 = 0.84;

    fn ended(name: &str, history: impl Fn(u64) -> StepHistory) -> SearchStats {
        const HISTORIES: u64 = 50;
        let mut ended = SearchStats::default();
        for seed in 0..HISTORIES {
            let mut history = history(seed);
            let search = history.search(&[]);
            let answer = search.estimate();
            let hit = f64::from(answer.first == history.first);
            ended.found += hit / HISTORIES as f64;
            if answer.probability >= 0.9 {
                ended.sure += 1.0 / HISTORIES as f64;
                ended.right += hit / HISTORIES as f64;
            }
            let held = answer.candidates.iter().any(|c| c.0 == history.first);
            ended.held += f64::from(held) / HISTORIES as f64;
            ended.launches += search.launches() as f64 / HISTORIES as f64;
        }
        ended.right /= ended.sure;
        println!("{name}: {ended:.2?}");
        ended
    }

    const LAUNCHES: Scatter = Scatter { launch: 0.014, build: 0.003, other: 0.0 };

    #[test]
    fn the_revision_is_found_in_fewer_launches_and_with_the_probability_that_is_told() {
        for (step, min_found) in [(0.05, 0.84), (0.02, 0.28)] {
            let ended =
                ended(&format!("step {step}"), |seed| StepHistory::new(seed, step, LAUNCHES));
            assert!(ended.found >= min_found && ended.right >= RIGHT, "{ended:?}");
            assert!(ended.held >= HELD, "{ended:?}");
            assert!(step < 0.05 || ended.launches <= 0.6 * PLAIN as f64, "{ended:?}");
        }
    }

    #[test]
    fn what_is_told_as_probable_is_right_beside_another_step_tails_and_drift() {
        let usual = |seed, step| StepHistory::new(seed, step, LAUNCHES);
        for (step, other) in [(0.05, 0.02), (0.05, -0.02), (0.03, 0.02), (0.03, -0.02)] {
            let name = format!("{step}, another {other}");
            check_coverage(step, ended(&name, |seed| usual(seed, step).with_other(other)));
        }
        for step in [0.05, 0.02] {
            let of = |seed, off, drift| {
                let usual = usual(seed, step);
                StepHistory { off, drift: (drift, usual.drift.1), ..usual }
            };
            let storm = |seed| StepHistory { storm: 6.0, ..usual(seed, step) };
            check_coverage(step, ended(&format!("{step}, stormy batches"), storm));
            check_coverage(step, ended(&format!("{step}, tails of 10 %"), |s| of(s, 0.1, 0.0)));
            check_coverage(step, ended(&format!("{step}, drift of 1 %"), |s| of(s, 0.0, 0.01)));
        }
    }

    fn check_coverage(step: f64, ended: SearchStats) {
        assert!(ended.right >= RIGHT, "{ended:?}");
        assert!(step < 0.05 || ended.sure >= 0.5, "{ended:?}");
    }

    #[test]
    fn figures_without_noise_are_searched_by_a_plain_bisection() {
        for first in 1..=REVISIONS {
            let mut search = Search::new(REVISIONS, Scatter::EXACT);
            search.add(REVISIONS, &[1.0]);
            while let Some(revision) = search.next(1) {
                search.add(revision, &[f64::from(revision >= first)]);
            }
            let found = search.estimate();
            assert!(found.first == first && found.probability > 0.999, "{first}: {found:?}");
            assert!(search.launches() <= 6, "{first}: {}", search.launches());
        }
    }

    #[test]
    fn revisions_that_do_not_build_stay_together() {
        let mut history =
            StepHistory::new(3, 0.1, Scatter { launch: 0.005, build: 0.001, other: 0.0 });
        history.first = 10;
        let search = history.search(&[9, 10, 11]);
        let StepEstimate { candidates, step, interval, .. } = search.estimate();
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
        assert_eq!((search.estimate().first, search.estimate().probability), (1, 1.0));
    }
}
