//! What a claim asserts, and how it is tested.

use std::collections::BTreeMap;

use serde::Deserialize;
use serde_json::{Map, Value};

use super::super::{ClaimOrigin, Measure, fits, same};
use super::earlier;
use super::named::Named;
use crate::expand::label_text;
use fathom_base::text;
use fathom_record::Cell;

#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Claim {
    #[serde(default)]
    pub id: String,
    pub text: String,
    /// Whose sentence it is: publication, section and item, such as `SPT §4, Table 1`. None: a hypothesis of this project, or of the user.
    pub source: Option<String>,
    /// The publication's words. Where they hold no number, the bound is our own.
    pub printed: Option<String>,
    /// The same in the unit of what is tested, such as the ratio of two times.
    pub published: Option<f64>,
    /// What else could make the claim true, and how the test rules that out.
    #[serde(default)]
    pub otherwise: String,
    /// What would turn it where it is supported.
    #[serde(default)]
    pub broken_by: Fault,
    pub balance: Option<Balance>,
    /// Axis or parameter → value; all must hold.
    #[serde(default, rename = "where")]
    pub filter: Map<String, Value>,
    /// Axis → values: the claim stands for one at each of them, with a verdict of its own.
    #[serde(default)]
    pub each: BTreeMap<String, Vec<Value>>,
    /// Of the cells along an axis only the one of least error is tested.
    pub least: Option<Least>,
    /// The experiment's [`Experiment::method`](super::Experiment::method), for a claim with a source: it is tested on no other cells.
    #[serde(skip)]
    pub method: Map<String, Value>,
    /// Why this experiment cannot decide the publication's sentence. The claim is then *not run*, whatever was measured.
    pub not_run: Option<String>,
    /// Why it does not hold where it is contradicted, once that was found.
    pub cause: Option<Cause>,
    #[serde(deserialize_with = "earlier::test")]
    pub test: Test,
}

/// What is put into a shader or into the cells' parameters so that a supported claim is supported no longer. Of a claim on times it is
/// words alone.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fault {
    pub what: String,
    /// Names of the cells that decide.
    #[serde(default)]
    pub cells: Vec<String>,
    /// Parameters of these cells, none of which an axis sets.
    #[serde(default)]
    pub set: Map<String, Value>,
    /// Path of a shader without its ending, and what stands once in it, with what is put there.
    #[serde(default)]
    pub shader: String,
    #[serde(default)]
    pub line: [String; 2],
}

impl Fault {
    /// Whether it is tried.
    pub fn is_tried(&self) -> bool {
        !(self.set.is_empty() && self.shader.is_empty())
    }
}

/// The cell along an axis in which a figure is least.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Least {
    pub y: Measure,
    pub over: String,
}

/// What a contradicted claim is retraced to.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Cause {
    /// A software driver runs on a CPU. Reported for such adapters only.
    Hardware(String),
    /// The publication's own slip, or a choice that it does not state.
    Paper(String),
}

/// At which sizes a claim may be tested.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(try_from = "String")]
pub enum Balance {
    /// Only where triangles, pixels, voxels and photons are to each other as in the publication: see
    /// [`Experiment::balance`](super::Experiment::balance).
    Published,
    /// At any, for this reason.
    Free(String),
}

impl TryFrom<String> for Balance {
    type Error = String;

    fn try_from(text: String) -> Result<Balance, String> {
        match text.split_once(':') {
            None if text == "published" => Ok(Balance::Published),
            Some(("free", reason)) if !reason.trim().is_empty() => {
                Ok(Balance::Free(reason.trim().to_owned()))
            }
            _ => Err(format!("balance `{text}`: write `published`, or `free: REASON`")),
        }
    }
}

impl Named for Claim {
    fn set_name(&mut self, name: String) {
        self.id = name;
    }
}

impl Claim {
    /// One claim for each value of `each`; itself without.
    pub(super) fn expanded(self) -> Vec<Claim> {
        let Some((axis, values)) = self.each.first_key_value() else { return vec![self] };
        let at = |value: &Value| {
            let label = label_text(value);
            let mut filter = self.filter.clone();
            filter.insert(axis.clone(), value.clone());
            let id = format!("{}-{}", self.id, text::file_stem(&label));
            let text = format!("{} ({axis} {label})", self.text);
            Claim { id, text, filter, each: BTreeMap::new(), ..self.clone() }
        };
        values.iter().map(at).collect()
    }

    pub fn origin(&self) -> ClaimOrigin {
        if self.source.is_some() { ClaimOrigin::Publication } else { ClaimOrigin::Own }
    }

    /// Whether the publication prints a number that the figure is held against. Otherwise the bound is our own, and so it is where the
    /// number is said to be about right: how far the figure may be from it is then our choice.
    pub fn has_printed_bound(&self) -> bool {
        let is_number = |word: &str| {
            let word = word.trim_matches(|c: char| !c.is_ascii_alphanumeric());
            word.starts_with(|c: char| c.is_ascii_digit()) && word.parse::<f64>().is_ok()
        };
        let printed = self.printed.as_deref().unwrap_or_default();
        let prints_number = self.published.is_some() || printed.split([' ', '/']).any(is_number);
        self.source.is_some() && prints_number && !printed.contains("about")
    }
}

