//! Linear and logarithmic axes with ticks at round numbers.

use std::ops::Range;

use itertools::Itertools;
use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};

use crate::format;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ScaleKind {
    Linear,
    Log,
}

impl ScaleKind {
    /// What stands behind an axis' title.
    pub fn name(self) -> &'static str {
        match self {
            ScaleKind::Linear => "linear",
            ScaleKind::Log => "log",
        }
    }
}

/// Smallest height of a scale that does not begin at 0, as a share of its values.
const MIN_SPREAD: f64 = 0.05;

/// Between ticks at measured values, as a share of the axis.
const MIN_TICK_GAP: f64 = 0.13;

/// Data are mapped to an axis' own coordinate: the value, or its decimal logarithm.
#[derive(Clone, Debug, PartialEq)]
pub struct Scale {
    pub kind: ScaleKind,
    pub low: f64,
    pub high: f64,
    ticks: Vec<f64>,
    /// In place of numbers at the ticks.
    names: Vec<String>,
}

/// Coordinates of a plot's axis on pixels.
impl Ranged for Scale {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, coordinate: &f64, limit: (i32, i32)) -> i32 {
        let along = (self.share(*coordinate) * f64::from(limit.1 - limit.0)).round() as i32;
        // What lies far off the axis is off the picture, too.
        limit.0.saturating_add(along)
    }

    fn key_points<Hint: KeyPointHint>(&self, _: Hint) -> Vec<f64> {
        self.ticks.clone()
    }

    fn range(&self) -> Range<f64> {
        self.low..self.high
    }
}

impl ValueFormatter<f64> for Scale {
    fn format(coordinate: &f64) -> String {
        format::si(*coordinate)
    }
}

impl Scale {
    /// A scale that holds all values with room around them; none where no value can be shown.
    pub fn fit(kind: ScaleKind, values: impl IntoIterator<Item = f64>) -> Option<Scale> {
        let shown = |value: &f64| value.is_finite() && (kind == ScaleKind::Linear || *value > 0.0);
        let [low, high] = ends(values.into_iter().filter(shown))?;
        Some(match kind {
            // Quantities of one sign are seen against zero.
            ScaleKind::Linear => Scale::linear(low.min(0.0), high),
            ScaleKind::Log => Scale::log(low, high),
        })
    }

    /// A linear scale about the values, of at least `MIN_SPREAD` of them, so that the eye does not take noise for steps; none
    /// where no value is finite.
    pub fn tight(values: impl IntoIterator<Item = f64>) -> Option<Scale> {
        let [low, high] = ends(values.into_iter().filter(|value| value.is_finite()))?;
        let min_span = MIN_SPREAD * low.abs().max(high.abs());
        let missing = (min_span - (high - low)).max(0.0) / 2.0;
        Some(Scale::linear(low - missing, high + missing))
    }

    /// Ticks at these values, where they are few whole numbers with room between them.
    pub fn with_sizes(self, values: impl IntoIterator<Item = f64>) -> Scale {
        let sizes = values.into_iter().sorted_by(f64::total_cmp).dedup().collect_vec();
        let at = sizes.iter().filter_map(|size| self.coord(*size)).collect_vec();
        let has_room = |(a, b): (&f64, &f64)| self.share(*b) - self.share(*a) > MIN_TICK_GAP;
        let is_whole = sizes.iter().all(|size| size.fract() == 0.0);
        let are_ticks = is_whole && at.len() > 1 && at.iter().tuple_windows().all(has_room);
        if are_ticks { Scale { ticks: at, ..self } } else { self }
    }

    /// A linear scale with names at some places.
    pub fn named([low, high]: [f64; 2], names: impl IntoIterator<Item = (f64, String)>) -> Scale {
        let (ticks, names) = names.into_iter().unzip();
        Scale { kind: ScaleKind::Linear, low, high, ticks, names }
    }

    fn linear(low: f64, high: f64) -> Scale {
        let high = if high > low { high } else { low + 1.0 };
        let step = nice((high - low) / 5.0);
        let first = (low / step).floor() as i64;
        let last = (high / step).ceil() as i64;
        let margin = 0.03 * (high - low);
        let ticks = (first..=last).map(|index| index as f64 * step);
        let ticks = ticks.filter(|tick| (low - margin..=high + margin).contains(tick)).collect();
        let (low, high) = (low - margin, high + margin);
        Scale { kind: ScaleKind::Linear, low, high, ticks, names: Vec::new() }
    }

