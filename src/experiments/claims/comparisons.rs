//! Cells compared with each other and with bounds.

use itertools::Itertools;
use serde_json::Value;

use super::evidence::BoundCheck;
use super::{Tested, read, read_positive, too_few};
use crate::expand::label_text;
use crate::measure::{Measure, Quantity};
use crate::schema::{Direction, Ratio};
use fathom_record::Cell;

/// More than 1 by the smallest step: what rises is more than what it rises from.
const ABOVE_ONE: [f64; 2] = [1.0 + f64::EPSILON, f64::INFINITY];

/// Values of which each is compared with all others.
const MAX_COMPARED: usize = 200;

pub(super) fn ratio(test: &Ratio, cells: &[&Cell]) -> Tested {
    let sides = cells.iter().filter_map(|cell| Some((*cell, read(&test.y, cell)?))).collect_vec();
    let names = |side: &Value, index: usize| test.names(side, sides[index].0);
    let is_positive = |index: &usize| sides[*index].1.median() > 0.0;
    let is_over = |index: &usize| match &test.numerator {
        Some(numerator) => names(numerator, *index),
        None => is_positive(index),
    };
    let is_under = |index: &usize| match &test.denominator {
        Some(denominator) => names(denominator, *index),
        None => test.numerator.is_none() || !is_over(index),
    };
    if test.numerator.is_none() && sides.len() > MAX_COMPARED {
        let count = sides.len();
        return Err(format!("{count} values: at most {MAX_COMPARED} are compared with each other"));
    }
    // Without a numerator either cell of two may be the larger.
    let low = test.numerator.as_ref().map_or(1.0 / test.high, |_| test.low);
    let over = (0..sides.len()).filter(is_over);
    let under = (0..sides.len()).filter(is_under).filter(is_positive);
    let pairs = under.cartesian_product(over);
    let quotients = pairs.filter(|(under, over)| test.numerator.is_some() || under < over).map(
        |(under, over)| {
            let [(over, y_over), (under, y_under)] = [over, under].map(|index| &sides[index]);
            let name = match &test.over {
                Some(axis) => [over, under].map(|cell| label_text(&cell.axes[axis])).join(" / "),
                None => {
                    let [over, under] = [y_over, y_under].map(Quantity::median);
                    format!("{} {over:.4} against {under:.4}, ratio", test.y)
                }
            };
            BoundCheck::new(name, y_over.ratio_to(y_under), [low, test.high])
        },
    );
    let quotients = quotients.collect_vec();
    match (&test.numerator, &test.denominator) {
        _ if !quotients.is_empty() => Ok(quotients),
        (None, _) => Err(too_few(sides.len(), "2 are needed")),
        _ if test.over.is_none() => Err(format!("{} was not recorded in both cells", test.y)),
        (Some(over), under) => {
            let another = || "another value".to_owned();
            let under =
                under.as_ref().map_or_else(another, |side| format!("`{}`", label_text(side)));
            Err(format!("`{}` and {under} were not both measured", label_text(over)))
        }
    }
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

/// Every step rises, or every step falls.
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

/// The smallest y inside the band against that of every cell outside.
pub(super) fn band(y: &Measure, x: &Measure, [low, high]: [f64; 2], cells: &[&Cell]) -> Tested {
    let points = points(y, x, cells);
    let below = points.iter().any(|(x, _)| *x < low);
    let above = points.iter().any(|(x, _)| *x > high);
    let (inside, outside): (Vec<_>, Vec<_>) =
        points.into_iter().partition(|(x, _)| (low..=high).contains(x));
    if inside.is_empty() || !below || !above {
        return Err(format!("cells within {low} – {high} and on both sides of it are needed"));
    }
    let lowest = inside.iter().min_by(|a, b| a.1.median().total_cmp(&b.1.median()));
    let compared = outside.iter().flat_map(|(x_outside, y_outside)| {
        lowest.map(|(x, y)| {
            let name = format!("at {x_outside} over at {x}, the least inside");
            BoundCheck::new(name, y_outside.ratio_to(y), ABOVE_ONE)
        })
    });
    Ok(compared.collect())
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

#[cfg(test)]
mod tests {
    use super::super::Verdict::{Contradicted, NearBound, NotRun, Supported};
    use super::super::tests::{RISING, all_ruled, but, ruled, swept};

    #[test]
    fn ratios_lie_within_their_band_or_do_not() {
        let test = r#"ratio = { y = "stage:s", over = "n", numerator = 2, denominator = 1, low = 1.05, high = 2.0 }"#;
        let at = |ratio: f64| swept(&[1.0, 2.0], move |n| if n > 1.0 { 5.0 * ratio } else { 5.0 });
        all_ruled(
            test,
            [
                ("inside", at(1.5), Supported, ""),
                ("below", at(0.9), Contradicted, ""),
                ("above", at(2.4), Contradicted, ""),
                ("at the edge", at(1.05), NearBound, "the bound"),
                ("one cell", at(1.5)[..1].to_vec(), NotRun, "^`2` and `1` were not both measured$"),
            ],
        );
    }

    #[test]
    fn ratios_without_a_denominator_compare_each_value_and_without_a_numerator_each_two() {
        let errors = |of: [f64; 3]| swept(&[1.0, 2.0, 3.0], move |n| of[n as usize - 1]);
        let lowest = r#"ratio = { y = "quantity:error", over = "n", numerator = 2, high = 1.0 }"#;
        let nearest = "2.0 / 3.0 0.500 against at most 1 (the nearest to its bound of 2)";
        let cases = [
            ("lowest", errors([0.4, 0.1, 0.2]), Supported, nearest),
            ("not the lowest", errors([0.4, 0.1, 0.09]), Contradicted, ""),
            ("one cell", swept(&[1.0], |_| 0.4), NotRun, "^`2` and another value were"),
        ];
        all_ruled(lowest, cases);
        let alike = || swept(&[1.0, 2.0, 4.0], |_| 5.0);
        let cases = [
            ("alike", alike(), Supported, "of 3)$"),
            ("one apart", but(1, 2.0, 7.0, alike()), Contradicted, ""),
            ("one cell", alike()[..1].to_vec(), NotRun, "^1 measured cell, and 2 are needed$"),
        ];
        all_ruled(r#"ratio = { y = "stage:s", over = "n", high = 1.15 }"#, cases);
    }

    #[test]
    fn tables_name_the_two_cells_of_a_ratio() {
        let test = r#"ratio = { y = "quantity:error", numerator = { n = 2 }, denominator = { n = 1 }, high = 1.0 }"#;
        let better = || swept(&[1.0, 2.0], |n| 1.0 / n);
        let cases = [
            ("better", better(), Supported, "^error 0.5000 against 1.0000, ratio 0.500 "),
            ("worse", swept(&[1.0, 2.0], |n| n), Contradicted, ""),
            ("one cell", better()[..1].to_vec(), NotRun, "^error was not recorded in both cells$"),
        ];
        all_ruled(test, cases);
    }

    #[test]
    fn monotony_flips_with_one_cell_out_of_order() {
        let rising = || swept(&[1.0, 2.0, 3.0, 4.0], |n| n);
        all_ruled(&RISING.replace("rising", "falling"), [("rising", rising(), Contradicted, "")]);
        let bent = but(2, 3.0, 1.0, rising());
        all_ruled(RISING, [("rising", rising(), Supported, ""), ("bent", bent, Contradicted, "")]);
    }

    #[test]
    fn the_least_value_lies_within_a_band_or_does_not() {
        let test =
            r#"band = { y = "quantity:error", x = "axis:n", over = "n", low = 0.2, high = 0.8 }"#;
        let values = [0.05, 0.2, 0.5, 0.8, 0.95];
        let around = |best: f64| swept(&values, move |n| 0.1 + (n - best).powi(2));
        // One outside errs less than some within, and one less than all.
        let some = but(4, 0.95, 0.15, around(0.5));
        let all = but(4, 0.95, 0.05, around(0.5));
        all_ruled(
            test,
            [
                ("inside", around(0.5), Supported, "the nearest to its bound of 2"),
                ("outside", around(0.95), Contradicted, ""),
                ("less than some", some, Supported, "at 0.95 over at 0.5"),
                ("less than all", all, Contradicted, "at 0.95 over at 0.5"),
                ("one-sided", around(0.5)[..4].to_vec(), NotRun, ""),
            ],
        );
        // Times of 3 % noise that do not differ.
        let timed = test.replace("quantity:error", "stage:s");
        all_ruled(&timed, [("alike", swept(&values, |_| 5.0), NearBound, "")]);
    }

    #[test]
    fn absolute_rates_count_only_on_hardware() {
        let test = r#"within = { y = "fps", low = 60 }"#;
        let [fast, slow] = [5.0, 50.0].map(|ms| swept(&[1.0], |_| ms));
        assert_eq!(ruled(test, &fast, false).0, Supported);
        all_ruled(test, [("fast", fast, NotRun, "only on hardware")]);
        assert_eq!(ruled(test, &slow, false).0, Contradicted);
    }

    #[test]
    fn quotients_of_a_cell_lie_within_a_band_or_do_not() {
        let test = r#"within = { y = "quantity:error per axis:n", low = 7.0, high = 9.0 }"#;
        let eight = swept(&[1.0, 2.0, 5.0], |n| 8.0 * n);
        let other = but(1, 2.0, 10.0, eight.clone());
        let timed = r#"within = { y = "stage:s per axis:n", low = 1.0, high = 2.0 }"#;
        all_ruled(timed, [("timed", other.clone(), NotRun, "only on hardware")]);
        all_ruled(
            test,
            [
                ("inside", eight, Supported, "8.000 against 7 – 9"),
                ("none", swept(&[1.0, 2.0], |_| 0.0), Contradicted, "0.000 against 7 – 9"),
                ("one outside", other, Contradicted, ""),
            ],
        );
    }
}
