//! Lines through cells: power laws and affine ones.

use std::collections::HashSet;

use super::{Finding, Interval, Verdict, in_ms, too_few, untestable, with_interval, within};
use crate::experiments::measure::{Measure, MeasuredValue};
use crate::record::{Cell, Estimate};
use crate::statistics::{Slope, log_log_slope};

/// Points that a slope is fitted to; of more, as many are taken. Each resample of the bootstrap looks at every pair of them.
const MOST_POINTS: usize = 64;

/// A power law fitted where the fixed cost no longer matters.
#[derive(Clone, Debug, PartialEq)]
pub struct Scaling {
    pub slope: Slope,
    /// Smallest and largest x of the cells fitted.
    pub range: (f64, f64),
    pub decades: f64,
    /// The affine fit's cost at x = 0, in the unit of y.
    pub fixed: f64,
    /// Cells left out because the fixed cost was too great a share of them.
    pub left_out: usize,
}

/// Fits `y ∝ x^b` over cells whose fixed cost is at most `max_fixed_share` of y. The fixed cost is that of an affine fit with
/// relative weights, and never negative.
pub fn scaling(
    y: &Measure,
    x: &Measure,
    cells: &[&Cell],
    max_fixed_share: f64,
) -> Result<Scaling, String> {
    let points = thinned(readings(y, x, cells));
    if points.len() < 3 {
        return Err(too_few(points.len(), "a slope needs 3"));
    }
    let medians: Vec<(f64, f64)> = points.iter().map(|(x, y)| (*x, y.estimate.median)).collect();
    let fixed = Line::fit(&medians).map_or(0.0, |line| line.fixed_cost());
    let kept: Vec<(f64, &[f64])> = points
        .iter()
        .filter(|(_, y)| fixed <= max_fixed_share * y.estimate.median)
        .map(|(x, y)| {
            let median = std::slice::from_ref(&y.estimate.median);
            (*x, y.samples.as_deref().filter(|all| !all.is_empty()).unwrap_or(median))
        })
        .collect();
    let left_out = points.len() - kept.len();
    if kept.len() < 3 {
        return Err(format!(
            "a fixed cost of {} is more than {:.0} % of the time in {left_out} of {} cells",
            in_ms(fixed),
            100.0 * max_fixed_share,
            points.len()
        ));
    }
    let low = kept.iter().map(|(x, _)| *x).fold(f64::INFINITY, f64::min);
    let high = kept.iter().map(|(x, _)| *x).fold(0.0, f64::max);
    let slope = interval_slope(&kept).ok_or_else(|| {
        format!("a fixed cost of {} outweighs the work in {left_out} cells", in_ms(fixed))
    })?;
    Ok(Scaling { slope, range: (low, high), decades: (high / low).log10(), fixed, left_out })
}

/// The slope with its interval. Where nothing was sampled more than once there is no noise to resample: the interval then
/// runs over the slopes that leave one cell out.
fn interval_slope(points: &[(f64, &[f64])]) -> Option<Slope> {
    let slope = log_log_slope(points)?;
    if points.iter().any(|(_, samples)| samples.len() > 1) {
        return Some(slope);
    }
    let without = (0..points.len()).filter_map(|left_out| {
        let mut rest = points.to_vec();
        rest.remove(left_out);
        Some(log_log_slope(&rest)?.slope)
    });
    let all: Vec<f64> = without.chain([slope.slope]).collect();
    Some(Slope {
        low: all.iter().copied().fold(f64::INFINITY, f64::min),
        high: all.iter().copied().fold(f64::NEG_INFINITY, f64::max),
        ..slope
    })
}

/// At most [`MOST_POINTS`], spread over the points in the order of their x.
fn thinned<T>(mut points: Vec<(f64, T)>) -> Vec<(f64, T)> {
    let n = points.len();
    if n <= MOST_POINTS {
        return points;
    }
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    let chosen: HashSet<usize> =
        (0..MOST_POINTS).map(|index| index * (n - 1) / (MOST_POINTS - 1)).collect();
    let points = points.into_iter().enumerate().filter(|(place, _)| chosen.contains(place));
    points.map(|(_, point)| point).collect()
}

