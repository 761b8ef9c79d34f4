//! Where along a sweep of sizes a stage becomes costly, and where its growth changes. Both are drawn from intervals, widened for the
//! number of comparisons (Bonferroni), and never from medians alone.

use itertools::Itertools;

use fathom_base::statistics::{ALPHA, Interval};
use fathom_base::visits::{MIN_VISITS, Scale};
use fathom_experiments::{Quantity, thin_out};

/// A change of an exponent that counts. Chosen: those of two runs agree within 0.1.
pub const MIN_CHANGE: f64 = 0.25;

/// Sizes among which a change is looked for; of more, as many are taken. Every pair of their steps is compared.
const MAX_SIZES: usize = 32;

/// Where along the sizes something changes.
#[derive(Clone, Debug, PartialEq)]
pub enum Knee {
    Seen(KneeBracket),
    /// Every size was settled, and nothing changes between them.
    NotSeen,
    /// Intervals are too wide or samples too few, for this reason.
    NotSettled(String),
}

/// A change that lies between two sizes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KneeBracket {
    /// The best guess of where.
    pub at: f64,
    pub between: Interval,
    /// The figure's median on either side.
    pub before: f64,
    pub after: f64,
}

/// A stage's share of the frame at one size.
pub struct ShareAt {
    pub size: f64,
    /// Frame by frame, at least and at most: the time of a stage below the clock's resolution may be anything below that.
    pub min: Quantity,
    pub max: Quantity,
}

/// Where a share of the frame crosses `bound`: every size from there on lies on the other side, by its interval.
pub fn crossing(points: &[ShareAt], bound: f64) -> Knee {
    let alpha = ALPHA / points.len().max(1) as f64;
    let is_above = |point: &ShareAt| {
        let interval = |of: &Quantity| of.estimate(Scale::Factors, alpha).interval;
        let is_below = interval(&point.max)?.high < bound;
        let is_above = interval(&point.min)?.low > bound;
        (is_below || is_above).then_some(is_above)
    };
    let sides = points.iter().map(is_above).collect_vec();
    if !sides.is_empty() && sides.iter().all(|side| side.is_some() && *side == sides[0]) {
        return Knee::NotSeen;
    }
    let changed = sides.last().copied().flatten().and_then(|after| {
        let last_before = sides.iter().rposition(|side| *side == Some(!after))?;
        let is_clean = !sides[..last_before].contains(&Some(after));
        let first_after =
            last_before + 1 + sides[last_before + 1..].iter().position(Option::is_some)?;
        let stays = sides[first_after..].iter().all(|side| *side == Some(after));
        (is_clean && stays).then(|| [&points[last_before], &points[first_after]])
    });
    let Some([before, after]) = changed else {
        let few = points.iter().filter_map(|point| point.min.n()).min().unwrap_or(0);
        return Knee::NotSettled(
            too_few(few)
                .unwrap_or_else(|| format!("the interval of some size holds {} %", 100.0 * bound)),
        );
    };
    let shares = [before, after].map(|point| point.min.median());
    let along = (bound - shares[0]) / (shares[1] - shares[0]);
    let at = (before.size.ln() * (1.0 - along) + after.size.ln() * along).exp();
    let between = Interval { low: before.size, high: after.size };
    Knee::Seen(KneeBracket { at, between, before: shares[0], after: shares[1] })
}

/// Where the exponent of `y ∝ x^b` changes: between neighbouring sizes it is `ln(y₂/y₁) / ln(x₂/x₁)`, round by round, and two of these
/// differ where the interval of their difference lies beyond [`MIN_CHANGE`]. Of all such pairs the nearest counts.
pub fn change_of_exponent(points: Vec<(f64, Quantity)>) -> Knee {
    let points = thin_out(points, MAX_SIZES);
    if points.len() < 3 {
        let sizes = points.len();
        return Knee::NotSettled(format!("too few sizes with a time: {sizes} of 3"));
    }
    let steps = points.iter().tuple_windows().map(|((x, y), (next_x, next_y))| {
        let span = (next_x / x).ln();
        next_y.ratio_to(y).map(|ratio| ratio.ln() / span)
    });
    let steps = steps.collect_vec();
    let pairs = (0..steps.len()).array_combinations::<2>().collect_vec();
    let alpha = ALPHA / pairs.len() as f64;
    let (mut seen, mut is_settled, mut fewest) = (Vec::new(), true, usize::MAX);
    for [a, b] in pairs {
        let difference = steps[b].with(&steps[a], |later, earlier| later - earlier);
        fewest = fewest.min(difference.n().unwrap_or(0));
        let change = difference.estimate(Scale::Sums, alpha);
        match change.interval {
            Some(Interval { low, high }) if low > MIN_CHANGE || high < -MIN_CHANGE => {
                seen.push((b - a, -change.median.abs(), [a, b]));
            }
            Some(Interval { low, high }) if low > -MIN_CHANGE && high < MIN_CHANGE => {}
            _ => is_settled = false,
        }
    }
    let nearest = seen.into_iter().min_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
    match nearest {
        Some((_, _, [a, b])) => Knee::Seen(KneeBracket {
            at: (points[a + 1].0 * points[b].0).sqrt(),
            between: Interval { low: points[a].0, high: points[b + 1].0 },
            before: steps[a].estimate(Scale::Sums, alpha).median,
            after: steps[b].estimate(Scale::Sums, alpha).median,
        }),
        None if is_settled => Knee::NotSeen,
        None => Knee::NotSettled(too_few(fewest).unwrap_or_else(|| {
            format!("the exponent may change by {MIN_CHANGE} within its intervals")
        })),
    }
}

