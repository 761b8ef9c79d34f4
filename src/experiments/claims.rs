//! Claims against records: *supported*, *contradicted*, or *untestable here* with the reason.
//!
//! A verdict rests on intervals. A figure whose whole 95 % interval lies inside the claimed band supports the claim, one
//! whose interval lies outside contradicts it, and one that straddles the edge decides nothing.

use std::fmt;

use serde_json::{Map, Value};

use super::expand::label_text;
use super::measure::{self, Measure, Reading};
use super::schema::{Claim, Direction, Experiment, Test};
use crate::record::{Cell, Estimate};
use crate::statistics::{Slope, log_log_slope};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    Supported,
    Contradicted,
    Untestable,
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Verdict::Supported => "supported",
            Verdict::Contradicted => "contradicted",
            Verdict::Untestable => "untestable here",
        })
    }
}

/// A claim's verdict with the figure it rests on.
#[derive(Clone, Debug, PartialEq)]
pub struct Ruling {
    pub id: String,
    pub text: String,
    pub verdict: Verdict,
    /// One sentence with the figure and, where untestable, why.
    pub reason: String,
}

type Finding = (Verdict, String);

fn untestable(reason: impl Into<String>) -> Finding {
    (Verdict::Untestable, reason.into())
}

impl Experiment {
    /// Rules on every claim. `software`: the cells were measured on a software driver, so that absolute times do not count.
    pub fn rulings(&self, cells: &[&Cell], software: bool) -> Vec<Ruling> {
        self.claim
            .iter()
            .map(|claim| {
                let (verdict, reason) = rule(claim, cells, software);
                Ruling {
                    id: claim.id.clone(),
                    text: claim.text.clone(),
                    verdict,
                    reason,
                }
            })
            .collect()
    }
}

fn rule(claim: &Claim, cells: &[&Cell], software: bool) -> Finding {
    let fitting = |cell: &&Cell| measure::fits(cell, &claim.filter);
    let cells: Vec<&Cell> = cells.iter().copied().filter(fitting).collect();
    match &claim.test {
        Test::AtLeast { y, value } => at_least(y, *value, &cells, software),
        Test::NoWorse {
            y,
            of,
            than,
            margin,
        } => no_worse(y, [of, than], *margin, &cells),
        test => by_group(test, &cells),
    }
}

/// Rules on each group of cells that differ in the claim's axis only, and joins the findings: one contradiction contradicts,
/// one undecided group leaves the whole undecided.
fn by_group(test: &Test, cells: &[&Cell]) -> Finding {
    let Some(over) = test.over() else {
        return untestable("the claim names no axis");
    };
    let groups = groups(cells, over);
    if groups.is_empty() {
        return untestable(format!("no cell along `{over}`"));
    }
    let several = groups.len() > 1;
    let findings: Vec<Finding> = groups
        .iter()
        .map(|(name, group)| {
            let (verdict, reason) = rule_group(test, over, group);
            let prefix = if several {
                format!("{name}: ")
            } else {
                String::new()
            };
            (verdict, prefix + &reason)
        })
        .collect();
    let has = |wanted: Verdict| findings.iter().any(|(verdict, _)| *verdict == wanted);
    let verdict = [Verdict::Contradicted, Verdict::Untestable]
        .into_iter()
        .find(|verdict| has(*verdict))
        .unwrap_or(Verdict::Supported);
    let reasons: Vec<String> = findings.into_iter().map(|(_, reason)| reason).collect();
    (verdict, reasons.join("; "))
}

/// Cells that have the axis, grouped by the values of all their other axes.
pub fn groups<'a>(cells: &[&'a Cell], over: &str) -> Vec<(String, Vec<&'a Cell>)> {
    let mut groups: Vec<(String, Vec<&Cell>)> = Vec::new();
    for cell in cells.iter().filter(|cell| cell.axes.contains_key(over)) {
        let others: Vec<String> = cell
            .axes
            .iter()
            .filter(|(name, _)| *name != over)
            .map(|(name, value)| format!("{name}={}", label_text(value)))
            .collect();
        let name = others.join(", ");
        match groups.iter_mut().find(|(known, _)| *known == name) {
            Some((_, members)) => members.push(cell),
            None => groups.push((name, vec![cell])),
        }
    }
    groups
}

