//! Panels of horizontal bars: the stages of each cell one after the other, the untimed frame marked.

use plotters::prelude::*;

use super::chart::{BarChart, Canvas, FRAME_PX, LEGEND_ROW_PX};
use super::{Area, Drawn, Panel, style};
use crate::experiments::label_text;
use crate::experiments::schema::{Experiment, Plot, Published};
use crate::record::{Cell, Estimate, Measured};
use crate::report::format::NS_PER_MS;

/// Least and greatest height of a bar's row; few bars grow to fill the legend's height.
const BAR_PX: (u32, u32) = (34, 64);

pub struct Stacked {
    chart: BarChart,
    /// Stages with a colour of their own, in frame order.
    stages: Vec<String>,
    has_rest: bool,
    bars: Vec<Bar>,
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

impl Stacked {
    /// None where no cell was measured.
    pub fn new(plot: &Plot, experiment: &Experiment, cells: &[&Cell]) -> Option<Stacked> {
        let figures: Vec<(&Cell, &Measured)> = cells
            .iter()
            .filter_map(|cell| Some((*cell, cell.measured().filter(|cell| cell.is_timed())?)))
            .collect();
        let stages = coloured(&figures);
        let bars: Vec<Bar> = figures
            .iter()
            .map(|(cell, measured)| Bar::new(cell, measured, &stages, experiment))
            .collect();
        let ends = bars.iter().flat_map(|bar| {
            let timed: f64 = bar.parts.iter().sum::<f64>() + bar.gaps;
            let [low, high] = bar.frame.ends();
            [timed, low, bar.frame.median, high, bar.published.map_or(0.0, |span| span.1)]
        });
        let scale = BarChart::scale(ends)?;
        let published: Vec<&Published> =
            figures.iter().filter_map(|(cell, _)| experiment.published_for(cell)).collect();
        let published = super::published_lines(&published);
        let has_rest = bars.iter().any(|bar| bar.parts.last().is_some_and(|rest| *rest > 0.0));
        let rows = stages.len() + usize::from(has_rest) + 2 + published.len();
        let legend_px = (rows as u32 * LEGEND_ROW_PX as u32).saturating_sub(FRAME_PX - 42);
        let count = bars.len() as u32;
        let chart = BarChart {
            title: plot.title.clone(),
            x_title: "time (ms)".to_owned(),
            scale,
            rows_px: count * (legend_px / count).clamp(BAR_PX.0, BAR_PX.1),
            legend_px,
            labels_px: 220,
            right_px: 16,
        };
        Some(Stacked { chart, stages, has_rest, bars, published })
    }

    fn bar(&self, canvas: &Canvas<'_>, bar: &Bar, row: f64) -> Drawn {
        let mut start = 0.0;
        let colors = (0..self.stages.len()).map(style::color).chain([style::REST]);
        let parts = bar.parts.iter().copied().zip(colors);
        for (length, color) in parts.chain([(bar.gaps, style::GRID)]) {
            let corners = [(start, row + 0.18), (start + length, row + 0.82)];
            if length > 0.0 {
                canvas.area.draw(&Rectangle::new(corners, color.filled()))?;
            }
            start += length;
        }
        for (line, width_px) in lines(bar, row) {
            canvas.line(line, width_px)?;
        }
        let marker = EmptyElement::at((bar.frame.median, row + 0.5))
            + Polygon::new(DIAMOND, style::INK.filled());
        canvas.area.draw(&marker)?;
        canvas.label(&shorten(&bar.label), row + 0.5)
    }

    fn legend(&self, canvas: &Canvas<'_>) -> Drawn {
        let stages = self.stages.iter().enumerate();
        let stages = stages.map(|(index, stage)| (style::color(index), stage.as_str()));
        let rest = self.has_rest.then_some((style::REST, "all other stages"));
        let mut legend = canvas.legend();
        for (color, name) in stages.chain(rest).chain([(style::GRID, "gaps between passes")]) {
            legend.square(color)?;
            legend.write(name, style::label())?;
        }
        legend.polygon(&DIAMOND, style::INK)?;
        legend.write("frame without stage timing", style::label())?;
        legend.published(&self.published)
    }
}

impl Panel for Stacked {
    fn height_px(&self) -> u32 {
        self.chart.height_px()
    }

    fn draw(&self, area: &Area<'_>) -> Drawn {
        let canvas = self.chart.draw(area, self.bars.len() as f64)?;
        for (row, bar) in self.bars.iter().rev().enumerate().rev() {
            self.bar(&canvas, bar, row as f64)?;
        }
        self.legend(&canvas)
    }
}

/// The mark of the untimed frame.
const DIAMOND: [(i32, i32); 4] = [(0, -6), (6, 0), (0, 6), (-6, 0)];

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
            label: format!("{}, n = {}", label(cell), frame.untimed.n),
            parts,
            gaps: if gaps.is_finite() { gaps.max(0.0) } else { 0.0 },
            frame: frame.untimed.scaled(1.0 / NS_PER_MS),
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
fn lines(bar: &Bar, row: f64) -> Vec<([(f64, f64); 2], u32)> {
    let middle = row + 0.5;
    let mut lines = vec![(bar.frame.ends().map(|end| (end, middle)), 2)];
    if let Some((low, high)) = bar.published {
        for at in [low, high] {
            lines.push(([(at, row + 0.04), (at, row + 0.96)], 4));
        }
        for edge in [0.04, 0.96] {
            lines.push(([(low, row + edge), (high, row + edge)], 2));
        }
    }
    lines
}