/// How a claim is tested. `over` names the axis along which cells are compared; cells that differ in another axis
/// are tested apart, and every group must pass.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Test {
    /// `y ∝ x^expected`, by a straight line through the logarithms.
    Slope {
        y: Measure,
        x: Measure,
        over: String,
        expected: f64,
        tolerance: f64,
        /// Cells in which the fixed cost (an affine fit's) is a greater share of the time are left out; [`FIXED_SHARE`] where absent.
        max_fixed_share: Option<f64>,
    },
    /// `y = F + k x` with k > 0, k x at least [`RISING_SHARE`] of the largest cell's y: no cell is off the fitted line by more than `tolerance` of its own y.
    Affine {
        y: Measure,
        x: Measure,
        over: String,
        tolerance: f64,
    },
    Ratio(Ratio),
    EqualTime(EqualTime),
    /// Every cell lies within `low … high`.
    Within {
        y: Measure,
        #[serde(default = "no_low")]
        low: f64,
        #[serde(default = "no_high")]
        high: f64,
    },
    /// Rises (or falls) along the axis in order of `x`, at every step.
    Monotone {
        y: Measure,
        x: Measure,
        over: String,
        direction: Direction,
    },
    /// The smallest `y` lies at an x within `low … high`; cells must lie on both sides of the band.
    Band {
        y: Measure,
        x: Measure,
        over: String,
        low: f64,
        high: f64,
    },
}

/// `y` in one cell over `y` in another lies within `low … high`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ratio {
    pub y: Measure,
    /// Without it, numerator and denominator are tables (axis or parameter → value) that fit one cell each.
    pub over: Option<String>,
    /// Value of the axis. Without it, each two cells along the axis are compared: they differ by a factor of at most `high`.
    pub numerator: Option<Value>,
    /// Value of the axis. Without it, every other value is a denominator.
    pub denominator: Option<Value>,
    #[serde(default = "no_low")]
    pub low: f64,
    #[serde(default = "no_high")]
    pub high: f64,
}

/// At these shares of a cell's time, `y` at one value of an axis is at most that at each other value. The other cells of a value are its sizes:
/// between two of them `y` is interpolated over time, both in logarithms, and a greater time allows what a smaller one gives.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EqualTime {
    pub y: Measure,
    pub time: Measure,
    pub over: String,
    pub numerator: Value,
    /// Axis or parameter → value: the cell whose time is shared out.
    pub of: Map<String, Value>,
    pub shares: Vec<f64>,
}

fn no_low() -> f64 {
    f64::NEG_INFINITY
}

fn no_high() -> f64 {
    f64::INFINITY
}

impl Ratio {
    /// Whether this numerator or denominator names the cell.
    pub fn names(&self, side: &Value, cell: &Cell) -> bool {
        match &self.over {
            Some(over) => cell.axes.get(over).is_some_and(|value| same(value, side)),
            None => side.as_object().is_some_and(|filter| fits(cell, filter)),
        }
    }

    /// Whether the cell is compared with another.
    pub fn covers(&self, cell: &Cell) -> bool {
        match [&self.numerator, &self.denominator] {
            [Some(over), Some(under)] => self.names(over, cell) || self.names(under, cell),
            _ => self.over.as_ref().is_some_and(|over| cell.axes.contains_key(over)),
        }
    }

    pub(super) fn check(&self) -> Result<(), &'static str> {
        let Ratio { over, numerator, denominator, low, high, .. } = self;
        let are_tables =
            [numerator, denominator].iter().all(|side| matches!(side, Some(Value::Object(_))));
        if over.is_none() && !are_tables {
            return Err("needs `over`, or a numerator and a denominator that are tables");
        }
        let is_half = denominator.is_some() || low.is_finite() || high.is_infinite();
        if numerator.is_none() && is_half {
            return Err("without a numerator needs `high`, and neither `low` nor a denominator");
        }
        Ok(())
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Direction {
    Rising,
    Falling,
}

/// A tenth: over the decade above it, a fixed cost bends a slope of 1 to 0.96 at worst.
pub const FIXED_SHARE: f64 = 0.1;

/// Smallest share of k x in the largest cell's y, for a line that hardly rises tells nothing of linearity. Half: what is fixed is then at most as much as what grows.
pub const RISING_SHARE: f64 = 0.5;

impl Test {
    /// The axis along which cells are compared.
    pub fn over(&self) -> Option<&str> {
        match self {
            Test::Slope { over, .. }
            | Test::Affine { over, .. }
            | Test::Monotone { over, .. }
            | Test::Band { over, .. } => Some(over),
            Test::Ratio(ratio) => ratio.over.as_deref(),
            Test::EqualTime(_) | Test::Within { .. } => None,
        }
    }

    /// What is tested.
    pub fn y(&self) -> &Measure {
        match self {
            Test::Slope { y, .. }
            | Test::Affine { y, .. }
            | Test::Monotone { y, .. }
            | Test::Band { y, .. }
            | Test::Ratio(Ratio { y, .. })
            | Test::EqualTime(EqualTime { y, .. })
            | Test::Within { y, .. } => y,
        }
    }

    pub(crate) fn measures(&self) -> Vec<&Measure> {
        match self {
            Test::Slope { y, x, .. }
            | Test::Affine { y, x, .. }
            | Test::Monotone { y, x, .. }
            | Test::Band { y, x, .. } => vec![y, x],
            Test::EqualTime(EqualTime { y, time, .. }) => vec![y, time],
            _ => vec![self.y()],
        }
    }
}
