//! Linear and logarithmic axes with ticks at round numbers.

use std::ops::Range;

use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};

use crate::format;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ScaleKind {
    Linear,
    Log,
}

/// Least height of a scale that does not begin at 0, as a share of its values.
const LEAST_SPREAD: f64 = 0.05;

/// An axis. Data are mapped to its own coordinate: the value, or its decimal logarithm.
#[derive(Clone, Debug, PartialEq)]
pub struct Scale {
    kind: ScaleKind,
    pub low: f64,
    pub high: f64,
    ticks: Vec<f64>,
}

/// Coordinates of the axis on pixels.
impl Ranged for Scale {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, coordinate: &f64, limit: (i32, i32)) -> i32 {
        let share = (coordinate - self.low) / (self.high - self.low);
        let along = (share * f64::from(limit.1 - limit.0)).round() as i32;
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
    pub fn fit(kind: ScaleKind, values: impl Iterator<Item = f64>) -> Option<Scale> {
        let shown = |value: &f64| value.is_finite() && (kind == ScaleKind::Linear || *value > 0.0);
        let values: Vec<f64> = values.filter(shown).collect();
        let low = values.iter().copied().reduce(f64::min)?;
        let high = values.iter().copied().reduce(f64::max)?;
        Some(match kind {
            ScaleKind::Linear => Scale::linear(low, high),
            ScaleKind::Log => Scale::log(low, high),
        })
    }

    /// A linear scale about the values, of at least [`LEAST_SPREAD`] of them, so that the eye does not take noise for steps; none
    /// where no value is finite.
    pub fn tight(values: impl Iterator<Item = f64>) -> Option<Scale> {
        let values: Vec<f64> = values.filter(|value| value.is_finite()).collect();
        let low = values.iter().copied().reduce(f64::min)?;
        let high = values.iter().copied().reduce(f64::max)?;
        let least = LEAST_SPREAD * low.abs().max(high.abs());
        let missing = (least - (high - low)).max(0.0) / 2.0;
        Some(Scale::between(low - missing, high + missing))
    }

    fn linear(low: f64, high: f64) -> Scale {
        // Quantities of one sign are seen against zero.
        Scale::between(low.min(0.0), high)
    }

    fn between(low: f64, high: f64) -> Scale {
        let high = if high > low { high } else { low + 1.0 };
        let step = nice((high - low) / 5.0);
        let first = (low / step).floor() as i64;
        let last = (high / step).ceil() as i64;
        let margin = 0.03 * (high - low);
        Scale {
            kind: ScaleKind::Linear,
            low: low - margin,
            high: high + margin,
            ticks: (first..=last)
                .map(|index| index as f64 * step)
                .filter(|tick| (low - margin..=high + margin).contains(tick))
                .collect(),
        }
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
        // The sparsest set of multiples that still gives three ticks.
        let choices: [&[f64]; 4] =
            [&[1.0], &[1.0, 3.0], &[1.0, 2.0, 5.0], &[1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0]];
        let ticks = choices
            .iter()
            .map(|multiples| within(multiples))
            .find(|ticks| ticks.len() >= 3)
            .unwrap_or_else(|| within(choices[3]));
        Scale { kind: ScaleKind::Log, low, high, ticks }
    }

    /// What stands behind an axis' title.
    pub fn name(&self) -> &'static str {
        match self.kind {
            ScaleKind::Linear => "linear",
            ScaleKind::Log => "log",
        }
    }

    /// The coordinate of a value; none for what a logarithm cannot show.
    pub fn at(&self, value: f64) -> Option<f64> {
        let coordinate = match self.kind {
            ScaleKind::Linear => value,
            ScaleKind::Log => value.log10(),
        };
        coordinate.is_finite().then_some(coordinate)
    }

    /// Coordinates of the ticks.
    pub fn ticks(&self) -> &[f64] {
        &self.ticks
    }

    pub fn tick_label(&self, coordinate: f64) -> String {
        let value = match self.kind {
            ScaleKind::Linear if coordinate.abs() < 1e-12 => 0.0,
            ScaleKind::Linear => coordinate,
            ScaleKind::Log => 10_f64.powf(coordinate),
        };
        if (1e3..1e4).contains(&value.abs().round()) {
            return format!("{value:.0}");
        }
        format::si(value)
    }
}

/// The least of 1, 2, 5 × 10ⁿ that is not below the value.
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

    fn labels(scale: &Scale) -> Vec<String> {
        scale.ticks.iter().map(|tick| scale.tick_label(*tick)).collect()
    }

    #[test]
    fn ticks_are_round_and_enough() {
        let decades = Scale::fit(ScaleKind::Log, [100.0, 1e6].into_iter()).unwrap();
        assert_eq!(labels(&decades), ["100", "1000", "10 k", "100 k", "1 M"]);
        let narrow = Scale::fit(ScaleKind::Log, [2.0, 4.0].into_iter()).unwrap();
        assert_eq!(labels(&narrow), ["2", "3", "4"]);
        let linear = Scale::fit(ScaleKind::Linear, [0.05, 0.21].into_iter()).unwrap();
        assert_eq!(labels(&linear), ["0", "0.05", "0.1", "0.15", "0.2"]);
    }

    #[test]
    fn degenerate_ranges_have_ticks() {
        for kind in [ScaleKind::Linear, ScaleKind::Log] {
            let scale = Scale::fit(kind, [3.0].into_iter()).unwrap();
            assert!(scale.high > scale.low);
            assert!(!scale.ticks.is_empty(), "{kind:?}");
        }
        assert_eq!(Scale::fit(ScaleKind::Log, [0.0, -1.0].into_iter()), None);
        assert_eq!(Scale::fit(ScaleKind::Linear, [f64::NAN].into_iter()), None);
    }
}
