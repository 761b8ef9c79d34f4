//! Lines through cells: power laws and affine ones.
//!
//! Cells that share rounds are fitted round by round: the fits of all rounds are the samples of the fitted figure.

use std::collections::HashSet;

use super::evidence::{BoundCheck, ClaimFigure};
use super::{Tested, format_ms, too_few};
use crate::measure::{Measure, Quantity, RoundSample};
use crate::schema::RISING_SHARE;
use fathom_base::statistics::{self, Interval, Slope, log_log_slope};
use fathom_record::Cell;

/// Points that a slope is fitted to; of more, as many are taken. Each fit looks at every pair of them.
const MAX_POINTS: usize = 64;

/// A power law fitted where the fixed cost no longer matters.
#[derive(Clone, Debug, PartialEq)]
pub struct Scaling {
    /// Of the medians.
    pub slope: Slope,
    /// The slope of each round that has all cells; one where nothing was sampled more than once.
    pub round_slopes: Quantity,
    /// The interval of [`Self::slope`] by resampling each cell, where the cells were measured apart: too few rounds have all of them.
    pub resampled: Option<Interval>,
    /// Smallest and largest slope with one cell left out.
    pub without_one: Interval,
    /// Smallest and largest x of the cells fitted.
    pub range: (f64, f64),
    pub decades: f64,
    /// The affine fit's cost at x = 0, in the unit of y.
    pub fixed: f64,
    /// Cells left out because the fixed cost was too great a share of them.
    pub left_out: usize,
}

impl Scaling {
    /// Whether it is the fit over medians of cells that were measured apart.
    pub fn is_apart(&self) -> bool {
        self.resampled.is_some() || self.round_slopes.n() == Some(0)
    }

    /// The exponent: the median over the rounds, or the fit over medians.
    pub fn exponent(&self) -> f64 {
        if self.is_apart() { self.slope.slope } else { self.round_slopes.median() }
    }

    /// Its interval: over the rounds, over the cells where nothing was sampled more than once, or by resampling.
    pub fn interval(&self) -> Option<Interval> {
        match &self.round_slopes {
            Quantity::Exact(_) => Some(self.without_one),
            _ if self.is_apart() => self.resampled,
            sampled => sampled.estimate().interval,
        }
    }
}

/// Fits `y ∝ x^b` over cells whose fixed cost is at most `max_fixed_share` of y. The fixed cost is that of an affine fit with
/// relative weights, and never negative.
pub fn scaling(
    y: &Measure,
    x: &Measure,
    cells: &[&Cell],
    max_fixed_share: f64,
) -> Result<Scaling, String> {
    let points = thin_out(readings(y, x, cells), MAX_POINTS);
    if points.len() < 3 {
        return Err(too_few(points.len(), "a slope needs 3"));
    }
    let fixed = LinearFit::fit(&medians(&points)).map_or(0.0, |line| line.fixed_cost());
    let count = points.len();
    let kept: Vec<(f64, Quantity)> =
        points.into_iter().filter(|(_, y)| fixed <= max_fixed_share * y.median()).collect();
    let left_out = count - kept.len();
    if kept.len() < 3 {
        return Err(format!(
            "a fixed part of {} is more than {:.0} % of the figure in {left_out} of {count} cells",
            fixed_part(y, fixed),
            100.0 * max_fixed_share,
        ));
    }
    let low = kept.iter().map(|(x, _)| *x).fold(f64::INFINITY, f64::min);
    let high = kept.iter().map(|(x, _)| *x).fold(0.0, f64::max);
    let slope = log_log_slope(&medians(&kept)).ok_or("all cells have the same x")?;
    let round_slopes = by_round(&kept, |points| Some(log_log_slope(points)?.slope));
    Ok(Scaling {
        slope,
        resampled: round_slopes.estimate().interval.is_none().then(|| resampled(&kept)).flatten(),
        round_slopes,
        without_one: without_one(&medians(&kept), slope.slope),
        range: (low, high),
        decades: (high / low).log10(),
        fixed,
        left_out,
    })
}