fn rule_group(test: &Test, over: &str, cells: &[&Cell]) -> Finding {
    match test {
        Test::Slope {
            y,
            x,
            expected,
            tolerance,
            max_fixed_share,
            min_decades,
            ..
        } => match scaling(y, x, cells, *max_fixed_share) {
            Ok(fit) => slope(&fit, *expected, *tolerance, *min_decades),
            Err(reason) => untestable(reason),
        },
        Test::Independent { y, tolerance, .. } => independent(y, over, *tolerance, cells),
        Test::Ratio {
            y,
            numerator,
            denominator,
            low,
            high,
            ..
        } => ratio(y, over, [numerator, denominator], [*low, *high], cells),
        Test::Monotone {
            y,
            x,
            direction,
            tolerance,
            ..
        } => monotone(y, x, *direction, *tolerance, cells),
        Test::AtLeast { .. } | Test::NoWorse { .. } => untestable("the claim names no axis"),
    }
}

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
    let points: Vec<(f64, Reading<'_>)> = cells
        .iter()
        .filter_map(|cell| {
            let measured = measure::measured(cell)?;
            let x = x.read(cell, measured)?.estimate.median;
            let y = y.read(cell, measured)?;
            (x > 0.0 && y.estimate.median > 0.0).then_some((x, y))
        })
        .collect();
    if points.len() < 3 {
        return Err(format!(
            "{} measured {}, and a slope needs 3",
            points.len(),
            plural(points.len(), "cell")
        ));
    }
    let medians: Vec<(f64, f64)> = points
        .iter()
        .map(|(x, y)| (*x, y.estimate.median))
        .collect();
    let fixed = fixed_cost(&medians);
    let kept: Vec<(f64, &[f64])> = points
        .iter()
        .filter(|(_, y)| fixed <= max_fixed_share * y.estimate.median)
        .map(|(x, y)| {
            let median = std::slice::from_ref(&y.estimate.median);
            (
                *x,
                y.samples.filter(|all| !all.is_empty()).unwrap_or(median),
            )
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
    let slope = log_log_slope(&kept).ok_or_else(|| {
        format!(
            "a fixed cost of {} outweighs the work in {left_out} cells",
            in_ms(fixed)
        )
    })?;
    Ok(Scaling {
        slope,
        range: (low, high),
        decades: (high / low).log10(),
        fixed,
        left_out,
    })
}

/// Intercept of `y = F + k x`, least squares on relative residuals; zero where the fit's is negative.
fn fixed_cost(points: &[(f64, f64)]) -> f64 {
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
    if determinant <= f64::EPSILON * w * wxx {
        return 0.0;
    }
    ((wy * wxx - wx * wxy) / determinant).max(0.0)
}

fn slope(fit: &Scaling, expected: f64, tolerance: f64, min_decades: f64) -> Finding {
    let Slope {
        slope,
        low,
        high,
        n,
        ..
    } = fit.slope;
    let mut figure = format!(
        "slope {slope:.3} ({low:.3} – {high:.3}) over {:.2} decades, {n} cells",
        fit.decades
    );
    if fit.left_out > 0 {
        figure += &format!(
            ", {} left out below a fixed cost of {}",
            fit.left_out,
            in_ms(fit.fixed)
        );
    }
    // Sweeps end at round numbers: a hair below a decade is a decade.
    if fit.decades < min_decades - 1e-6 {
        return untestable(format!("{figure}; {min_decades} decades are needed"));
    }
    let band = (expected - tolerance, expected + tolerance);
    within(&Interval { low, high }, band, figure)
}

/// A 95 % interval.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Interval {
    low: f64,
    high: f64,
}

fn within(interval: &Interval, (low, high): (f64, f64), figure: String) -> Finding {
    if interval.low >= low && interval.high <= high {
        (Verdict::Supported, figure)
    } else if interval.high < low || interval.low > high {
        (Verdict::Contradicted, figure)
    } else {
        let band = match (low == f64::NEG_INFINITY, high == f64::INFINITY) {
            (true, _) => format!("{high:.3}"),
            (_, true) => format!("{low:.3}"),
            _ => format!("the edge of {low:.3} – {high:.3}"),
        };
        untestable(format!("{figure}: the interval straddles {band}"))
    }
}

/// Ratio of two independent medians with its interval, by the method of variance estimates recovery on logarithms
/// (Zou & Donner, *Stat. Med.* 27 (2008)).
fn quotient(a: &Estimate, b: &Estimate) -> (f64, Interval) {
    let ratio = a.median / b.median;
    let reach = |near: f64, far: f64| (near / far).ln().abs();
    let down = reach(a.median, a.low).hypot(reach(b.median, b.high));
    let up = reach(a.median, a.high).hypot(reach(b.median, b.low));
    let interval = Interval {
        low: ratio * (-down).exp(),
        high: ratio * up.exp(),
    };
    (ratio, interval)
}

fn read_positive(y: &Measure, cell: &Cell) -> Option<Estimate> {
    let estimate = y.read(cell, measure::measured(cell)?)?.estimate;
    (estimate.low > 0.0 && estimate.high.is_finite()).then_some(estimate)
}

fn independent(y: &Measure, over: &str, tolerance: f64, cells: &[&Cell]) -> Finding {
    let readings: Vec<(String, Estimate)> = cells
        .iter()
        .filter_map(|cell| {
            let label = cell.axes.get(over).map(label_text)?;
            Some((label, read_positive(y, cell)?))
        })
        .collect();
    let by_median =
        |a: &&(String, Estimate), b: &&(String, Estimate)| a.1.median.total_cmp(&b.1.median);
    let largest = readings.iter().max_by(by_median);
    let smallest = readings.iter().min_by(by_median);
    let (Some(largest), Some(smallest), true) = (largest, smallest, readings.len() > 1) else {
        return untestable(format!(
            "{} measured {}, and 2 are needed",
            readings.len(),
            plural(readings.len(), "cell")
        ));
    };
    let (ratio, interval) = quotient(&largest.1, &smallest.1);
    let figure = format!(
        "largest ({}) over smallest ({}) {}",
        largest.0,
        smallest.0,
        with_interval(ratio, &interval)
    );
    within(&interval, (f64::NEG_INFINITY, 1.0 + tolerance), figure)
}

fn ratio(y: &Measure, over: &str, sides: [&Value; 2], band: [f64; 2], cells: &[&Cell]) -> Finding {
    let [numerator, denominator] = sides.map(|wanted| {
        let cell = cells.iter().find(|cell| {
            let value = cell.axes.get(over);
            value.is_some_and(|value| measure::same(value, wanted))
        });
        cell.and_then(|cell| read_positive(y, cell))
    });
    let [over_name, under_name] = sides.map(label_text);
    let (Some(a), Some(b)) = (numerator, denominator) else {
        return untestable(format!(
            "`{over_name}` and `{under_name}` were not both measured"
        ));
    };
    let (ratio, interval) = quotient(&a, &b);
    let figure = format!(
        "{over_name} / {under_name} {}",
        with_interval(ratio, &interval)
    );
    within(&interval, (band[0], band[1]), figure)
}

fn at_least(y: &Measure, value: f64, cells: &[&Cell], software: bool) -> Finding {
    let worst = cells
        .iter()
        .filter_map(|cell| read_positive(y, cell))
        .min_by(|a, b| a.median.total_cmp(&b.median));
    let Some(worst) = worst else {
        return untestable("no cell was measured at the size the claim speaks of");
    };
    let interval = Interval {
        low: worst.low,
        high: worst.high,
    };
    let figure = format!(
        "{:.2} ({:.2} – {:.2}) {y} against {value}",
        worst.median, worst.low, worst.high
    );
    if software && y.is_absolute() {
        return untestable(format!("{figure}: absolute times count only on hardware"));
    }
    within(&interval, (value, f64::INFINITY), figure)
}

fn no_worse(y: &Measure, sides: [&Map<String, Value>; 2], margin: f64, cells: &[&Cell]) -> Finding {
    let [of, than] = sides.map(|filter| {
        let cell = cells.iter().find(|cell| measure::fits(cell, filter));
        cell.and_then(|cell| read_positive(y, cell))
    });
    let (Some(of), Some(than)) = (of, than) else {
        return untestable(format!("{y} was not recorded in both cells"));
    };
    let (ratio, interval) = quotient(&of, &than);
    let figure = format!(
        "{y} {:.4} against {:.4}, ratio {}",
        of.median,
        than.median,
        with_interval(ratio, &interval)
    );
    within(&interval, (f64::NEG_INFINITY, 1.0 + margin), figure)
}

fn monotone(
    y: &Measure,
    x: &Measure,
    direction: Direction,
    tolerance: f64,
    cells: &[&Cell],
) -> Finding {
    let mut points: Vec<(f64, Estimate)> = cells
        .iter()
        .filter_map(|cell| {
            let x = x.read(cell, measure::measured(cell)?)?.estimate.median;
            Some((x, read_positive(y, cell)?))
        })
        .collect();
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    if direction == Direction::Falling {
        points.reverse();
    }
    let (Some(first), Some(last), true) = (points.first(), points.last(), points.len() > 2) else {
        return untestable(format!(
            "{} measured {}, and 3 are needed",
            points.len(),
            plural(points.len(), "cell")
        ));
    };
    let (whole, whole_interval) = quotient(&last.1, &first.1);
    let floor = 1.0 / (1.0 + tolerance);
    let steps = points
        .windows(2)
        .map(|pair| quotient(&pair[1].1, &pair[0].1));
    let (worst, worst_interval) = steps
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .unwrap_or((whole, whole_interval));
    let figure = format!(
        "end to end {}, smallest step {}",
        with_interval(whole, &whole_interval),
        with_interval(worst, &worst_interval)
    );
    if worst_interval.high < floor || whole_interval.high < 1.0 {
        (Verdict::Contradicted, figure)
    } else if worst >= floor && whole_interval.low > 1.0 {
        (Verdict::Supported, figure)
    } else {
        untestable(format!("{figure}: within the noise"))
    }
}

fn with_interval(value: f64, interval: &Interval) -> String {
    if interval.low == interval.high {
        return format!("{value:.3}");
    }
    format!("{value:.3} ({:.3} – {:.3})", interval.low, interval.high)
}

fn in_ms(ns: f64) -> String {
    format!("{:.3} ms", ns * 1e-6)
}

fn plural(count: usize, noun: &str) -> String {
    if count == 1 {
        noun.to_owned()
    } else {
        format!("{noun}s")
    }
}

#[cfg(test)]
mod tests;
