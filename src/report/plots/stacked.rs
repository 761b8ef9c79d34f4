//! Panels of horizontal bars: the stages of each cell one after the other, the untimed frame marked.

use plotters::prelude::*;

use super::scale::{Kind, Scale};
use super::{Area, Drawn, fault, style};
use crate::experiments::label_text;
use crate::experiments::schema::{Experiment, Plot, Published};
use crate::record::{Cell, Estimate, Measured};
use crate::report::format::NS_PER_MS;

/// Least and greatest height of a bar's row; few bars grow to fill the legend's height.
const BAR_PX: (u32, u32) = (34, 64);
const LEGEND_PX: u32 = 230;
const LABELS_PX: u32 = 220;
/// Title above and axis below the bars.
const FRAME_PX: u32 = 34 + 54;
const LEGEND_ROW_PX: u32 = 18;

pub struct Panel {
    plot: Plot,
    /// Stages with a colour of their own, in frame order.
    stages: Vec<String>,
    has_rest: bool,
    bars: Vec<Bar>,
    scale: Scale,
    /// The legend's words on published figures.
    published: Vec<String>,
}

/// A cell, times in milliseconds.
struct Bar {
    label: String,
    /// One per stage of the panel, then the rest.
    parts: Vec<f64>,
    gaps: f64,
    frame: Estimate,
    /// From the shortest to the longest published time.
    published: Option<(f64, f64)>,
}

impl Panel {
    /// None where no cell was measured.
    pub fn new(plot: &Plot, experiment: &Experiment, cells: &[&Cell]) -> Option<Panel> {
        let figures: Vec<(&Cell, &Measured)> =
            cells.iter().filter_map(|cell| Some((*cell, cell.measured()?))).collect();
        let stages = coloured(&figures);
        let bars: Vec<Bar> = figures
            .iter()
            .map(|(cell, measured)| Bar::new(cell, measured, &stages, experiment))
            .collect();
        let ends = bars.iter().flat_map(|bar| {
            let timed: f64 = bar.parts.iter().sum::<f64>() + bar.gaps;
            [timed, bar.frame.high, bar.published.map_or(0.0, |span| span.1)]
        });
        let scale = Scale::fit(Kind::Linear, ends)?.reaching_zero();
        let published: Vec<&Published> =
            figures.iter().filter_map(|(cell, _)| experiment.published_for(cell)).collect();
        Some(Panel {
            plot: plot.clone(),
            has_rest: bars.iter().any(|bar| bar.parts.last().is_some_and(|rest| *rest > 0.0)),
            stages,
            bars,
            scale,
            published: super::published_lines(&published),
        })
    }

    pub fn height_px(&self) -> u32 {
        FRAME_PX + 22 + self.bars_px().max(self.legend_px())
    }

    fn legend_px(&self) -> u32 {
        let rows = self.stages.len() + usize::from(self.has_rest) + 2 + self.published.len();
        (rows as u32 * LEGEND_ROW_PX).saturating_sub(FRAME_PX - 42)
    }

    fn bars_px(&self) -> u32 {
        let bars = self.bars.len() as u32;
        bars * (self.legend_px() / bars).clamp(BAR_PX.0, BAR_PX.1)
    }

    pub fn draw(&self, area: &Area<'_>) -> Drawn {
        let (left, legend) = area.split_horizontally(super::WIDTH_PX - LEGEND_PX);
        left.draw_text(&self.plot.title, &style::heading(), (16, 8)).map_err(fault)?;
        let rows = self.bars.len() as f64;
        let free = self.height_px() - FRAME_PX - self.bars_px();
        let mut chart = ChartBuilder::on(&left)
            .margin_top(34)
            .margin_right(16)
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
            .x_desc("time (ms)")
            .draw()
            .map_err(fault)?;
        for (index, bar) in self.bars.iter().enumerate() {
            let row = rows - 1.0 - index as f64;
            chart.draw_series(self.rectangles(bar, row)).map_err(fault)?;
            for (line, width) in lines(bar, row) {
                let line = PathElement::new(line, style::INK.stroke_width(width));
                chart.plotting_area().draw(&line).map_err(fault)?;
            }
            let marker = EmptyElement::at((bar.frame.median, row + 0.5))
                + Polygon::new(diamond((0, 0)), style::INK.filled());
            chart.plotting_area().draw(&marker).map_err(fault)?;
            let (x, y) = chart.backend_coord(&(0.0, row + 0.5));
            let (x0, y0) = left.get_base_pixel();
            left.draw_text(
                &shorten(&bar.label),
                &style::ending(style::label()),
                (x - x0 - 8, y - y0),
            )
            .map_err(fault)?;
        }
        self.legend(&legend)
    }

    fn rectangles(&self, bar: &Bar, row: f64) -> Vec<Rectangle<(f64, f64)>> {
        let mut start = 0.0;
        let mut shapes = Vec::new();
        let colours = (0..self.stages.len()).map(style::color).chain([style::REST]);
        let parts = bar.parts.iter().copied().zip(colours);
        for (length, color) in parts.chain([(bar.gaps, style::GRID)]) {
            let corners = [(start, row + 0.18), (start + length, row + 0.82)];
            if length > 0.0 {
                shapes.push(Rectangle::new(corners, color.filled()));
            }
            start += length;
        }
        shapes
    }

