//! Lines through cells: power laws and affine ones.
//!
//! Cells that share rounds are fitted round by round, and others visit by visit: these fits are the samples of the fitted figure.

use std::collections::HashSet;

use itertools::Itertools;
use serde_json::Value;

use super::evidence::{BoundCheck, ClaimFigure};
use super::{Tested, format_ms, too_few};
use crate::expand::label_text;
use crate::measure::{self, Measure, Quantity, RoundSample};
use crate::schema::{EqualTime, RISING_SHARE};
use fathom_base::statistics::{ALPHA, Interval, Slope, log_log_slope};
use fathom_base::visits::Scale;
use fathom_record::Cell;

/// Points that a slope is fitted to; of more, as many are taken. Each fit looks at every pair of them.
const MAX_POINTS: usize = 64;

/// A power law fitted where the fixed cost no longer matters.
#[derive(Clone, Debug, PartialEq)]
pub struct Scaling {
    /// Of the medians.
    pub slope: Slope,
    /// Of each round that has all cells, else of each visit; one where nothing was sampled more than once.
    pub slopes: Quantity,
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
    /// The exponent: over visits, or of exact figures.
    pub fn exponent(&self) -> f64 {
        match self.slopes.n() {
            None | Some(0) => self.slope.slope,
            Some(_) => self.slopes.estimate(Scale::Sums, ALPHA).median,
        }
    }

