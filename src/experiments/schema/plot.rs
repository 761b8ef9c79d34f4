//! What a plot of an experiment shows.

use serde::Deserialize;
use serde_json::{Map, Value};

use super::super::Measure;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PlotKind {
    /// Both axes logarithmic, with fitted exponents. Cells over categories are dots that no line joins.
    Scaling,
    /// Both axes linear. Cells over categories are dots that no line joins.
    Lines,
    /// Stage times stacked per cell.
    Stacked,
    /// A bar per cell, those of one value of `over` together, or those that differ in `colors` alone.
    Bars,
}

/// One panel of the experiment's figure.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plot {
    pub title: String,
    pub kind: PlotKind,
    /// Cells without this axis are left out, and so are those without one of the two below.
    pub over: Option<String>,
    /// Of bars: the axis whose values have a colour each, in place of `over`.
    pub colors: Option<String>,
    /// Of lines: axes with a small chart for each combination of their values.
    #[serde(default)]
    pub panels: Vec<String>,
    #[serde(default, rename = "where")]
    pub filter: Map<String, Value>,
    /// Abscissa of scaling and line plots.
    pub x: Option<Measure>,
    pub x_title: Option<String>,
    /// Ordinates of scaling and line plots; the one measure of bars; stacked ones show every stage.
    #[serde(default)]
    pub y: Vec<Measure>,
    /// Label of the ordinate, whose values are then those of the record (times in ms); the measure in words where absent, and its
    /// values in the unit that is shown.
    pub y_title: Option<String>,
}

impl Plot {
    /// Names of the axes that it speaks of.
    pub fn axes(&self) -> impl Iterator<Item = &str> {
        self.over.iter().chain(&self.colors).chain(&self.panels).map(String::as_str)
    }

    pub(super) fn check(&self) -> Result<(), &'static str> {
        match self.kind {
            PlotKind::Scaling | PlotKind::Lines if self.x.is_none() || self.y.is_empty() => {
                Err("needs x and y")
            }
            PlotKind::Bars if self.over.is_some() == self.colors.is_some() || self.y.len() != 1 => {
                Err("of bars needs one y, and either over or colors")
            }
            _ => Ok(()),
        }
    }
}