fn too_few(visits: usize) -> Option<String> {
    (visits < MIN_VISITS).then(|| format!("too few visits: {visits} of {MIN_VISITS}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use fathom_experiments::RoundSample;

    fn sample((visit, value): (u32, f64)) -> RoundSample {
        RoundSample { round: visit, visit: Some(visit), at_s: 60.0 * f64::from(visit), value }
    }

    fn visits(values: impl IntoIterator<Item = f64>) -> Quantity {
        Quantity::Sampled((0..).zip(values).map(sample).collect())
    }

    /// Twelve visits about a value, apart by so much of it.
    fn samples(value: f64, spread: f64) -> Quantity {
        visits((0..12).map(|n| value * (1.0 + spread * (f64::from(n) / 5.5 - 1.0))))
    }

    fn shares(of: &[f64], spread: f64) -> Vec<ShareAt> {
        let sizes = [64.0, 128.0, 256.0, 512.0];
        let point = |(size, share): (f64, &f64)| {
            let min = samples(*share, spread);
            ShareAt { size, max: min.clone(), min }
        };
        sizes.into_iter().zip(of).map(point).collect()
    }

    fn between(knee: Knee) -> Result<[f64; 2], bool> {
        match knee {
            Knee::Seen(KneeBracket { at, between: Interval { low, high }, .. }) => {
                assert!((low..=high).contains(&at));
                Ok([low, high])
            }
            other => Err(other == Knee::NotSeen),
        }
    }

    /// `Err(true)`: not seen; `Err(false)`: not settled.
    #[test]
    fn a_share_crosses_where_intervals_do() {
        for (what, of, spread, expected) in [
            ("rises", &[0.2, 0.3, 0.6, 0.8][..], 0.01, Ok([128.0, 256.0])),
            ("falls", &[0.8, 0.6, 0.4, 0.2], 0.01, Ok([128.0, 256.0])),
            ("a size on the bound", &[0.2, 0.5, 0.8], 0.01, Ok([64.0, 256.0])),
            ("below", &[0.1, 0.2, 0.3], 0.01, Err(true)),
            ("above", &[0.7, 0.8, 0.9], 0.01, Err(true)),
            ("crosses within its intervals", &[0.45, 0.49, 0.51, 0.55], 0.5, Err(false)),
            ("ends on the bound", &[0.2, 0.3, 0.5], 0.01, Err(false)),
            ("rises and falls", &[0.2, 0.8, 0.2, 0.8], 0.01, Err(false)),
            ("no size", &[], 0.01, Err(false)),
        ] {
            assert_eq!(between(crossing(&shares(of, spread), 0.5)), expected, "{what}");
        }
        let mut few = shares(&[0.2, 0.8], 0.01);
        few.iter_mut().for_each(|point| point.min = visits([0.2; 3]));
        let knee = crossing(&few, 0.5);
        assert_eq!(knee, Knee::NotSettled("too few visits: 3 of 4".to_owned()));
        for size in [0, 1] {
            let mut bounds = shares(&[0.2, 0.8], 0.01);
            (bounds[size].min, bounds[size].max) = (visits([0.0; 12]), visits([0.9; 12]));
            assert_eq!(between(crossing(&bounds, 0.5)), Err(false), "size {size} is not known");
        }
    }

    #[test]
    fn an_exponent_changes_where_intervals_of_steps_differ() {
        let sizes = [32.0, 64.0, 128.0, 256.0, 512.0];
        let many: Vec<f64> = (1..=1_000).map(f64::from).collect();
        let times_at = |sizes: &[f64], of: &dyn Fn(f64) -> f64, noise: f64| {
            let reading = |(place, x): (usize, f64)| {
                let value = |n: u32| {
                    let sign = if (n as usize + place).is_multiple_of(2) { 1.0 } else { -1.0 };
                    of(x) * (1.0 + sign * noise)
                };
                (x, visits((0..24).map(value)))
            };
            sizes.iter().copied().enumerate().map(reading).collect_vec()
        };
        let times = |of: &dyn Fn(f64) -> f64, noise| times_at(&sizes, of, noise);
        for (what, times, expected) in [
            ("power law", times(&|x| x * x, 0.001), Err(true)),
            ("power law in noise", times(&|x| x * x, 0.3), Err(false)),
            (
                "from constant to square",
                times(&|x| (x / 128.0).max(1.0).powi(2), 0.001),
                Ok([64.0, 256.0]),
            ),
            ("fixed cost", times(&|x| 1e5 + x * x, 0.001), Ok([128.0, 512.0])),
            ("two sizes", times(&|x| x, 0.001)[..2].to_vec(), Err(false)),
            // All pairs of their steps would take 25 samples.
            ("many sizes", times_at(&many, &|x| x * x, 0.001), Err(true)),
        ] {
            assert_eq!(between(change_of_exponent(times)), expected, "{what}");
        }
    }
}
