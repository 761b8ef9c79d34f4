//! Panels of series over a number: scaling plots (logarithmic, fitted slopes in the legend) and linear ones.

use itertools::{Itertools, MinMaxResult};
use plotters::prelude::*;

use super::chart::{Legend, mesh, split};
use super::scale::{Scale, ScaleKind};
use super::{Area, Drawn, Panel, style, unit};
use crate::experiments::schema::{Experiment, FIXED_SHARE, Plot, PlotKind, Published};
use crate::experiments::{Measure, Reading, Scaling, groups, scaling};
use crate::record::{Cell, Estimate, Interval};

/// Least height of a panel.
const HEIGHT_PX: u32 = 430;
const LEGEND_PX: u32 = 300;
const LEGEND_TOP_PX: i32 = 44;
const ROW_PX: i32 = 16;
const ENTRY_GAP_PX: i32 = 8;
/// Characters of 12-px type that fit into the legend's column.
const LEGEND_CHARACTERS: usize = 44;

pub struct Lines {
    title: String,
    x_title: String,
    y_title: String,
    x: Scale,
    y: Scale,
    series: Vec<Series>,
    published: Vec<Mark>,
    published_lines: Vec<String>,
}

struct Series {
    name: String,
    group: String,
    /// Places and values in the plot's units.
    points: Vec<(f64, Estimate)>,
    /// Ends of the fitted line, in the plot's units.
    fit: Option<[(f64, f64); 2]>,
    /// The legend's words on the fit and on the number of samples.
    remark: String,
}

struct Mark {
    x: f64,
    span_ms: (f64, f64),
}

impl Lines {
    /// None where no series has a point.
    pub fn new(plot: &Plot, experiment: &Experiment, cells: &[&Cell]) -> Option<Lines> {
        let x_measure = plot.x.as_ref()?;
        let groups = match &plot.over {
            Some(over) => groups(cells, over),
            None => vec![(String::new(), cells.to_vec())],
        };
        let mut series = Vec::new();
        for y in &plot.y {
            for (group, members) in &groups {
                let one = Series::new(plot, x_measure, y, group, members);
                series.extend(Some(one).filter(|one| !one.points.is_empty()));
            }
        }
        let of_frames = plot.y.iter().any(|y| *y == Measure::frame());
        let shown: &[&Cell] = if of_frames { cells } else { &[] };
        let published = marks(experiment, x_measure, shown);
        let figures: Vec<&Published> = shown
            .iter()
            .filter_map(|cell| cell.measured().and(experiment.published_for(cell)))
            .collect();
        let kind = match plot.kind {
            PlotKind::Scaling => ScaleKind::Log,
            _ => ScaleKind::Linear,
        };
        let points = || series.iter().flat_map(|series| &series.points);
        let x = Scale::fit(kind, points().map(|(x, _)| *x))?;
        let ends = points().flat_map(|(_, y)| [y.ends()[0], y.median, y.ends()[1]]);
        let marked = published.iter().flat_map(|mark| [mark.span_ms.0, mark.span_ms.1]);
        let y = Scale::fit(kind, ends.chain(marked))?;
        Some(Lines {
            title: plot.title.clone(),
            x_title: plot.x_title.clone().unwrap_or_else(|| x_measure.to_string()),
            y_title: plot.y_title().to_owned(),
            x,
            y,
            series,
            published,
            published_lines: super::published_lines(&figures),
        })
    }

    fn legend(&self, area: &Area<'_>) -> Drawn {
        let mut legend = Legend { area, y: LEGEND_TOP_PX, row_px: ROW_PX };
        for (index, series) in self.series.iter().enumerate() {
            legend.polygon(&style::marker(index), style::color(index))?;
            entry(&mut legend, &series.name, [&series.group, &series.remark])?;
        }
        if let Some((figures, hardware)) = self.published_lines.split_first() {
            STAR.iter().try_for_each(|ray| legend.line(ray, 2))?;
            entry(&mut legend, figures, hardware)?;
        }
        Ok(())
    }
}

