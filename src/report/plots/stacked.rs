//! Panels of horizontal bars: the stages of each cell one after the other, the untimed frame marked.

use plotters::prelude::*;

use super::chart::{BarChart, Canvas, DIAMOND, Legend, Mark};
use super::{Area, Drawn, Panel, PlotInput, names, style};
use crate::colors::StageColors;
use crate::format::{NS_PER_MS, three};
use fathom_experiments::schema::Published;
use fathom_record::{Cell, Estimate, Measured};

const BAR_PX: u32 = 34;
/// A stage that has less of every cell's frame is drawn among the others.
const LEAST_SHARE: f64 = 0.01;

pub struct Stacked {
    chart: BarChart,
    /// Stages with a colour of their own, in frame order.
    stages: Vec<String>,
    bars: Vec<Bar>,
}

/// A cell, times in milliseconds.
struct Bar {
    label: String,
    /// One per stage of the panel, then the rest.
    parts: Vec<f64>,
    gaps: f64,
    frame: Estimate,
    /// From the shortest to the longest published time.
    published: Option<[f64; 2]>,
}

impl Stacked {
    /// None where no cell was timed.
    pub fn new(input: &PlotInput<'_>) -> Option<Stacked> {
        let figures: Vec<(&Cell, &Measured)> = input
            .cells
            .iter()
            .filter_map(|cell| Some((*cell, cell.measured().filter(|cell| cell.is_timed())?)))
            .collect();
        let stages = coloured(&figures);
        let bars: Vec<Bar> = figures
            .iter()
            .map(|(cell, measured)| Bar::new(cell, measured, &stages, input))
            .collect();
        let ends = bars.iter().flat_map(|bar| {
            let timed: f64 = bar.parts.iter().sum::<f64>() + bar.gaps;
            let [low, high] = bar.frame.ends();
            [timed, low, bar.frame.median, high, bar.published.map_or(0.0, |span| span[1])]
        });
        let chart = BarChart {
            x_title: "time (ms)".to_owned(),
            scale: BarChart::scale(ends)?,
            rows_px: bars.len() as u32 * BAR_PX,
            labels_px: BarChart::labels_px(bars.iter().map(|bar| bar.label.as_str())),
            right_px: 110,
            legend: Legend::default(),
        };
        Some(Stacked { chart, stages, bars })
    }

    fn bar(&self, canvas: &Canvas<'_>, bar: &Bar, row: f64, colors: &StageColors) -> Drawn {
        let mut start = 0.0;
        let of_stages = self.stages.iter().map(|stage| style::of_stage(colors.of(stage)));
        let parts = bar.parts.iter().copied().zip(of_stages.chain([style::REST]));
        for (length, color) in parts.chain([(bar.gaps, style::GAPS)]) {
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
        canvas.label(&bar.label, 0.0, row + 0.5)?;
        let end = bar.published.map_or(0.0, |span| span[1]).max(bar.frame.ends()[1]).max(start);
        let text = format!("{}, n = {}", three(bar.frame.median), bar.frame.n);
        canvas.write(&text, style::starting(style::small()), (end, row + 0.5), 10)
    }

    fn legend(&self, colors: &StageColors) -> Legend {
        let square =
            |stage: &String| (Mark::Square(style::of_stage(colors.of(stage))), stage.clone());
        let mut entries: Vec<(Mark, String)> = self.stages.iter().map(square).collect();
        let any = |part: fn(&Bar) -> f64| self.bars.iter().any(|bar| part(bar) > 0.0);
        if any(|bar| bar.parts.last().copied().unwrap_or_default()) {
            entries.push((Mark::Square(style::REST), "all other stages".to_owned()));
        }
        if any(|bar| bar.gaps) {
            entries.push((Mark::Square(style::GAPS), "gaps between passes".to_owned()));
        }
        entries.push((Mark::Diamond, "frame without stage timing".to_owned()));
        if self.bars.iter().any(|bar| bar.published.is_some()) {
            entries.push((Mark::Published, "published".to_owned()));
        }
        Legend(entries)
    }
}

impl Panel for Stacked {
    fn height_px(&self) -> u32 {
        self.legend(&StageColors::default()).height_px() + self.chart.height_px()
    }

    fn draw(&self, area: &Area<'_>, colors: &StageColors) -> Drawn {
        let legend = self.legend(colors);
        let (above, area) = area.split_vertically(legend.height_px());
        legend.draw(&above)?;
        let canvas = self.chart.draw(&area, self.bars.len() as f64)?;
        for (row, bar) in self.bars.iter().rev().enumerate().rev() {
            self.bar(&canvas, bar, row as f64, colors)?;
        }
        Ok(())
    }
}

/// The stages with a share of some cell that can be seen, in frame order.
fn coloured(figures: &[(&Cell, &Measured)]) -> Vec<String> {
    let mut shares: Vec<(&str, f64)> = Vec::new();
    for (_, measured) in figures {
        let total: f64 = measured.stages.iter().map(|stage| stage.time.median).sum();
        for stage in &measured.stages {
            let share = stage.time.median / total;
            match shares.iter_mut().find(|(name, _)| stage.stage == *name) {
                Some((_, most)) => *most = most.max(share),
                None => shares.push((&stage.stage, share)),
            }
        }
    }
    let seen = shares.into_iter().filter(|(_, share)| *share >= LEAST_SHARE);
    seen.map(|(name, _)| name.to_owned()).collect()
}

impl Bar {
    fn new(cell: &Cell, measured: &Measured, stages: &[String], input: &PlotInput<'_>) -> Bar {
        let mut parts = vec![0.0; stages.len() + 1];
        // A time below the clock's resolution has no length.
        for stage in measured.stages.iter().filter(|s| s.is_resolved()) {
            let place = stages.iter().position(|name| *stage.stage == **name);
            parts[place.unwrap_or(stages.len())] += stage.time.median / NS_PER_MS;
        }
        let frame = &measured.frame;
        let gaps = fathom_base::statistics::median(&frame.gap_samples_ns) / NS_PER_MS;
        Bar {
            label: names::cell(cell, None, input.experiment),
            parts,
            gaps: if gaps.is_finite() { gaps.max(0.0) } else { 0.0 },
            frame: frame.untimed.scaled(1.0 / NS_PER_MS),
            published: input.published(cell).map(Published::span_ms),
        }
    }
}

/// The untimed frame's interval and the published times, with their widths in pixels.
fn lines(bar: &Bar, row: f64) -> Vec<([(f64, f64); 2], u32)> {
    let middle = row + 0.5;
    let mut lines = vec![(bar.frame.ends().map(|end| (end, middle)), 2)];
    if let Some([low, high]) = bar.published {
        for at in [low, high] {
            lines.push(([(at, row + 0.04), (at, row + 0.96)], 4));
        }
        for edge in [0.04, 0.96] {
            lines.push(([(low, row + edge), (high, row + edge)], 2));
        }
    }
    lines
}