    fn legend(&self, area: &Area<'_>) -> Drawn {
        let mut rows: Vec<(RGBColor, &str)> = self
            .stages
            .iter()
            .enumerate()
            .map(|(index, stage)| (style::color(index), stage.as_str()))
            .collect();
        if self.has_rest {
            rows.push((style::REST, "all other stages"));
        }
        rows.push((style::GRID, "gaps between passes"));
        let mut y = 42;
        for (color, name) in rows {
            area.draw(&Rectangle::new([(6, y - 6), (18, y + 6)], color.filled())).map_err(fault)?;
            y = write(area, name, y)?;
        }
        let diamond = diamond((12, y));
        area.draw(&Polygon::new(diamond, style::INK.filled())).map_err(fault)?;
        y = write(area, "frame without stage timing", y)?;
        if !self.published.is_empty() {
            let line = vec![(12, y - 8), (12, y + 8)];
            area.draw(&PathElement::new(line, style::INK.stroke_width(4))).map_err(fault)?;
        }
        for line in &self.published {
            y = write(area, line, y)?;
        }
        Ok(())
    }
}

fn write(area: &Area<'_>, line: &str, y: i32) -> Result<i32, String> {
    area.draw_text(line, &style::starting(style::label()), (26, y)).map_err(fault)?;
    Ok(y + LEGEND_ROW_PX as i32)
}

fn diamond((x, y): (i32, i32)) -> Vec<(i32, i32)> {
    vec![(x, y - 6), (x + 6, y), (x, y + 6), (x - 6, y)]
}

/// The stages with the greatest share of some cell, in frame order, as many as there are colours.
fn coloured(figures: &[(&Cell, &Measured)]) -> Vec<String> {
    let mut shares: Vec<(String, f64)> = Vec::new();
    for (_, measured) in figures {
        let total: f64 = measured.stages.iter().map(|stage| stage.time.median).sum();
        for stage in &measured.stages {
            let share = stage.time.median / total;
            match shares.iter_mut().find(|(name, _)| *name == stage.stage) {
                Some((_, most)) => *most = most.max(share),
                None => shares.push((stage.stage.clone(), share)),
            }
        }
    }
    let mut ranked: Vec<f64> = shares.iter().map(|(_, share)| *share).collect();
    ranked.sort_by(|a, b| b.total_cmp(a));
    let least = ranked.get(style::COLORS - 1).copied().unwrap_or(0.0);
    shares.retain(|(_, share)| *share >= least && *share > 0.005);
    shares.truncate(style::COLORS);
    shares.into_iter().map(|(name, _)| name).collect()
}

impl Bar {
    fn new(cell: &Cell, measured: &Measured, stages: &[String], experiment: &Experiment) -> Bar {
        let mut parts = vec![0.0; stages.len() + 1];
        // A time below the clock's resolution has no length.
        for stage in measured.stages.iter().filter(|s| s.is_resolved()) {
            let place = stages.iter().position(|name| *name == stage.stage);
            parts[place.unwrap_or(stages.len())] += stage.time.median / NS_PER_MS;
        }
        let frame = &measured.frame;
        let gaps = crate::statistics::median(&frame.gap_samples_ns) / NS_PER_MS;
        Bar {
            label: label(cell),
            parts,
            gaps: if gaps.is_finite() { gaps.max(0.0) } else { 0.0 },
            frame: Estimate {
                median: frame.untimed.median / NS_PER_MS,
                low: frame.untimed.low / NS_PER_MS,
                high: frame.untimed.high / NS_PER_MS,
                n: frame.untimed.n,
            },
            published: experiment.published_for(cell).map(Published::span_ms),
        }
    }
}

/// The values of the cell's axes; its scene where it has none.
fn label(cell: &Cell) -> String {
    let values: Vec<String> = cell
        .axes
        .iter()
        .map(|(name, value)| match value {
            serde_json::Value::String(text) if text.parse::<f64>().is_err() => text.clone(),
            other => {
                let last = name.rsplit('.').next().unwrap_or(name);
                format!("{last} {}", label_text(other))
            }
        })
        .collect();
    if values.is_empty() { cell.scene.clone() } else { values.join(", ") }
}

/// What fits beside the bars.
fn shorten(label: &str) -> String {
    const LIMIT: usize = 32;
    if label.chars().count() <= LIMIT {
        return label.to_owned();
    }
    label.chars().take(LIMIT - 1).chain(['…']).collect()
}

/// The untimed frame's interval and the published times, with their widths in pixels.
fn lines(bar: &Bar, row: f64) -> Vec<(Vec<(f64, f64)>, u32)> {
    let middle = row + 0.5;
    let mut lines = vec![(vec![(bar.frame.low, middle), (bar.frame.high, middle)], 2)];
    if let Some((low, high)) = bar.published {
        for at in [low, high] {
            lines.push((vec![(at, row + 0.04), (at, row + 0.96)], 4));
        }
        for edge in [0.04, 0.96] {
            lines.push((vec![(low, row + edge), (high, row + edge)], 2));
        }
    }
    lines
}