impl Lines {
    /// Height of the legend's entries.
    fn legend_px(&self) -> u32 {
        let of_series = self.series.iter().map(|s| vec![&s.name, &s.group, &s.remark]);
        let published =
            Some(self.published_lines.iter().collect()).filter(|p: &Vec<_>| !p.is_empty());
        let rows = |lines: Vec<&String>| {
            let shown = lines.into_iter().filter(|line| !line.is_empty());
            shown.map(|line| style::wrap(line, LEGEND_CHARACTERS).len() as u32).sum::<u32>()
        };
        let entry_px = |lines| rows(lines) * ROW_PX as u32 + ENTRY_GAP_PX as u32;
        of_series.chain(published).map(entry_px).sum()
    }
}

impl Panel for Lines {
    fn height_px(&self) -> u32 {
        HEIGHT_PX.max(LEGEND_TOP_PX as u32 + self.legend_px())
    }

    fn draw(&self, area: &Area<'_>) -> Drawn {
        let (left, legend) = split(area, &self.title, LEGEND_PX)?;
        let mut chart = ChartBuilder::on(&left)
            .margin_top(34)
            .margin_right(16)
            .margin_left(16)
            .margin_bottom(8)
            .x_label_area_size(46)
            .y_label_area_size(74)
            .build_cartesian_2d(self.x.clone(), self.y.clone())?;
        mesh(&mut chart)
            .y_labels(20)
            .x_label_formatter(&|at| self.x.tick_label(*at))
            .y_label_formatter(&|at| self.y.tick_label(*at))
            .x_desc(&self.x_title)
            .y_desc(&self.y_title)
            .draw()?;
        let canvas = Canvas { area: chart.plotting_area(), panel: self };
        for (index, series) in self.series.iter().enumerate() {
            canvas.series(index, series)?;
        }
        for mark in &self.published {
            canvas.mark(mark)?;
        }
        self.legend(&legend)
    }
}

/// A name and remarks on it, wrapped.
fn entry<'s>(
    legend: &mut Legend<'_, '_>,
    name: &str,
    remarks: impl IntoIterator<Item = &'s String>,
) -> Drawn {
    let remarks = remarks.into_iter().map(|remark| (remark.as_str(), style::small()));
    let lines = std::iter::once((name, style::label())).chain(remarks);
    for (line, style) in lines.filter(|(line, _)| !line.is_empty()) {
        for piece in style::wrap(line, LEGEND_CHARACTERS) {
            legend.write(&piece, style.clone())?;
        }
    }
    legend.y += ENTRY_GAP_PX;
    Ok(())
}

/// The mark of published figures.
const STAR: [[(i32, i32); 2]; 4] =
    [[(-6, 0), (6, 0)], [(0, -6), (0, 6)], [(-4, -4), (4, 4)], [(-4, 4), (4, -4)]];

impl Series {
    fn new(plot: &Plot, x: &Measure, y: &Measure, group: &str, cells: &[&Cell]) -> Series {
        let read = |cell: &&Cell| {
            let figures = cell.measured()?;
            let at = x.read(cell, figures)?.median() * unit(x);
            Some((at, y.read(cell, figures)?))
        };
        let readings: Vec<(f64, Reading)> = cells.iter().filter_map(read).collect();
        let counts = counts(readings.iter().filter_map(|(_, reading)| reading.n()));
        let points = readings.iter().map(|(x, reading)| (*x, reading.estimate().scaled(unit(y))));
        let mut points: Vec<(f64, Estimate)> = points.collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        let fit = match plot.kind {
            PlotKind::Scaling => scaling(y, x, cells, FIXED_SHARE).ok(),
            _ => None,
        };
        let remarks = [fit.as_ref().map(remark), counts];
        let remark = remarks.into_iter().flatten().collect::<Vec<_>>().join(", ");
        Series {
            name: y.stage_name().unwrap_or_else(|| y.to_string()),
            group: group.to_owned(),
            points,
            fit: fit.map(|fit| ends(&fit, unit(x), unit(y))),
            remark,
        }
    }
}

fn ends(fit: &Scaling, x_unit: f64, y_unit: f64) -> [(f64, f64); 2] {
    [fit.range.0, fit.range.1].map(|x| {
        let y = (fit.slope.intercept + fit.slope.slope * x.ln()).exp();
        (x * x_unit, y * y_unit)
    })
}

/// The fewest and the most samples of a point; none where all points are exact.
fn counts(counts: impl Iterator<Item = usize>) -> Option<String> {
    match counts.minmax() {
        MinMaxResult::NoElements => None,
        MinMaxResult::OneElement(n) => Some(format!("n = {n}")),
        MinMaxResult::MinMax(least, most) if least == most => Some(format!("n = {least}")),
        MinMaxResult::MinMax(least, most) => Some(format!("n = {least} – {most}")),
    }
}

