//! The order of frames within a round.
//!
//! Noise of a machine lasts: what disturbs a frame disturbs the next as well. So cells whose times a claim compares are visited
//! together, and their frames alternate. Samples of one visit have one number, and ratios are taken within it. Each order of a
//! visit's cells is followed by its reverse, so a drift within visits favours no cell. Measured orders, and others that were
//! tried, are in `docs/claims.md`.

use rand::seq::SliceRandom;
use rand::{Rng, RngExt};

/// Cells whose frames take no longer than this together are visited in random order. Noise of a shared machine correlates
/// within about that time. Longer chains keep their order, so that the neighbours in a fit are neighbours in time.
pub const MAX_VISIT_S: f64 = 0.3;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct VisitFrame {
    pub cell: usize,
    /// With per-stage timing.
    pub timed: bool,
}

/// Which cells are visited together, and in which order they were visited last.
pub struct Visits(Vec<Chain>);

struct Chain {
    /// In the order in which the claims compare them.
    cells: Vec<usize>,
    /// That of the next visit, where it is the reverse of the last.
    reverse: Option<Vec<usize>>,
}

impl Visits {
    /// Every cell belongs to one chain; see `Experiment::chains`.
    pub fn new(chains: impl IntoIterator<Item = Vec<usize>>) -> Self {
        Self(chains.into_iter().map(|cells| Chain { cells, reverse: None }).collect())
    }

    /// The frames of each visit of a round to these cells, in an order drawn anew: of each cell a timed and an untimed one.
    /// `pair_s` tells how long those of a cell take.
    pub fn round(
        &mut self,
        wanting: &[usize],
        pair_s: impl Fn(usize) -> f64,
        random: &mut impl Rng,
    ) -> Vec<Vec<VisitFrame>> {
        let visits = self.0.iter_mut().map(|chain| {
            let present = chain.cells.iter().filter(|cell| wanting.contains(cell));
            let is_short = present.map(|cell| pair_s(*cell)).sum::<f64>() <= MAX_VISIT_S;
            let order = chain.next(is_short, random).into_iter().filter(|c| wanting.contains(c));
            frames(&order.collect::<Vec<_>>(), is_short, random.random_bool(0.5))
        });
        let mut visits: Vec<_> = visits.filter(|frames| !frames.is_empty()).collect();
        visits.shuffle(random);
        visits
    }
}

impl Chain {
    /// The order of the next visit.
    fn next(&mut self, is_short: bool, random: &mut impl Rng) -> Vec<usize> {
        if let Some(order) = self.reverse.take() {
            return order;
        }
        let mut order = self.cells.clone();
        if is_short {
            order.shuffle(random);
        } else if random.random_bool(0.5) {
            order.reverse();
        }
        self.reverse = Some(order.iter().rev().copied().collect());
        order
    }
}

/// In a short visit all frames of one kind and then all of the other: a frame that follows one of its own cell finds its caches
/// warm, and is up to 3 % faster. In a long one the two frames of a cell follow each other, so that they are comparable too.
fn frames(order: &[usize], is_short: bool, timed_first: bool) -> Vec<VisitFrame> {
    let kinds = [timed_first, !timed_first];
    let frame = |cell: &usize, timed| VisitFrame { cell: *cell, timed };
    if is_short {
        kinds.iter().flat_map(|timed| order.iter().map(|cell| frame(cell, *timed))).collect()
    } else {
        order.iter().flat_map(|cell| kinds.map(|timed| frame(cell, timed))).collect()
    }
}

#[cfg(test)]
mod tests {
    use itertools::Itertools;
    use rand::SeedableRng;
    use rand_pcg::Pcg64;

    use super::*;
    use fathom_base::statistics::{estimate, median};

    fn cells(visit: &[VisitFrame]) -> Vec<usize> {
        visit.iter().map(|frame| frame.cell).collect()
    }

    #[test]
    fn each_order_is_followed_by_its_reverse_and_every_cell_has_both_frames() {
        let mut random = Pcg64::seed_from_u64(1);
        for (pair_s, orders) in [(0.01, 24), (0.2, 2)] {
            let mut visits = Visits::new([vec![3, 5, 1, 2], vec![0], vec![4]]);
            let mut seen = Vec::new();
            for _ in 0..300 {
                let mut round = || visits.round(&[1, 2, 3, 4, 5], |_| pair_s, &mut random);
                let [there, back] = [round(), round()].map(|round| {
                    assert_eq!(round.iter().map(Vec::len).sorted().collect_vec(), [2, 8]);
                    assert!(round.iter().flatten().all_unique());
                    let visit = round.into_iter().find(|visit| visit.len() == 8).unwrap();
                    cells(&visit).into_iter().unique().collect_vec()
                });
                assert_eq!(back, there.iter().rev().copied().collect_vec());
                seen.push(there);
            }
            seen.sort();
            seen.dedup();
            assert_eq!(seen.len(), orders, "{pair_s} s: {seen:?}");
        }
    }

