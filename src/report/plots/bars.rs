//! Panels of horizontal bars over a named axis: a bar per cell, those of one value together, the other axes by colour.

use indexmap::IndexMap;
use plotters::prelude::*;

use super::chart::{BarChart, Canvas, LEGEND_ROW_PX};
use super::{Area, Drawn, Panel, style, unit};
use crate::experiments::schema::{Experiment, Plot, Published};
use crate::experiments::{Measure, groups, label_text};
use crate::record::{Cell, Estimate};
use crate::report::format::three;

const BAR_PX: u32 = 20;
/// Between the bars of one value and those of the next.
const SPACE_PX: u32 = 14;

pub struct Bars {
    chart: BarChart,
    series: Vec<String>,
    /// Values of the axis, each with a bar for each series that has one.
    clusters: IndexMap<String, Vec<Bar>>,
    published: Vec<String>,
}

struct Bar {
    series: usize,
    /// In the plot's unit.
    value: Estimate,
    /// None of an exact figure.
    n: Option<usize>,
    /// From the shortest to the longest published frame time.
    published: Option<(f64, f64)>,
}

impl Bars {
    /// None where no cell has a value.
    pub fn new(plot: &Plot, experiment: &Experiment, cells: &[&Cell]) -> Option<Bars> {
        let (y, over) = (plot.y.first()?, plot.over.as_ref()?);
        let of_frames = *y == Measure::frame();
        let mut series = Vec::new();
        let mut clusters = IndexMap::<String, Vec<Bar>>::new();
        let mut figures: Vec<&Published> = Vec::new();
        for (name, members) in groups(cells, over) {
            for cell in members {
                let Some(value) = cell.measured().and_then(|figures| y.read(cell, figures)) else {
                    continue;
                };
                let published = experiment.published_for(cell).filter(|_| of_frames);
                figures.extend(published);
                if series.last() != Some(&name) {
                    series.push(name.clone());
                }
                let bar = Bar {
                    series: series.len() - 1,
                    value: value.estimate().scaled(unit(y)),
                    n: value.n(),
                    published: published.map(Published::span_ms),
                };
                let label = cell.axes.get(over).map(label_text).unwrap_or_default();
                clusters.entry(label).or_default().push(bar);
            }
        }
        let published = super::published_lines(&figures);
        let ends = clusters.values().flatten();
        let ends =
            ends.flat_map(|bar| [bar.value.ends()[1], bar.published.map_or(0.0, |span| span.1)]);
        let rows_px = clusters.values().map(|bars| bars.len() as u32 * BAR_PX + SPACE_PX).sum();
        let legend_px = (series.len() + published.len()) as u32 * LEGEND_ROW_PX as u32;
        let chart = BarChart {
            title: plot.title.clone(),
            x_title: plot.y_title().to_owned(),
            scale: BarChart::scale(ends)?,
            rows_px,
            legend_px: legend_px.saturating_sub(40),
            labels_px: 180,
            right_px: 96,
        };
        Some(Bars { chart, series, clusters, published })
    }

    #[cfg(test)]
    pub fn shape(&self) -> Vec<(&str, usize)> {
        let clusters = self.clusters.iter();
        clusters.map(|(label, bars)| (label.as_str(), bars.len())).collect()
    }

    fn legend(&self, canvas: &Canvas<'_>) -> Drawn {
        let mut legend = canvas.legend();
        for (index, series) in self.series.iter().enumerate().filter(|(_, name)| !name.is_empty()) {
            legend.square(color(index))?;
            for piece in style::wrap(series, 28) {
                legend.write(&piece, style::label())?;
            }
        }
        legend.published(&self.published)
    }
}

impl Panel for Bars {
    fn height_px(&self) -> u32 {
        self.chart.height_px()
    }

    fn draw(&self, area: &Area<'_>) -> Drawn {
        // Rows are pixels from the bottom.
        let rows = f64::from(self.chart.rows_px);
        let canvas = self.chart.draw(area, rows)?;
        let mut row = rows - f64::from(SPACE_PX) / 2.0;
        for (label, bars) in &self.clusters {
            canvas.label(label, row - f64::from(BAR_PX) * bars.len() as f64 / 2.0)?;
            for bar in bars {
                row -= f64::from(BAR_PX);
                bar.draw(&canvas, row)?;
            }
            row -= f64::from(SPACE_PX);
        }
        self.legend(&canvas)
    }
}

fn color(series: usize) -> RGBAColor {
    style::color(series).mix(0.8)
}

impl Bar {
    fn draw(&self, canvas: &Canvas<'_>, row: f64) -> Drawn {
        let (top, middle) = (row + f64::from(BAR_PX), row + f64::from(BAR_PX) / 2.0);
        let corners = [(0.0, row + 2.0), (self.value.median, top - 2.0)];
        canvas.area.draw(&Rectangle::new(corners, color(self.series).filled()))?;
        let [low, high] = self.value.ends();
        canvas.line([(low, middle), (high, middle)], 2)?;
        if let Some((short, long)) = self.published {
            for at in [short, long] {
                canvas.line([(at, row), (at, top)], 4)?;
            }
        }
        let n = self.n.map_or_else(String::new, |n| format!(", n = {n}"));
        let text = three(self.value.median) + &n;
        canvas.write(&text, style::starting(style::small()), (high, middle), 6)
    }
}
