//! Panels of horizontal bars over a named axis: a bar per cell, those of one value together, the other axes by colour.

use indexmap::{IndexMap, IndexSet};
use plotters::prelude::*;

use super::chart::{BarChart, Canvas, Legend, Mark};
use super::{Area, Drawn, Panel, PlotInput, names, style};
use crate::colors::StageColors;
use crate::format::three;
use fathom_experiments::schema::{Plot, Published};
use fathom_experiments::{Measure, label_text};
use fathom_record::{Cell, Estimate};

const BAR_PX: u32 = 20;
/// Between the bars of one value and those of the next.
const SPACE_PX: u32 = 14;

pub struct Bars {
    chart: BarChart,
    /// The stage whose time is shown, where it is one and no series need colours.
    stage: Option<String>,
    /// Values of the axis, each with a bar for each series that has one.
    clusters: IndexMap<String, Vec<Bar>>,
}

struct Bar {
    series: usize,
    /// In the plot's unit.
    value: Estimate,
    /// None of an exact figure.
    n: Option<usize>,
    /// From the shortest to the longest published frame time.
    published: Option<[f64; 2]>,
}

impl Bars {
    /// None where no cell has a value.
    pub fn new(plot: &Plot, input: &PlotInput<'_>) -> Option<Bars> {
        let (y, over) = (plot.y.first()?, plot.over.as_ref()?);
        let mut series = IndexSet::new();
        let mut clusters = IndexMap::<String, Vec<Bar>>::new();
        let factor = names::factor(y, plot.y_title.as_ref());
        for cell in &input.cells {
            let Some(value) = cell.measured().and_then(|figures| y.read(cell, figures)) else {
                continue;
            };
            let published = input.published(cell).filter(|_| *y == Measure::frame());
            let name = series_name(cell, over, input);
            let bar = Bar {
                series: series.insert_full(name).0,
                value: value.estimate().scaled(factor),
                n: value.n(),
                published: published.map(Published::span_ms),
            };
            let label = cell.axes.get(over).map(label_text).unwrap_or_default();
            clusters.entry(label).or_default().push(bar);
        }
        let ends = clusters.values().flatten();
        let ends =
            ends.flat_map(|bar| [bar.value.ends()[1], bar.published.map_or(0.0, |span| span[1])]);
        let chart = BarChart {
            x_title: names::y_title(plot, &[y]),
            scale: BarChart::scale(ends)?,
            rows_px: clusters.values().map(|bars| bars.len() as u32 * BAR_PX + SPACE_PX).sum(),
            labels_px: BarChart::labels_px(clusters.keys().map(String::as_str)),
            right_px: 96,
            legend: legend(&series, &clusters),
        };
        let stage = y.stage_name().filter(|_| series.len() == 1);
        Some(Bars { chart, stage, clusters })
    }

    #[cfg(test)]
    pub fn shape(&self) -> Vec<(&str, usize)> {
        let clusters = self.clusters.iter();
        clusters.map(|(label, bars)| (label.as_str(), bars.len())).collect()
    }
}

/// The cell's values on the other axes; empty where it has none.
fn series_name(cell: &Cell, over: &str, input: &PlotInput<'_>) -> String {
    if cell.axes.len() > 1 {
        names::cell(cell, Some(over), input.experiment)
    } else {
        String::new()
    }
}

fn legend(series: &IndexSet<String>, clusters: &IndexMap<String, Vec<Bar>>) -> Legend {
    let named = series.iter().enumerate().filter(|(_, name)| !name.is_empty());
    let mut entries: Vec<(Mark, String)> =
        named.map(|(index, name)| (Mark::Square(style::color(index)), name.clone())).collect();
    if clusters.values().flatten().any(|bar| bar.published.is_some()) {
        entries.push((Mark::Published, "published".to_owned()));
    }
    Legend(entries)
}

impl Panel for Bars {
    fn height_px(&self) -> u32 {
        self.chart.height_px()
    }

    fn draw(&self, area: &Area<'_>, colors: &StageColors) -> Drawn {
        // Rows are pixels from the bottom.
        let rows = f64::from(self.chart.rows_px);
        let canvas = self.chart.draw(area, rows)?;
        let of_stage = self.stage.as_ref().map(|stage| style::of_stage(colors.of(stage)));
        let mut row = rows - f64::from(SPACE_PX) / 2.0;
        for (label, bars) in &self.clusters {
            canvas.label(label, 0.0, row - f64::from(BAR_PX) * bars.len() as f64 / 2.0)?;
            for bar in bars {
                row -= f64::from(BAR_PX);
                bar.draw(&canvas, row, of_stage.unwrap_or_else(|| style::color(bar.series)))?;
            }
            row -= f64::from(SPACE_PX);
        }
        Ok(())
    }
}

impl Bar {
    fn draw(&self, canvas: &Canvas<'_>, row: f64, color: RGBColor) -> Drawn {
        let (top, middle) = (row + f64::from(BAR_PX), row + f64::from(BAR_PX) / 2.0);
        let corners = [(0.0, row + 2.0), (self.value.median, top - 2.0)];
        canvas.area.draw(&Rectangle::new(corners, color.filled()))?;
        let [low, high] = self.value.ends();
        canvas.line([(low, middle), (high, middle)], 2)?;
        for at in self.published.into_iter().flatten() {
            canvas.line([(at, row), (at, top)], 4)?;
        }
        let n = self.n.map_or_else(String::new, |n| format!(", n = {n}"));
        let text = three(self.value.median) + &n;
        canvas.write(&text, style::starting(style::small()), (high, middle), 6)
    }
}