    #[test]
    fn no_frame_of_a_short_visit_follows_one_of_its_own_cell() {
        let mut random = Pcg64::seed_from_u64(2);
        let mut visits = Visits::new([vec![0, 1]]);
        for _ in 0..20 {
            let round = visits.round(&[0, 1], |_| 0.1, &mut random);
            assert!(cells(&round[0]).into_iter().tuple_windows().all(|(a, b)| a != b));
            assert_eq!(round[0][0].timed, round[0][1].timed);
        }
    }

    /// Multiplicative noise on a modelled clock. Of its variance 0.6 decays with a time constant of 0.45 s and the rest is each
    /// frame's own: log times correlate as measured on a shared machine (0.56 within 0.1 s, 0.25 after 0.5 s, none after 2 s).
    struct MachineNoise {
        level: f64,
        random: Pcg64,
    }

    impl MachineNoise {
        const SIGMA: f64 = 0.12;
        const SHARED: f64 = 0.6;
        const LASTS_S: f64 = 0.45;

        fn normal(&mut self) -> f64 {
            (0..12).map(|_| self.random.random_range(0.0..1.0)).sum::<f64>() - 6.0
        }

        /// The time of a frame that takes so long without noise.
        fn frame(&mut self, s: f64) -> f64 {
            let kept = (-s / Self::LASTS_S).exp();
            self.level = kept * self.level + (1.0 - kept * kept).sqrt() * self.normal();
            let own = (1.0 - Self::SHARED).sqrt() * self.normal();
            s * (Self::SIGMA * (Self::SHARED.sqrt() * self.level + own)).exp()
        }
    }

    /// Half widths of the ratios of twins, `2n` and `2n + 1`, after so many rounds, and the share of the intervals that hold 1.
    fn ratios(chains: impl IntoIterator<Item = Vec<usize>>, rounds: usize) -> (f64, f64) {
        const TWINS: usize = 400;
        let mut noise = MachineNoise { level: 0.0, random: Pcg64::seed_from_u64(3) };
        let mut random = Pcg64::seed_from_u64(4);
        let mut visits = Visits::new(chains);
        let wanting = (0..2 * TWINS).collect_vec();
        let mut taken = vec![Vec::new(); 2 * TWINS];
        let length_s = |cell: usize| 0.01 * (1 + cell / 2 % 5) as f64;
        for _ in 0..rounds {
            let round = visits.round(&wanting, |cell| 2.0 * length_s(cell), &mut random);
            for VisitFrame { cell, timed } in round.into_iter().flatten() {
                let s = noise.frame(length_s(cell));
                if timed {
                    taken[cell].push(s);
                }
            }
        }
        let estimates = (0..TWINS).map(|twin| {
            let [a, b] = [&taken[2 * twin], &taken[2 * twin + 1]];
            estimate(&a.iter().zip(b).map(|(a, b)| a / b).collect_vec())
        });
        let estimates = estimates.collect_vec();
        let widths = estimates.iter().map(|e| e.relative_half_width()).collect_vec();
        let holds = estimates.iter().filter(|e| e.ends()[0] <= 1.0 && e.ends()[1] >= 1.0).count();
        (median(&widths), holds as f64 / TWINS as f64)
    }

    #[test]
    fn ratios_within_a_visit_are_narrower_and_hold_the_truth_as_often() {
        let rounds = 17;
        let (apart, held_apart) = ratios((0..800).map(|cell| vec![cell]), rounds);
        let (together, held) = ratios((0..400).map(|twin| vec![2 * twin, 2 * twin + 1]), rounds);
        // The shared part of the noise divides out but for what changes within a frame or two.
        assert!(together < 0.75 * apart, "{together} against {apart}");
        // An interval of 17 samples has a level of 95.1 %; 400 of them scatter by 1.1 %.
        assert!(
            [held_apart, held].iter().all(|held| (0.92..=0.98).contains(held)),
            "{held_apart} {held}"
        );
    }
}