/// The interval of the slope of medians of samples that share no rounds; none where all are exact or samples are too few.
fn resampled(points: &[(f64, Quantity)]) -> Option<Interval> {
    let (sampled, exact): (Vec<_>, Vec<_>) = points.iter().partition(|(_, y)| y.n().is_some());
    let samples: Vec<Vec<f64>> = sampled.iter().map(|(_, y)| y.values()).collect();
    let exact: Vec<(f64, f64)> = exact.iter().map(|(x, y)| (*x, y.median())).collect();
    let slope = |medians: &[f64]| {
        let sampled = sampled.iter().zip(medians).map(|((x, _), y)| (*x, *y));
        Some(log_log_slope(&exact.iter().copied().chain(sampled).collect::<Vec<_>>())?.slope)
    };
    if samples.is_empty() { None } else { statistics::resampled_interval(&samples, slope) }
}

/// What does not grow with x, in the unit of y.
fn fixed_part(y: &Measure, fixed: f64) -> String {
    if y.is_time() { format_ms(fixed) } else { format!("{fixed:.3}") }
}

/// Smallest and largest slope of all points and of all but one.
fn without_one(points: &[(f64, f64)], slope: f64) -> Interval {
    let without = (0..points.len()).filter_map(|left_out| {
        let mut rest = points.to_vec();
        rest.remove(left_out);
        Some(log_log_slope(&rest)?.slope)
    });
    let all = without.chain([slope]);
    all.fold(
        Interval { low: f64::INFINITY, high: f64::NEG_INFINITY },
        |Interval { low, high }, s| Interval { low: low.min(s), high: high.max(s) },
    )
}

/// A figure of the points of each round that all of them have; of the exact points where none is sampled.
fn by_round(points: &[(f64, Quantity)], figure: impl Fn(&[(f64, f64)]) -> Option<f64>) -> Quantity {
    let sampled = points.iter().find_map(|(_, y)| match y {
        Quantity::Sampled(samples) => Some(samples),
        Quantity::Exact(_) => None,
    });
    let Some(rounds) = sampled else {
        return Quantity::Exact(figure(&medians(points)).unwrap_or(f64::NAN));
    };
    let value_at = |reading: &Quantity, round: u32| match reading {
        Quantity::Exact(value) => Some(*value),
        Quantity::Sampled(samples) => {
            samples.iter().find(|sample| sample.round == round).map(|sample| sample.value)
        }
    };
    let samples = rounds.iter().filter_map(|RoundSample { round, .. }| {
        let of_round = points.iter().map(|(x, y)| Some((*x, value_at(y, *round)?)));
        let value = figure(&of_round.collect::<Option<Vec<_>>>()?)?;
        value.is_finite().then_some(RoundSample { round: *round, value })
    });
    Quantity::Sampled(samples.collect())
}

/// At most so many, spread over the points in the order of their x.
pub fn thin_out<T>(mut points: Vec<(f64, T)>, most: usize) -> Vec<(f64, T)> {
    let n = points.len();
    if n <= most {
        return points;
    }
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    let chosen: HashSet<usize> = (0..most).map(|index| index * (n - 1) / (most - 1)).collect();
    let points = points.into_iter().enumerate().filter(|(place, _)| chosen.contains(place));
    points.map(|(_, point)| point).collect()
}

/// x and y of the measured cells in which both are positive.
fn readings(y: &Measure, x: &Measure, cells: &[&Cell]) -> Vec<(f64, Quantity)> {
    let both = |cell: &&Cell| {
        let measured = cell.measured()?;
        let x = x.read(cell, measured)?.median();
        let y = y.read(cell, measured)?;
        (x > 0.0 && y.median() > 0.0).then_some((x, y))
    };
    cells.iter().filter_map(both).collect()
}