    /// Its interval: over visits, or over the cells where nothing was sampled more than once.
    pub fn interval(&self) -> Option<Interval> {
        match &self.slopes {
            Quantity::Exact(_) => Some(self.without_one),
            sampled => sampled.estimate(Scale::Sums, ALPHA).interval,
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
    Ok(Scaling {
        slope,
        slopes: by_visit(&kept, |points| Some(log_log_slope(points)?.slope)),
        without_one: without_one(&medians(&kept), slope.slope),
        range: (low, high),
        decades: (high / low).log10(),
        fixed,
        left_out,
    })
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

/// A figure of the points of each round that all of them have, or of their visits in order, where these are told and more; of the exact
/// points where none is sampled.
fn by_visit(points: &[(f64, Quantity)], figure: impl Fn(&[(f64, f64)]) -> Option<f64>) -> Quantity {
    if points.iter().all(|(_, y)| y.n().is_none()) {
        return Quantity::Exact(figure(&medians(points)).unwrap_or(f64::NAN));
    }
    let in_order = points.iter().map(|(x, y)| (*x, y.in_order_of_visits())).collect::<Vec<_>>();
    let [by_round, in_order] = [points, &in_order].map(|points| by_round(points, &figure));
    if by_round.n() < in_order.n() { in_order } else { by_round }
}

fn by_round(points: &[(f64, Quantity)], figure: impl Fn(&[(f64, f64)]) -> Option<f64>) -> Quantity {
    let sampled = points.iter().find_map(|(_, y)| match y {
        Quantity::Sampled(samples) => Some(samples.as_slice()),
        Quantity::Exact(_) => None,
    });
    let value_at = |reading: &Quantity, round: u32| match reading {
        Quantity::Exact(value) => Some(*value),
        Quantity::Sampled(samples) => {
            samples.iter().find(|sample| sample.round == round).map(|sample| sample.value)
        }
    };
    let samples = sampled.unwrap_or_default().iter().filter_map(|sample| {
        let of_round = points.iter().map(|(x, y)| Some((*x, value_at(y, sample.round)?)));
        let value = figure(&of_round.collect::<Option<Vec<_>>>()?)?;
        value.is_finite().then_some(RoundSample { value, ..*sample })
    });
    Quantity::Sampled(samples.collect())
}

/// At most `max_count` of the points, spread over them in the order of their x.
pub fn thin_out<T>(mut points: Vec<(f64, T)>, max_count: usize) -> Vec<(f64, T)> {
    let n = points.len();
    if n <= max_count {
        return points;
    }
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    let chosen: HashSet<usize> =
        (0..max_count).map(|index| index * (n - 1) / (max_count - 1)).collect();
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
    let max_x = points.iter().map(|(x, _)| *x).fold(0.0, f64::max);
    let share = line.rising_share(max_x);
    if (0.0..RISING_SHARE).contains(&share) {
        return Err(format!(
            "only {:.0} % of the largest cell rises with x: {:.0} % are needed",
            100.0 * share,
            100.0 * RISING_SHARE
        ));
    }
    let rising = by_visit(&points, |points| Some(LinearFit::fit(points)?.rising_share(max_x)));
    let rising = BoundCheck::on(
        Scale::Sums,
        "share of the largest cell that rises with x",
        rising,
        [0.0, f64::INFINITY],
    );
    let off = points.iter().enumerate().map(|(place, (x, _))| {
        let off = by_visit(&points, |points| {
            let (x, y) = points[place];
            Some(y / LinearFit::fit(points)?.value_at(x) - 1.0)
        });
        BoundCheck::on(
            Scale::Sums,
            format!("distance from a straight line at {x}"),
            off,
            [-tolerance, tolerance],
        )
    });
    Ok([rising].into_iter().chain(off).collect())
}

/// `y` at one value over that at each other value, at equal time: see [`EqualTime`]. A value whose smallest size takes longer is no rival.
pub(super) fn equal_time(test: &EqualTime, cells: &[&Cell]) -> Tested {
    let read = cells.iter().copied().filter_map(|cell| {
        let measured = cell.measured()?;
        let (y, time) = (test.y.read(cell, measured)?, test.time.read(cell, measured)?);
        Some((cell.axes.get(&test.over)?, (y.median(), time), measure::fits(cell, &test.of)))
    });
    let read = read.collect_vec();
    let Some(whole) = read.iter().position(|(.., is_whole)| *is_whole) else {
        return Err("the cell whose time is shared out was not measured".to_owned());
    };
    let points = read.iter().map(|(_, point, _)| point.clone()).collect_vec();
    let at = |points: &[(f64, f64)], value: &Value, share: f64| {
        let of_value = read.iter().zip(points).filter(|((of, ..), _)| measure::same(of, value));
        within_time(of_value.map(|(_, point)| *point).collect(), share * points[whole].1)
    };
    let rivals = read.iter().map(|(value, ..)| *value).unique_by(|value| label_text(value));
    let rivals = rivals.filter(|value| !measure::same(value, &test.numerator));
    let mut checks = Vec::new();
    for (rival, share) in rivals.cartesian_product(&test.shares) {
        let names = [&test.numerator, rival].map(label_text);
        let Some(_) = at(&medians(&points), &test.numerator, *share) else {
            return Err(format!("`{}` takes more than {share} of the time at any size", names[0]));
        };
        if at(&medians(&points), rival, *share).is_some() {
            let ratio = by_visit(&points, |points| {
                Some(at(points, &test.numerator, *share)? / at(points, rival, *share)?)
            });
            let name = format!("{} at {share} of the time", names.join(" / "));
            checks.push(BoundCheck::new(name, ratio, [f64::NEG_INFINITY, 1.0]));
        }
    }
    let none = "`shares` is empty, or no other value of the axis is as fast";
    (!checks.is_empty()).then_some(checks).ok_or_else(|| none.to_owned())
}

/// The least y that a time allows, of sizes with their y and their times.
fn within_time(mut sizes: Vec<(f64, f64)>, time: f64) -> Option<f64> {
    sizes.sort_by(|a, b| a.1.total_cmp(&b.1));
    let fit = sizes.iter().filter(|(_, taken)| *taken <= time).map(|(y, _)| *y);
    let least = fit.reduce(f64::min)?;
    let between = sizes.iter().tuple_windows().find(|(a, b)| a.1 <= time && time < b.1);
    Some(between.map_or(least, |(a, b)| {
        let share = (time / a.1).ln() / (b.1 / a.1).ln();
        least.min(a.0 * (b.0 / a.0).powf(share))
    }))
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
    let figure = match &fit.slopes {
        Quantity::Exact(value) => ClaimFigure::Fitted { value: *value, interval: fit.without_one },
        sampled => ClaimFigure::Reading(sampled.clone(), Scale::Sums),
    };
    let band = Interval { low: expected - tolerance, high: expected + tolerance };
    Ok(vec![BoundCheck { name, figure, band }])
}
