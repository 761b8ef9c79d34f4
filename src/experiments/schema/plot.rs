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
    /// A bar per cell, those of one value of `over` together.
    Bars,
    /// Of each group of cells `y` at the numerator's value of `over` over `y` at the denominator's, with its interval and the bands
    /// of the claims about it.
    Ratios,
    /// A colour and a number per cell over two named axes, a panel for each value of others.
    Map,
}

/// One panel of the experiment's figure.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plot {
    pub title: String,
    pub kind: PlotKind,
    /// Cells without this axis are left out.
    pub over: Option<String>,
    #[serde(default, rename = "where")]
    pub filter: Map<String, Value>,
    /// Abscissa of scaling and line plots.
    pub x: Option<Measure>,
    pub x_title: Option<String>,
    /// Ordinates of scaling and line plots; the one measure of bars and maps; stacked ones show every stage.
    #[serde(default)]
    pub y: Vec<Measure>,
    /// Label of the ordinate, whose values are then those of the record (times in ms); the measure in words where absent, and its
    /// values in the unit that is shown.
    pub y_title: Option<String>,
    /// Values of the axis `over` whose ratios are shown.
    pub numerator: Option<Value>,
    pub denominator: Option<Value>,
    /// Axis that runs along a map's columns.
    pub columns: Option<String>,
    /// Axis that runs along a map's rows.
    pub rows: Option<String>,
    /// Axes with a panel of the map for each combination of their values.
    #[serde(default)]
    pub panels: Vec<String>,
}

impl Plot {
    /// Names of the axes that it speaks of.
    pub fn axes(&self) -> impl Iterator<Item = &str> {
        let single = [&self.over, &self.columns, &self.rows];
        let single = single.into_iter().flatten();
        single.chain(&self.panels).map(String::as_str)
    }

    pub(super) fn check(&self) -> Result<(), &'static str> {
        match self.kind {
            PlotKind::Scaling | PlotKind::Lines if self.x.is_none() || self.y.is_empty() => {
                Err("needs x and y")
            }
            PlotKind::Bars if self.over.is_none() || self.y.len() != 1 => {
                Err("of bars needs over and one y")
            }
            PlotKind::Ratios
                if self.over.is_none()
                    || self.y.is_empty()
                    || self.numerator.is_none()
                    || self.denominator.is_none() =>
            {
                Err("of ratios needs over, y, numerator and denominator")
            }
            PlotKind::Map if self.columns.is_none() || self.rows.is_none() || self.y.len() != 1 => {
                Err("of a map needs columns, rows and one y")
            }
            _ => Ok(()),
        }
    }
}
