//! Panels of ratios: a measure at one value of an axis over that at another, a row for each group of cells, with the interval
//! and the band that a claim allows.

use plotters::prelude::*;

use super::chart::{BarChart, Canvas, Legend, Mark};
use super::{Area, Drawn, Panel, PlotInput, names, style};
use crate::axis::{Scale, ScaleKind};
use crate::colors::StageColors;
use crate::format::three;
use fathom_experiments::schema::{Plot, Test};
use fathom_experiments::{Measure, Reading, fits, groups, label_text, same};
use fathom_record::{Cell, Interval};

const ROW_PX: u32 = 34;
/// Room for a ratio with its interval and number of samples.
const RIGHT_PX: u32 = 230;

pub struct Ratios {
    chart: BarChart,
    rows: Vec<Row>,
}

struct Row {
    label: String,
    stage: Option<String>,
    ratio: Reading,
    /// What a claim allows.
    band: Option<Interval>,
}

impl Ratios {
    /// None where no group has both values.
    pub fn new(plot: &Plot, input: &PlotInput<'_>) -> Option<Ratios> {
        let over = plot.over.as_ref()?;
        let mut rows = Vec::new();
        for y in &plot.y {
            for (_, members) in groups(&input.cells, over) {
                rows.extend(Row::new(plot, y, &members, input));
            }
        }
        let shown = rows.iter().flat_map(Row::shown).chain([1.0]);
        let mut scale = Scale::fit(ScaleKind::Linear, shown)?;
        scale.low = scale.low.max(0.0);
        let sides = [plot.numerator.as_ref()?, plot.denominator.as_ref()?].map(label_text);
        let axis = names::short_axis(over, input.experiment);
        let chart = BarChart {
            x_title: format!("{axis}: {}, ratio", sides.join(" over ")),
            scale,
            rows_px: rows.len() as u32 * ROW_PX,
            labels_px: BarChart::labels_px(rows.iter().map(|row| row.label.as_str())),
            right_px: RIGHT_PX,
            legend: legend(&rows),
        };
        (!rows.is_empty()).then_some(Ratios { chart, rows })
    }
}

fn legend(rows: &[Row]) -> Legend {
    let banded = rows.iter().any(|row| row.band.is_some());
    let entry = (Mark::Square(style::BAND), "what the claim allows".to_owned());
    Legend(Some(entry).filter(|_| banded).into_iter().collect())
}

impl Row {
    fn new(plot: &Plot, y: &Measure, cells: &[&Cell], input: &PlotInput<'_>) -> Option<Row> {
        let over = plot.over.as_ref()?;
        let at = |wanted: &serde_json::Value| {
            cells.iter().find(|cell| cell.axes.get(over).is_some_and(|value| same(value, wanted)))
        };
        let (top, bottom) = (at(plot.numerator.as_ref()?)?, at(plot.denominator.as_ref()?)?);
        let read = |cell: &Cell| y.read(cell, cell.measured()?);
        let ratio = read(top)?.over(&read(bottom)?);
        let what = y.stage_name().unwrap_or_else(|| y.label().words);
        let others = (top.axes.len() > 1).then(|| names::cell(top, Some(over), input.experiment));
        let parts = Some(what).filter(|_| plot.y.len() > 1 || others.is_none());
        let label = others.into_iter().chain(parts).collect::<Vec<_>>().join(": ");
        let band = band(plot, y, top, input);
        ratio.median().is_finite().then(|| Row { label, stage: y.stage_name(), ratio, band })
    }

    /// What the axis must hold: bands without an end reach to its edge.
    fn shown(&self) -> Vec<f64> {
        let band = self.band.map(|band| [band.low, band.high]).into_iter().flatten();
        let bounds = band.filter(|bound| bound.is_finite());
        let estimate = self.ratio.estimate();
        estimate.ends().into_iter().chain([estimate.median]).chain(bounds).collect()
    }

    fn text(&self) -> String {
        let estimate = self.ratio.estimate();
        let interval = match estimate.interval {
            Some(Interval { low, high }) => format!(" ({} – {})", three(low), three(high)),
            None => String::new(),
        };
        let n = self.ratio.n().map_or_else(String::new, |n| format!(", n = {n}"));
        three(estimate.median) + &interval + &n
    }

    fn draw(&self, canvas: &Canvas<'_>, row: f64, scale: &Scale, color: RGBColor) -> Drawn {
        if let Some(Interval { low, high }) = self.band {
            let ends = [low.max(scale.low), high.min(scale.high)];
            let corners = [(ends[0], row + 0.08), (ends[1], row + 0.92)];
            canvas.area.draw(&Rectangle::new(corners, style::BAND.filled()))?;
        }
        let estimate = self.ratio.estimate();
        let [low, high] = estimate.ends();
        canvas.line([(low, row + 0.5), (high, row + 0.5)], 2)?;
        let dot =
            EmptyElement::at((estimate.median, row + 0.5)) + Circle::new((0, 0), 6, color.filled());
        canvas.area.draw(&dot)?;
        canvas.label(&self.label, scale.low, row + 0.5)?;
        let right = style::starting(style::small());
        canvas.write(&self.text(), right, (scale.high, row + 0.5), 8)
    }
}

/// The band of the claim about this ratio of this group.
fn band(plot: &Plot, y: &Measure, cell: &Cell, input: &PlotInput<'_>) -> Option<Interval> {
    let claims = input.experiment.claim.iter().filter(|claim| fits(cell, &claim.filter));
    claims.into_iter().find_map(|claim| match &claim.test {
        Test::Ratio { y: of, over, numerator, denominator, low, high } => {
            let is_same = of == y
                && plot.over.as_ref() == Some(over)
                && plot.numerator.as_ref().is_some_and(|value| same(value, numerator))
                && plot.denominator.as_ref().is_some_and(|value| same(value, denominator));
            is_same.then_some(Interval { low: *low, high: *high })
        }
        _ => None,
    })
}

impl Panel for Ratios {
    fn height_px(&self) -> u32 {
        self.chart.height_px()
    }

    fn draw(&self, area: &Area<'_>, colors: &StageColors) -> Drawn {
        let rows = self.rows.len() as f64;
        let canvas = self.chart.draw(area, rows)?;
        let scale = &self.chart.scale;
        for (index, row) in self.rows.iter().enumerate() {
            let color = match &row.stage {
                Some(stage) => style::of_stage(colors.of(stage)),
                None => style::color(0),
            };
            row.draw(&canvas, rows - 1.0 - index as f64, scale, color)?;
        }
        canvas.line([(1.0, 0.0), (1.0, rows)], 1)
    }
}
