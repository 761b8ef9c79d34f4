//! What a claim asserts, and how it is tested.

use serde::Deserialize;
use serde_json::{Map, Value};

use super::super::{ClaimOrigin, Measure};
use super::named::Named;

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
    pub balance: Option<Balance>,
    /// Axis or parameter → value; all must hold.
    #[serde(default, rename = "where")]
    pub filter: Map<String, Value>,
    /// The experiment's [`Experiment::method`](super::Experiment::method), for a claim with a source: it is tested on no other cells.
    #[serde(skip)]
    pub method: Map<String, Value>,
    /// Why this experiment cannot decide the publication's sentence. The claim is then *not run*, whatever was measured.
    pub not_run: Option<String>,
    /// Why it does not hold where it is contradicted, once that was found.
    pub cause: Option<Cause>,
    pub test: Test,
}

/// What a contradicted claim is retraced to.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Cause {
    /// A software driver runs on a CPU. Told of such adapters only.
    Hardware(String),
    /// The publication's own slip, or a choice that it does not tell.
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
    Affine { y: Measure, x: Measure, over: String, tolerance: f64 },
    /// The same along the axis, up to a factor of `1 + tolerance` between the largest and the smallest.
    Independent { y: Measure, over: String, tolerance: f64 },
    /// `y` at one value of the axis over `y` at another lies within `low … high`.
    Ratio { y: Measure, over: String, numerator: Value, denominator: Value, low: f64, high: f64 },
    /// Every cell reaches the value.
    AtLeast { y: Measure, value: f64 },
    /// Every cell lies within `low … high`.
    Within { y: Measure, low: f64, high: f64 },
    /// `y` in the cell `of` is at most `1 + margin` times that in the cell `than`.
    NoWorse {
        y: Measure,
        of: Map<String, Value>,
        than: Map<String, Value>,
        #[serde(default)]
        margin: f64,
    },
    /// Rises (or falls) along the axis in order of `x`, at every step.
    Monotone { y: Measure, x: Measure, over: String, direction: Direction },
    /// `y` at `value` is at most `1 + margin` times that at every other value of the axis.
    Lowest {
        y: Measure,
        over: String,
        value: Value,
        #[serde(default)]
        margin: f64,
    },
    /// The least `y` lies at an x within `low … high`; cells must lie on both sides of the band.
    Band { y: Measure, x: Measure, over: String, low: f64, high: f64 },
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Direction {
    Rising,
    Falling,
}

/// A tenth: over the decade above it, a fixed cost bends a slope of 1 to 0.96 at worst.
pub const FIXED_SHARE: f64 = 0.1;

/// Least share of k x in the largest cell's y, for a line that hardly rises tells nothing of linearity. Half: what is fixed is then at most as much as what grows.
pub const RISING_SHARE: f64 = 0.5;

impl Test {
    /// The axis along which cells are compared.
    pub fn over(&self) -> Option<&str> {
        match self {
            Test::Slope { over, .. }
            | Test::Affine { over, .. }
            | Test::Independent { over, .. }
            | Test::Ratio { over, .. }
            | Test::Monotone { over, .. }
            | Test::Lowest { over, .. }
            | Test::Band { over, .. } => Some(over),
            Test::AtLeast { .. } | Test::Within { .. } | Test::NoWorse { .. } => None,
        }
    }

    /// What is tested.
    pub fn y(&self) -> &Measure {
        match self {
            Test::Slope { y, .. }
            | Test::Affine { y, .. }
            | Test::Monotone { y, .. }
            | Test::Band { y, .. }
            | Test::Independent { y, .. }
            | Test::Ratio { y, .. }
            | Test::AtLeast { y, .. }
            | Test::Within { y, .. }
            | Test::NoWorse { y, .. }
            | Test::Lowest { y, .. } => y,
        }
    }

    pub(super) fn measures(&self) -> Vec<&Measure> {
        match self {
            Test::Slope { y, x, .. }
            | Test::Affine { y, x, .. }
            | Test::Monotone { y, x, .. }
            | Test::Band { y, x, .. } => vec![y, x],
            _ => vec![self.y()],
        }
    }
}