    fn log(low: f64, high: f64) -> Scale {
        let (low, high) = (low.log10(), high.log10());
        let margin = (0.05 * (high - low)).max(0.06);
        let (low, high) = (low - margin, high + margin);
        let within = |multiples: &[f64]| -> Vec<f64> {
            (low.floor() as i32..=high.floor() as i32)
                .flat_map(|decade| multiples.iter().map(move |m| m.log10() + f64::from(decade)))
                .filter(|tick| (low..=high).contains(tick))
                .collect()
        };
        // The sparsest set of multiples that still gives three ticks; in a narrow range those of a linear scale.
        let choices: [&[f64]; 4] =
            [&[1.0], &[1.0, 3.0], &[1.0, 2.0, 5.0], &[1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0]];
        let ticks = choices.into_iter().map(within).find(|ticks| ticks.len() >= 3);
        let ticks = ticks.unwrap_or_else(|| {
            let ticks = Scale::linear(10_f64.powf(low), 10_f64.powf(high)).ticks.into_iter();
            ticks.map(f64::log10).filter(|tick| (low..=high).contains(tick)).collect()
        });
        Scale { kind: ScaleKind::Log, low, high, ticks, names: Vec::new() }
    }

    /// The coordinate of a value; none for what a logarithm cannot show.
    pub fn coord(&self, value: f64) -> Option<f64> {
        let coordinate = match self.kind {
            ScaleKind::Linear => value,
            ScaleKind::Log => value.log10(),
        };
        coordinate.is_finite().then_some(coordinate)
    }

    /// How far along the axis a coordinate lies, 0 … 1.
    pub fn share(&self, coordinate: f64) -> f64 {
        (coordinate - self.low) / (self.high - self.low)
    }

    pub fn tick_label(&self, coordinate: f64) -> String {
        let named = self.ticks.iter().zip(&self.names);
        if let Some((_, name)) = named.into_iter().find(|(tick, _)| **tick == coordinate) {
            return name.clone();
        }
        let value = match self.kind {
            ScaleKind::Linear if coordinate.abs() < 1e-12 => 0.0,
            ScaleKind::Linear => coordinate,
            ScaleKind::Log => 10_f64.powf(coordinate),
        };
        if (1e3..1e4).contains(&value.abs().round()) {
            return format!("{value:.0}");
        }
        if value != 0.0 && value.abs() < 1e-3 {
            return format!("{value:.1e}").replace(".0e", "e");
        }
        format::si(value)
    }
}

/// The smallest and the largest value.
fn ends(values: impl Iterator<Item = f64>) -> Option<[f64; 2]> {
    values.minmax().into_option().map(<[f64; 2]>::from)
}

/// The smallest of 1, 2, 5 × 10ⁿ that is not below the value.
fn nice(value: f64) -> f64 {
    let decade = 10_f64.powf(value.log10().floor());
    let multiple = [1.0, 2.0, 5.0, 10.0]
        .into_iter()
        .find(|multiple| multiple * decade >= value * (1.0 - 1e-9));
    multiple.unwrap_or(10.0) * decade
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fit(kind: ScaleKind, values: &[f64]) -> Option<Scale> {
        Scale::fit(kind, values.iter().copied())
    }

    #[test]
    fn ticks_are_round_and_enough() {
        for (kind, values, expected) in [
            (ScaleKind::Log, &[100.0, 1e6][..], &["100", "1000", "10 k", "100 k", "1 M"][..]),
            (ScaleKind::Log, &[2.0, 4.0], &["2", "3", "4"]),
            (ScaleKind::Log, &[2000.0, 8200.0], &["2000", "3000", "4000", "6000", "8000"]),
            (ScaleKind::Log, &[4.8, 4.9], &["4.5", "5", "5.5"]),
            (ScaleKind::Linear, &[0.05, 0.21], &["0", "0.05", "0.1", "0.15", "0.2"]),
            (ScaleKind::Linear, &[0.0, 4e-6], &["0", "1e-6", "2e-6", "3e-6", "4e-6"]),
        ] {
            has_ticks(&fit(kind, values).unwrap(), expected);
        }
        // Few whole sizes are the ticks.
        for (sizes, expected) in [
            (&[64.0, 128.0, 256.0, 128.0][..], &["64", "128", "256"][..]),
            (&[4.5, 128.0], &["10", "30", "100"]),
            (&[100.0, 101.0, 1000.0], &["100", "300", "1000"]),
        ] {
            let scale = fit(ScaleKind::Log, sizes).unwrap();
            has_ticks(&scale.with_sizes(sizes.iter().copied()), expected);
        }
    }

    fn has_ticks(scale: &Scale, expected: &[&str]) {
        let labels = scale.ticks.iter().map(|tick| scale.tick_label(*tick));
        assert!(labels.eq(expected.iter().copied()), "{:?}", scale.ticks);
    }

    #[test]
    fn degenerate_ranges_have_ticks() {
        for kind in [ScaleKind::Linear, ScaleKind::Log] {
            let axis = fit(kind, &[3.0]).unwrap();
            assert!(axis.high > axis.low);
            assert!(!axis.ticks.is_empty(), "{kind:?}");
        }
        assert_eq!(fit(ScaleKind::Log, &[0.0, -1.0]), None);
        assert_eq!(fit(ScaleKind::Linear, &[f64::NAN]), None);
    }
}