/// x and y of the measured cells in which both are positive.
fn readings<'a>(y: &Measure, x: &Measure, cells: &[&'a Cell]) -> Vec<(f64, MeasuredValue<'a>)> {
    let both = |cell: &&'a Cell| {
        let measured = cell.measured()?;
        let x = x.read(cell, measured)?.estimate.median;
        let y = y.read(cell, measured)?;
        (x > 0.0 && y.estimate.median > 0.0).then_some((x, y))
    };
    cells.iter().filter_map(both).collect()
}

/// `y = fixed + rate · x`.
struct Line {
    fixed: f64,
    rate: f64,
}

impl Line {
    /// Least squares on relative residuals; none where x does not vary.
    fn fit(points: &[(f64, f64)]) -> Option<Line> {
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
        (determinant > f64::EPSILON * w * wxx).then(|| Line {
            fixed: (wy * wxx - wx * wxy) / determinant,
            rate: (w * wxy - wx * wy) / determinant,
        })
    }

    /// What is left at x = 0 of something that rises; never negative.
    fn fixed_cost(&self) -> f64 {
        if self.rate > 0.0 { self.fixed.max(0.0) } else { 0.0 }
    }

    fn at(&self, x: f64) -> f64 {
        self.fixed + self.rate * x
    }
}

pub(super) fn affine(
    y: &Measure,
    x: &Measure,
    tolerance: f64,
    min_rising_share: f64,
    cells: &[&Cell],
) -> Finding {
    let points: Vec<(f64, Estimate)> =
        readings(y, x, cells).into_iter().map(|(x, y)| (x, y.estimate)).collect();
    let medians: Vec<(f64, f64)> = points.iter().map(|(x, y)| (*x, y.median)).collect();
    let (Some(line), true) = (Line::fit(&medians), points.len() > 3) else {
        return untestable(too_few(points.len(), "a straight line needs 4"));
    };
    let off = |x: f64, y: f64| y / line.at(x) - 1.0;
    let worst = points
        .iter()
        .map(|(x, y)| {
            let [low, high] = [y.low, y.high].map(|y| off(*x, y));
            let across = low < 0.0 && high > 0.0;
            let interval = Interval {
                low: if across { 0.0 } else { low.abs().min(high.abs()) },
                high: low.abs().max(high.abs()),
            };
            (off(*x, y.median).abs(), interval)
        })
        .max_by(|a, b| a.0.total_cmp(&b.0));
    let Some((value, worst)) = worst else {
        return untestable("no cell");
    };
    let most = medians.iter().map(|(x, _)| *x).fold(0.0, f64::max);
    let rising = line.rate * most / line.at(most);
    let figure = format!(
        "at most {} off a straight line, {:.0} % of the largest cell rising with x, {} cells",
        with_interval(value, &worst),
        100.0 * rising,
        points.len()
    );
    if line.rate <= 0.0 {
        return (Verdict::Contradicted, format!("{figure}: the line falls"));
    }
    if rising < min_rising_share {
        return untestable(format!("{figure}: {:.0} % are needed", 100.0 * min_rising_share));
    }
    within(&worst, (f64::NEG_INFINITY, tolerance), figure)
}

pub(super) fn slope(fit: &Scaling, expected: f64, tolerance: f64, min_decades: f64) -> Finding {
    let Slope { slope, low, high, n, .. } = fit.slope;
    let mut figure = format!(
        "slope {slope:.3} ({low:.3} – {high:.3}) over {:.2} decades, {n} cells",
        fit.decades
    );
    if fit.left_out > 0 {
        figure +=
            &format!(", {} left out below a fixed cost of {}", fit.left_out, in_ms(fit.fixed));
    }
    // Sweeps end at round numbers: a hair below a decade is a decade.
    if fit.decades < min_decades - 1e-6 {
        return untestable(format!("{figure}; {min_decades} decades are needed"));
    }
    let band = (expected - tolerance, expected + tolerance);
    within(&Interval { low, high }, band, figure)
}
