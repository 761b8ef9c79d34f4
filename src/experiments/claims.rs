//! Claims against records: *supported*, *contradicted*, or *untestable here* with the reason.
//!
//! A verdict rests on intervals. A figure whose whole 95 % interval lies inside the claimed band supports the claim, one
//! whose interval lies outside contradicts it, and one that straddles the edge decides nothing.

mod comparisons;
mod fits;

use indexmap::IndexMap;
use strum::Display;

use super::expand::label_text;
use super::measure::{self, Measure};
use super::schema::{Claim, Experiment, Test};
use crate::record::{Cell, Estimate};

pub use fits::{Scaling, scaling};

#[derive(Clone, Copy, Debug, PartialEq, Eq, Display)]
#[strum(serialize_all = "lowercase")]
pub enum Verdict {
    Supported,
    Contradicted,
    #[strum(to_string = "untestable here")]
    Untestable,
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

/// Groups of cells that a claim is tested on; nobody reads the findings of more.
const MOST_GROUPS: usize = 200;

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
                Ruling { id: claim.id.clone(), text: claim.text.clone(), verdict, reason }
            })
            .collect()
    }
}

fn rule(claim: &Claim, cells: &[&Cell], software: bool) -> Finding {
    let fitting = |cell: &&Cell| measure::fits(cell, &claim.filter);
    let cells: Vec<&Cell> = cells.iter().copied().filter(fitting).collect();
    match claim.test.over() {
        Some(over) => by_group(&claim.test, over, &cells, software),
        None => rule_group(&claim.test, &cells, software),
    }
}

/// Rules on each group of cells that differ in the claim's axis only, and joins the findings: one contradiction contradicts,
/// one undecided group leaves the whole undecided.
fn by_group(test: &Test, over: &str, cells: &[&Cell], software: bool) -> Finding {
    let groups = groups(cells, over);
    if groups.is_empty() {
        return untestable(format!("no cell along `{over}`"));
    }
    if groups.len() > MOST_GROUPS {
        return untestable(format!(
            "{} groups of cells along `{over}` are more than the {MOST_GROUPS} that are tested: use `where`",
            groups.len()
        ));
    }
    let several = groups.len() > 1;
    let findings: Vec<Finding> = groups
        .iter()
        .map(|(name, group)| {
            let (verdict, reason) = rule_group(test, group, software);
            let prefix = if several { format!("{name}: ") } else { String::new() };
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
    let mut groups = IndexMap::<String, Vec<&Cell>>::new();
    for cell in cells.iter().filter(|cell| cell.axes.contains_key(over)) {
        let others: Vec<String> = cell
            .axes
            .iter()
            .filter(|(name, _)| *name != over)
            .map(|(name, value)| format!("{name}={}", label_text(value)))
            .collect();
        groups.entry(others.join(", ")).or_default().push(cell);
    }
    groups.into_iter().collect()
}

fn rule_group(test: &Test, cells: &[&Cell], software: bool) -> Finding {
    match test {
        Test::AtLeast { y, value } => comparisons::at_least(y, *value, cells, software),
        Test::Within { y, low, high } => comparisons::inside(y, [*low, *high], cells, software),
        Test::NoWorse { y, of, than, margin } => {
            comparisons::no_worse(y, [of, than], *margin, cells)
        }
        Test::Slope { y, x, expected, tolerance, max_fixed_share, min_decades, .. } => {
            match scaling(y, x, cells, *max_fixed_share) {
                Ok(fit) => fits::slope(&fit, *expected, *tolerance, *min_decades),
                Err(reason) => untestable(reason),
            }
        }
        Test::Affine { y, x, tolerance, min_rising_share, .. } => {
            fits::affine(y, x, *tolerance, *min_rising_share, cells)
        }
        Test::Independent { y, over, tolerance } => {
            comparisons::independent(y, over, *tolerance, cells)
        }
        Test::Ratio { y, over, numerator, denominator, low, high } => {
            comparisons::ratio(y, over, [numerator, denominator], [*low, *high], cells)
        }
        Test::Monotone { y, x, direction, tolerance, .. } => {
            comparisons::monotone(y, x, *direction, *tolerance, cells)
        }
        Test::Lowest { y, over, value, margin } => {
            comparisons::lowest(y, over, value, *margin, cells)
        }
        Test::Minimum { y, x, low, high, .. } => comparisons::minimum(y, x, [*low, *high], cells),
    }
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
    let interval = Interval { low: ratio * (-down).exp(), high: ratio * up.exp() };
    (ratio, interval)
}

fn read_positive(y: &Measure, cell: &Cell) -> Option<Estimate> {
    let estimate = y.read(cell, cell.measured()?)?.estimate;
    (estimate.low > 0.0 && estimate.high.is_finite()).then_some(estimate)
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

fn too_few(count: usize, needed: &str) -> String {
    let cells = if count == 1 { "cell" } else { "cells" };
    format!("{count} measured {cells}, and {needed}")
}

#[cfg(test)]
mod tests;
