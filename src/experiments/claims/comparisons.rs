//! Cells compared with each other and with bounds.

use itertools::Itertools;
use serde_json::{Map, Value};

use super::comparison::BoundCheck;
use super::{Tested, read, read_positive, too_few};
use crate::expand::label_text;
use crate::measure::{self, Measure, Quantity};
use crate::schema::Direction;
use fathom_record::Cell;

/// More than 1 by the least step: what rises is more than what it rises from.
const ABOVE_ONE: [f64; 2] = [1.0 + f64::EPSILON, f64::INFINITY];

/// Values of which each is compared with all others.
const MAX_COMPARED: usize = 200;

pub(super) fn independent(y: &Measure, over: &str, tolerance: f64, cells: &[&Cell]) -> Tested {
    let readings = labelled(y, over, cells);
    if readings.len() < 2 {
        return Err(too_few(readings.len(), "2 are needed"));
    }
    if readings.len() > MAX_COMPARED {
        let count = readings.len();
        return Err(format!("{count} values: at most {MAX_COMPARED} are compared with each other"));
    }
    let band = [1.0 / (1.0 + tolerance), 1.0 + tolerance];
    let pairs = readings.iter().array_combinations();
    Ok(pairs.map(|[a, b]| quotient(b, a, band)).collect())
}

pub(super) fn ratio(
    y: &Measure,
    over: &str,
    sides: [&Value; 2],
    band: [f64; 2],
    cells: &[&Cell],
) -> Tested {
    let [numerator, denominator] = sides.map(|wanted| {
        let is_side = |cell: &&&Cell| cell.axes.get(over).is_some_and(|l| measure::same(l, wanted));
        Some((wanted.clone(), read(y, cells.iter().find(is_side)?)?))
    });
    let denominator = denominator.filter(|(_, reading)| reading.median() > 0.0);
    let (Some(numerator), Some(denominator)) = (numerator, denominator) else {
        let [over, under] = sides.map(label_text);
        return Err(format!("`{over}` and `{under}` were not both measured"));
    };
    Ok(vec![quotient(&numerator, &denominator, band)])
}

/// A figure of each cell.
pub(super) fn each(y: &Measure, band: [f64; 2], cells: &[&Cell], software: bool) -> Tested {
    let readings = cells.iter().filter_map(|cell| Some((cell.cell.as_str(), read(y, cell)?)));
    let readings: Vec<(&str, Quantity)> = readings.collect();
    if readings.is_empty() {
        return Err("no cell was measured at the size the claim speaks of".to_owned());
    }
    if software && y.is_absolute() {
        let worst = readings.iter().map(|(_, reading)| reading.median()).fold(f64::NAN, f64::min);
        return Err(format!("{worst:.2} {y} here: absolute times count only on hardware"));
    }
    let several = readings.len() > 1;
    let compared = readings.into_iter().map(|(cell, reading)| {
        let name = if several { format!("{y} of {cell}") } else { y.to_string() };
        BoundCheck::new(name, reading, band)
    });
    Ok(compared.collect())
}

pub(super) fn no_worse(
    y: &Measure,
    sides: [&Map<String, Value>; 2],
    margin: f64,
    cells: &[&Cell],
) -> Tested {
    let [of, than] = sides.map(|filter| {
        let cell = cells.iter().find(|cell| measure::fits(cell, filter))?;
        read_positive(y, cell)
    });
    let (Some(of), Some(than)) = (of, than) else {
        return Err(format!("{y} was not recorded in both cells"));
    };
    let name = format!("{y} {:.4} against {:.4}, ratio", of.median(), than.median());
    Ok(vec![BoundCheck::new(name, of.ratio_to(&than), [f64::NEG_INFINITY, 1.0 + margin])])
}

/// Every step goes the claimed way.
pub(super) fn monotone(y: &Measure, x: &Measure, direction: Direction, cells: &[&Cell]) -> Tested {
    let points = points(y, x, cells);
    if points.len() < 3 {
        return Err(too_few(points.len(), "3 are needed"));
    }
    let steps = points.iter().tuple_windows().map(|((x0, y0), (x1, y1))| {
        let (from, to) = match direction {
            Direction::Rising => ((x0, y0), (x1, y1)),
            Direction::Falling => ((x1, y1), (x0, y0)),
        };
        let name = format!("at {} over at {}", to.0, from.0);
        BoundCheck::new(name, to.1.ratio_to(from.1), ABOVE_ONE)
    });
    Ok(steps.collect())
}

pub(super) fn lowest(
    y: &Measure,
    over: &str,
    value: &Value,
    margin: f64,
    cells: &[&Cell],
) -> Tested {
    let (own, others): (Vec<_>, Vec<_>) =
        labelled(y, over, cells).into_iter().partition(|(label, _)| measure::same(label, value));
    let (Some(own), false) = (own.first(), others.is_empty()) else {
        return Err(format!("`{}` and another value were not both measured", label_text(value)));
    };
    let band = [f64::NEG_INFINITY, 1.0 + margin];
    Ok(others.iter().map(|other| quotient(own, other, band)).collect())
}

/// The least of the cells inside the band against every cell outside.
pub(super) fn band(y: &Measure, x: &Measure, [low, high]: [f64; 2], cells: &[&Cell]) -> Tested {
    let points = points(y, x, cells);
    let below = points.iter().any(|(x, _)| *x < low);
    let above = points.iter().any(|(x, _)| *x > high);
    let (inside, outside): (Vec<_>, Vec<_>) =
        points.into_iter().partition(|(x, _)| (low..=high).contains(x));
    if inside.is_empty() || !below || !above {
        return Err(format!("cells within {low} – {high} and on both sides of it are needed"));
    }
    let least = inside.iter().min_by(|a, b| a.1.median().total_cmp(&b.1.median()));
    let compared = outside.iter().flat_map(|(x_outside, y_outside)| {
        least.map(|(x, y)| {
            let name = format!("at {x_outside} over at {x}, the least inside");
            BoundCheck::new(name, y_outside.ratio_to(y), ABOVE_ONE)
        })
    });
    Ok(compared.collect())
}

fn quotient(over: &(Value, Quantity), under: &(Value, Quantity), band: [f64; 2]) -> BoundCheck {
    let name = format!("{} / {}", label_text(&over.0), label_text(&under.0));
    BoundCheck::new(name, over.1.ratio_to(&under.1), band)
}

/// x and y of the cells with a positive y, in the order of x.
fn points(y: &Measure, x: &Measure, cells: &[&Cell]) -> Vec<(f64, Quantity)> {
    let read = |cell: &&Cell| {
        let x = x.read(cell, cell.measured()?)?.median();
        Some((x, read_positive(y, cell)?))
    };
    let points = cells.iter().filter_map(read);
    points.sorted_by(|a, b| a.0.total_cmp(&b.0)).collect()
}

/// The cells with a positive y, each under its label on the axis.
fn labelled(y: &Measure, over: &str, cells: &[&Cell]) -> Vec<(Value, Quantity)> {
    let read = |cell: &&Cell| Some((cell.axes.get(over)?.clone(), read_positive(y, cell)?));
    cells.iter().filter_map(read).collect()
}