fn remark(fit: &Scaling) -> String {
    let slope = &fit.slope;
    let mut remark = format!("slope {:.2}", slope.slope);
    if let Some(Interval { low, high }) = fit.interval() {
        remark += &format!(" ({low:.2} – {high:.2})");
    }
    if fit.left_out > 0 {
        remark += &format!(", {} left out", fit.left_out);
    }
    remark
}

/// Published frame times of the cells that are at the published size.
fn marks(experiment: &Experiment, x: &Measure, cells: &[&Cell]) -> Vec<Mark> {
    let mark = |cell: &&Cell| {
        let at = x.read(cell, cell.measured()?)?.median();
        Some(Mark { x: at * unit(x), span_ms: experiment.published_for(cell)?.span_ms() })
    };
    cells.iter().filter_map(mark).collect()
}

struct Canvas<'a, 'b> {
    area: &'a DrawingArea<SVGBackend<'b>, Cartesian2d<Scale, Scale>>,
    panel: &'a Lines,
}

impl Canvas<'_, '_> {
    fn at(&self, x: f64, y: f64) -> Option<(f64, f64)> {
        Some((self.panel.x.at(x)?, self.panel.y.at(y)?))
    }

    fn line(&self, ends: [Option<(f64, f64)>; 2], style: ShapeStyle) -> Drawn {
        let [Some(a), Some(b)] = ends else {
            return Ok(());
        };
        self.area.draw(&PathElement::new(vec![a, b], style))
    }

    fn series(&self, index: usize, series: &Series) -> Drawn {
        let color = style::color(index);
        for pair in series.points.windows(2) {
            let ends = [pair[0], pair[1]].map(|(x, y)| self.at(x, y.median));
            self.line(ends, color.mix(0.45).stroke_width(1))?;
        }
        if let Some(ends) = &series.fit {
            self.fit(ends, color)?;
        }
        for (x, y) in &series.points {
            let ends = y.interval.map_or([None; 2], |_| y.ends().map(|y| self.at(*x, y)));
            self.line(ends, color.stroke_width(2))?;
            for at in ends.into_iter().flatten() {
                let cap = EmptyElement::at(at)
                    + PathElement::new(vec![(-4, 0), (4, 0)], color.stroke_width(2));
                self.area.draw(&cap)?;
            }
            if let Some(at) = self.at(*x, y.median) {
                let shape =
                    EmptyElement::at(at) + Polygon::new(style::marker(index), color.filled());
                self.area.draw(&shape)?;
            }
        }
        Ok(())
    }

    /// The fitted line over the cells it was fitted to, dashed.
    fn fit(&self, ends: &[(f64, f64); 2], color: RGBColor) -> Drawn {
        const DASH_PX: f64 = 11.0;
        let [Some(a), Some(b)] = ends.map(|(x, y)| self.at(x, y)) else {
            return Ok(());
        };
        let at = |share: f64| Some((a.0 + share * (b.0 - a.0), a.1 + share * (b.1 - a.1)));
        let (width, height) = self.area.dim_in_pixel();
        let across = (b.0 - a.0) / (self.panel.x.high - self.panel.x.low) * f64::from(width);
        let up = (b.1 - a.1) / (self.panel.y.high - self.panel.y.low) * f64::from(height);
        let dashes = (across.hypot(up) / DASH_PX).ceil();
        for dash in 0..dashes as usize {
            let start = dash as f64 / dashes;
            let end = (dash as f64 + 0.6) / dashes;
            self.line([at(start), at(end)], color.stroke_width(2))?;
        }
        Ok(())
    }

    fn mark(&self, mark: &Mark) -> Drawn {
        let (low, high) = mark.span_ms;
        let ends = [self.at(mark.x, low), self.at(mark.x, high)];
        self.line(ends, style::INK.stroke_width(2))?;
        for at in ends.into_iter().flatten() {
            for ray in STAR {
                let shape = EmptyElement::at(at)
                    + PathElement::new(ray.to_vec(), style::INK.stroke_width(2));
                self.area.draw(&shape)?;
            }
        }
        Ok(())
    }
}
