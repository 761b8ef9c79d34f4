//! Panels of horizontal bars over a named axis: a bar per cell, those of one value together, the other axes by colour.

use indexmap::IndexMap;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;

use super::scale::{Kind, Scale};
use super::{Area, Drawn, fault, style, unit};
use crate::experiments::schema::{Experiment, Plot, Published};
use crate::experiments::{Measure, groups, label_text};
use crate::record::{Cell, Estimate};
use crate::report::format::three;

const BAR_PX: u32 = 20;
/// Between the bars of one value and those of the next.
const SPACE_PX: u32 = 14;
const LEGEND_PX: u32 = 230;
const LABELS_PX: u32 = 180;
/// Title above and axis below the bars.
const FRAME_PX: u32 = 34 + 54;

pub struct Panel {
    plot: Plot,
    series: Vec<String>,
    /// Values of the axis, each with a bar for each series that has one.
    clusters: IndexMap<String, Vec<Bar>>,
    scale: Scale,
    published: Vec<String>,
}

struct Bar {
    series: usize,
    /// In the plot's unit.
    value: Estimate,
    /// From the shortest to the longest published frame time.
    published: Option<(f64, f64)>,
}

impl Panel {
    /// None where no cell has a value.
    pub fn new(plot: &Plot, experiment: &Experiment, cells: &[&Cell]) -> Option<Panel> {
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
                    value: scaled(&value.estimate, unit(y)),
                    published: published.map(Published::span_ms),
                };
                let label = cell.axes.get(over).map(label_text).unwrap_or_default();
                clusters.entry(label).or_default().push(bar);
            }
        }
        let bars = || clusters.values().flatten();
        let ends =
            bars().flat_map(|bar| [bar.value.high, bar.published.map_or(0.0, |span| span.1)]);
        let scale = Scale::fit(Kind::Linear, ends)?.reaching_zero();
        Some(Panel {
            plot: plot.clone(),
            series,
            scale,
            published: super::published_lines(&figures),
            clusters,
        })
    }

    /// The values and how many bars each has.
    #[cfg(test)]
    pub fn shape(&self) -> Vec<(&str, usize)> {
        let clusters = self.clusters.iter();
        clusters.map(|(label, bars)| (label.as_str(), bars.len())).collect()
    }

    fn rows_px(&self) -> u32 {
        let clusters = self.clusters.iter();
        clusters.map(|(_, bars)| bars.len() as u32 * BAR_PX + SPACE_PX).sum()
    }

    pub fn height_px(&self) -> u32 {
        let legend = (self.series.len() + self.published.len()) as u32 * 18;
        FRAME_PX + 22 + self.rows_px().max(legend.saturating_sub(40))
    }

    pub fn draw(&self, area: &Area<'_>) -> Drawn {
        let (left, legend) = area.split_horizontally(super::WIDTH_PX - LEGEND_PX);
        left.draw_text(&self.plot.title, &style::heading(), (16, 8)).map_err(fault)?;
        let rows = f64::from(self.rows_px());
        let free = self.height_px() - FRAME_PX - self.rows_px();
        let mut chart = ChartBuilder::on(&left)
            .margin_top(34)
            .margin_right(56)
            .margin_bottom(8 + free)
            .x_label_area_size(46)
            .y_label_area_size(LABELS_PX)
            .build_cartesian_2d(self.scale.clone(), 0.0..rows)
            .map_err(fault)?;
        chart
            .configure_mesh()
            .disable_y_mesh()
            .bold_line_style(style::GRID)
            .light_line_style(TRANSPARENT)
            .axis_style(style::FAINT)
            .label_style(style::label())
            .axis_desc_style(style::label())
            .x_labels(20)
            .y_labels(0)
            .x_label_formatter(&|at| self.scale.tick_label(*at))
            .x_desc(self.plot.y_title.as_deref().unwrap_or("time (ms)"))
            .draw()
            .map_err(fault)?;
        let canvas = Canvas { left: &left, area: chart.plotting_area() };
        let mut row = rows - f64::from(SPACE_PX) / 2.0;
        for (label, bars) in &self.clusters {
            let middle = row - f64::from(BAR_PX) * bars.len() as f64 / 2.0;
            canvas.write(label, style::ending(style::label()), (0.0, middle), -8)?;
            for bar in bars {
                row -= f64::from(BAR_PX);
                canvas.bar(bar, row)?;
            }
            row -= f64::from(SPACE_PX);
        }
        self.legend(&legend)
    }

    fn legend(&self, area: &Area<'_>) -> Drawn {
        let mut y = 42;
        for (index, series) in self.series.iter().enumerate().filter(|(_, name)| !name.is_empty()) {
            let color = style::color(index).mix(0.8);
            area.draw(&Rectangle::new([(6, y - 6), (18, y + 6)], color.filled())).map_err(fault)?;
            for piece in style::wrap(series, 28) {
                area.draw_text(&piece, &style::starting(style::label()), (26, y)).map_err(fault)?;
                y += 18;
            }
        }
        if !self.published.is_empty() {
            let line = vec![(12, y - 8), (12, y + 8)];
            area.draw(&PathElement::new(line, style::INK.stroke_width(4))).map_err(fault)?;
        }
        for line in &self.published {
            area.draw_text(line, &style::starting(style::label()), (26, y)).map_err(fault)?;
            y += 18;
        }
        Ok(())
    }
}

fn scaled(estimate: &Estimate, by: f64) -> Estimate {
    Estimate {
        median: estimate.median * by,
        low: estimate.low * by,
        high: estimate.high * by,
        n: estimate.n,
    }
}

struct Canvas<'a, 'b> {
    /// Holds labels, in pixels.
    left: &'a Area<'b>,
    /// Holds bars; rows are pixels from the bottom.
    area: &'a DrawingArea<SVGBackend<'b>, Cartesian2d<Scale, RangedCoordf64>>,
}

impl Canvas<'_, '_> {
    /// Text beside a place among the bars, `shift` pixels to the right of it.
    fn write(&self, line: &str, style: TextStyle<'_>, at: (f64, f64), shift: i32) -> Drawn {
        let (x, y) = self.area.map_coordinate(&at);
        let (x0, y0) = self.left.get_base_pixel();
        self.left.draw_text(line, &style, (x - x0 + shift, y - y0)).map_err(fault)
    }

    fn bar(&self, bar: &Bar, row: f64) -> Drawn {
        let (top, middle) = (row + f64::from(BAR_PX), row + f64::from(BAR_PX) / 2.0);
        let corners = [(0.0, row + 2.0), (bar.value.median, top - 2.0)];
        let color = style::color(bar.series).mix(0.8);
        self.area.draw(&Rectangle::new(corners, color.filled())).map_err(fault)?;
        self.line([(bar.value.low, middle), (bar.value.high, middle)], 2)?;
        if let Some((short, long)) = bar.published {
            for at in [short, long] {
                self.line([(at, row), (at, top)], 4)?;
            }
        }
        let end = (bar.value.high, middle);
        self.write(&three(bar.value.median), style::starting(style::small()), end, 6)
    }

    fn line(&self, ends: [(f64, f64); 2], width: u32) -> Drawn {
        let line = PathElement::new(ends.to_vec(), style::INK.stroke_width(width));
        self.area.draw(&line).map_err(fault)
    }
}
