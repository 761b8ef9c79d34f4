//! Cells held against each other and against bounds.

use itertools::{Itertools, MinMaxResult};
use serde_json::{Map, Value};

use super::{
    Finding, Interval, Verdict, quotient, read_positive, too_few, untestable, with_interval, within,
};
use crate::experiments::expand::label_text;
use crate::experiments::measure::{self, Measure};
use crate::experiments::schema::Direction;
use crate::record::{Cell, Estimate};

pub(super) fn independent(y: &Measure, over: &str, tolerance: f64, cells: &[&Cell]) -> Finding {
    let readings = labelled(y, over, cells);
    let by_median = readings.iter().minmax_by(|a, b| a.1.median.total_cmp(&b.1.median));
    let MinMaxResult::MinMax(smallest, largest) = by_median else {
        return untestable(too_few(readings.len(), "2 are needed"));
    };
    let (ratio, interval) = quotient(&largest.1, &smallest.1);
    let figure = format!(
        "largest ({}) over smallest ({}) {}",
        label_text(&largest.0),
        label_text(&smallest.0),
        with_interval(ratio, &interval)
    );
    within(&interval, (f64::NEG_INFINITY, 1.0 + tolerance), figure)
}

pub(super) fn ratio(
    y: &Measure,
    over: &str,
    sides: [&Value; 2],
    band: [f64; 2],
    cells: &[&Cell],
) -> Finding {
    let [numerator, denominator] = sides.map(|wanted| {
        let cell = cells.iter().find(|cell| {
            let value = cell.axes.get(over);
            value.is_some_and(|value| measure::same(value, wanted))
        });
        cell.and_then(|cell| read_positive(y, cell))
    });
    let [over_name, under_name] = sides.map(label_text);
    let (Some(a), Some(b)) = (numerator, denominator) else {
        return untestable(format!("`{over_name}` and `{under_name}` were not both measured"));
    };
    let (ratio, interval) = quotient(&a, &b);
    let figure = format!("{over_name} / {under_name} {}", with_interval(ratio, &interval));
    within(&interval, (band[0], band[1]), figure)
}

pub(super) fn at_least(y: &Measure, value: f64, cells: &[&Cell], software: bool) -> Finding {
    let worst = cells
        .iter()
        .filter_map(|cell| read_positive(y, cell))
        .min_by(|a, b| a.median.total_cmp(&b.median));
    let against = format!("against {value}");
    bounded(y, worst, (value, f64::INFINITY), &against, software)
}

/// The cell that lies farthest from the band's middle, by factors, stands for all.
pub(super) fn inside(y: &Measure, band: [f64; 2], cells: &[&Cell], software: bool) -> Finding {
    let middle = (band[0] * band[1]).sqrt();
    let off = |estimate: &Estimate| (estimate.median / middle).ln().abs();
    let readings = cells.iter().filter_map(|cell| read_positive(y, cell));
    let worst = readings.max_by(|a, b| off(a).total_cmp(&off(b)));
    let against = format!("against {} – {}", band[0], band[1]);
    bounded(y, worst, (band[0], band[1]), &against, software)
}

fn bounded(
    y: &Measure,
    worst: Option<Estimate>,
    band: (f64, f64),
    against: &str,
    software: bool,
) -> Finding {
    let Some(worst) = worst else {
        return untestable("no cell was measured at the size the claim speaks of");
    };
    let interval = Interval { low: worst.low, high: worst.high };
    let figure =
        format!("{:.2} ({:.2} – {:.2}) {y} {against}", worst.median, worst.low, worst.high);
    if software && y.is_absolute() {
        return untestable(format!("{figure}: absolute times count only on hardware"));
    }
    within(&interval, band, figure)
}

pub(super) fn no_worse(
    y: &Measure,
    sides: [&Map<String, Value>; 2],
    margin: f64,
    cells: &[&Cell],
) -> Finding {
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

pub(super) fn monotone(
    y: &Measure,
    x: &Measure,
    direction: Direction,
    tolerance: f64,
    cells: &[&Cell],
) -> Finding {
    let mut points = points(y, x, cells);
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    if direction == Direction::Falling {
        points.reverse();
    }
    let (Some(first), Some(last), true) = (points.first(), points.last(), points.len() > 2) else {
        return untestable(too_few(points.len(), "3 are needed"));
    };
    let (whole, whole_interval) = quotient(&last.1, &first.1);
    let floor = 1.0 / (1.0 + tolerance);
    let steps = points.windows(2).map(|pair| quotient(&pair[1].1, &pair[0].1));
    let (worst, worst_interval) =
        steps.min_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((whole, whole_interval));
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

/// x and y of the cells with a positive y.
fn points(y: &Measure, x: &Measure, cells: &[&Cell]) -> Vec<(f64, Estimate)> {
    let read = |cell: &&Cell| {
        let x = x.read(cell, cell.measured()?)?.estimate.median;
        Some((x, read_positive(y, cell)?))
    };
    cells.iter().filter_map(read).collect()
}

/// The cells with a positive y, each under its label on the axis.
fn labelled(y: &Measure, over: &str, cells: &[&Cell]) -> Vec<(Value, Estimate)> {
    let read = |cell: &&Cell| Some((cell.axes.get(over)?.clone(), read_positive(y, cell)?));
    cells.iter().filter_map(read).collect()
}

pub(super) fn lowest(
    y: &Measure,
    over: &str,
    value: &Value,
    margin: f64,
    cells: &[&Cell],
) -> Finding {
    let (own, others): (Vec<_>, Vec<_>) =
        labelled(y, over, cells).into_iter().partition(|(label, _)| measure::same(label, value));
    let lowest = others.iter().min_by(|a, b| a.1.median.total_cmp(&b.1.median));
    let (Some((_, own)), Some((rival, best))) = (own.first(), lowest) else {
        return untestable(format!(
            "`{}` and another value were not both measured",
            label_text(value)
        ));
    };
    let (ratio, interval) = quotient(own, best);
    let figure = format!(
        "{} / {}, the lowest of {} others: {}",
        label_text(value),
        label_text(rival),
        others.len(),
        with_interval(ratio, &interval)
    );
    within(&interval, (f64::NEG_INFINITY, 1.0 + margin), figure)
}

/// Every cell whose interval reaches below the upper end of the lowest cell's may hold the minimum.
pub(super) fn minimum(y: &Measure, x: &Measure, band: [f64; 2], cells: &[&Cell]) -> Finding {
    let points = points(y, x, cells);
    let inside = |x: f64| (band[0]..=band[1]).contains(&x);
    let below = points.iter().any(|(x, _)| *x < band[0]);
    let above = points.iter().any(|(x, _)| *x > band[1]);
    let lowest = points.iter().min_by(|a, b| a.1.median.total_cmp(&b.1.median));
    let (Some((at, lowest)), true) = (lowest, below && above) else {
        return untestable(format!("cells on both sides of {} – {} are needed", band[0], band[1]));
    };
    let candidates: Vec<f64> =
        points.iter().filter(|(_, y)| y.low <= lowest.high).map(|(x, _)| *x).collect();
    let figure = format!("lowest at {at}: {:.4}", lowest.median);
    match candidates.iter().filter(|x| inside(**x)).count() {
        n if n == candidates.len() => (Verdict::Supported, figure),
        0 => (Verdict::Contradicted, figure),
        _ => untestable(format!("{figure}: within the noise of cells outside the band")),
    }
}