fn medians(points: &[(f64, Quantity)]) -> Vec<(f64, f64)> {
    points.iter().map(|(x, y)| (*x, y.median())).collect()
}

/// `y = fixed + rate · x`.
struct LinearFit {
    fixed: f64,
    rate: f64,
}

impl LinearFit {
    /// Least squares on relative residuals; none where x does not vary.
    fn fit(points: &[(f64, f64)]) -> Option<LinearFit> {
        let [mut w, mut wx, mut wy, mut wxx, mut wxy] = [0.0; 5];
        for (x, y) in points {
            let weight = 1.0 / (y * y);
            w += weight;
            wx += weight * x;
            wy += weight * y;
            wxx += weight * x * x;
            wxy += weight * x * y;
        }
        let determinant = w * wxx - wx * wx;
        (determinant > f64::EPSILON * w * wxx).then(|| LinearFit {
            fixed: (wy * wxx - wx * wxy) / determinant,
            rate: (w * wxy - wx * wy) / determinant,
        })
    }

    /// What is left at x = 0 of something that rises; never negative.
    fn fixed_cost(&self) -> f64 {
        if self.rate > 0.0 { self.fixed.max(0.0) } else { 0.0 }
    }

    fn value_at(&self, x: f64) -> f64 {
        self.fixed + self.rate * x
    }

    /// Share of y at this x that rises with x.
    fn rising_share(&self, x: f64) -> f64 {
        self.rate * x / self.value_at(x)
    }
}

/// Each cell's distance from the line through all of them, relative to the line.
pub(super) fn affine(y: &Measure, x: &Measure, tolerance: f64, cells: &[&Cell]) -> Tested {
    let points = thin_out(readings(y, x, cells), MAX_POINTS);
    let (Some(line), true) = (LinearFit::fit(&medians(&points)), points.len() > 3) else {
        return Err(too_few(points.len(), "a straight line needs 4"));
    };
    let most = points.iter().map(|(x, _)| *x).fold(0.0, f64::max);
    let share = line.rising_share(most);
    if (0.0..RISING_SHARE).contains(&share) {
        return Err(format!(
            "only {:.0} % of the largest cell rises with x: {:.0} % are needed",
            100.0 * share,
            100.0 * RISING_SHARE
        ));
    }
    let rising = by_round(&points, |points| Some(LinearFit::fit(points)?.rising_share(most)));
    let rising = BoundCheck::new(
        "share of the largest cell that rises with x",
        rising,
        [0.0, f64::INFINITY],
    );
    let off = points.iter().enumerate().map(|(place, (x, _))| {
        let off = by_round(&points, |points| {
            let (x, y) = points[place];
            Some(y / LinearFit::fit(points)?.value_at(x) - 1.0)
        });
        BoundCheck::new(
            format!("distance from a straight line at {x}"),
            off,
            [-tolerance, tolerance],
        )
    });
    Ok([rising].into_iter().chain(off).collect())
}

pub(super) fn slope(fit: &Scaling, expected: f64, tolerance: f64) -> Tested {
    let mut name = String::new();
    if fit.left_out > 0 {
        name += &format!(
            "{} cells left out below a fixed cost of {}, ",
            fit.left_out,
            format_ms(fit.fixed)
        );
    }
    name += &format!("slope over {:.2} decades ({} cells)", fit.decades, fit.slope.n);
    // Sweeps end at round numbers: a hair below a decade is a decade.
    if fit.decades < 1.0 - 1e-6 {
        return Err(format!("{name} {:.3}: x must span a factor of 10 at least", fit.slope.slope));
    }
    let figure = match &fit.round_slopes {
        Quantity::Exact(value) => ClaimFigure::Fitted { value: *value, interval: fit.without_one },
        sampled => ClaimFigure::Reading(sampled.clone()),
    };
    let band = Interval { low: expected - tolerance, high: expected + tolerance };
    Ok(vec![BoundCheck { name, figure, band }])
}
