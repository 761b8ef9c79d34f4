//! Panels of series over a number: scaling plots (logarithmic, with fitted exponents) and linear ones. Few series share a chart
//! and are named at their ends; many are drawn as small charts side by side.

mod draw;

use itertools::{Itertools, MinMaxResult};
use plotters::prelude::*;

use super::chart::Mark;
use super::scale::{Scale, ScaleKind};
use super::{Area, Drawn, Panel, PlotInput, WIDTH_PX, names, style};
use crate::colors::StageColors;
use crate::facts::exponent;
use fathom_experiments::schema::{FIXED_SHARE, Plot, PlotKind, Published};
use fathom_experiments::{Measure, Scaling, groups, label_text, scaling};
use fathom_record::{Cell, Estimate};

/// Series that one chart can hold.
const MOST_TOGETHER: usize = 5;
/// Height of a chart with its axis.
const HEIGHT_PX: u32 = 350;
const SMALL_HEIGHT_PX: u32 = 240;
/// A line of small type, and a chart's own title.
const ROW_PX: i32 = 16;
const TITLE_PX: i32 = 22;
/// Most pixels for the names at the ends of lines.
const MOST_NAMES_PX: u32 = 230;

pub struct Lines {
    charts: Vec<Chart>,
}

struct Chart {
    /// Empty where there is one chart.
    title: String,
    x_title: String,
    y_title: String,
    x: Scale,
    y: Scale,
    series: Vec<Series>,
}

struct Series {
    /// What tells it from the others of its chart; may be empty where it is alone.
    name: String,
    /// The fitted exponent and the number of samples.
    remarks: Vec<String>,
    color: SeriesColor,
    marker: usize,
    points: Vec<Point>,
    /// Whether lines join the points.
    joined: bool,
    /// Ends of the fitted line, in the plot's units.
    fit: Option<[(f64, f64); 2]>,
}

#[derive(Clone)]
enum SeriesColor {
    Stage(String),
    Number(usize),
}

impl SeriesColor {
    fn of(&self, colors: &StageColors) -> RGBColor {
        match self {
            SeriesColor::Stage(stage) => style::of_stage(colors.of(stage)),
            SeriesColor::Number(number) => style::color(*number),
        }
    }
}

/// A cell, in the plot's units.
struct Point {
    x: f64,
    y: Estimate,
    /// Of a category: its value on the axis.
    name: Option<String>,
    /// From the shortest to the longest published frame time.
    published: Option<(f64, f64)>,
}

/// A measure of the cells of a group, and where it stands in the plot.
struct Source<'p> {
    y: &'p Measure,
    place: usize,
    group: String,
    group_place: usize,
    groups: usize,
    cells: Vec<&'p Cell>,
}

impl Lines {
    /// None where no series has a point.
    pub fn new(plot: &Plot, input: &PlotInput<'_>) -> Option<Lines> {
        let sources = sources(plot, input);
        let together = sources.len() <= MOST_TOGETHER;
        let charts: Vec<Vec<&Source<'_>>> = if together {
            vec![sources.iter().collect()]
        } else if plot.y.len() > 1 {
            (0..plot.y.len()).map(|y| sources.iter().filter(|s| s.place == y).collect()).collect()
        } else {
            sources.iter().map(|source| vec![source]).collect()
        };
        let charts = charts.iter().filter_map(|sources| Chart::new(plot, sources, together, input));
        let mut charts: Vec<Chart> = charts.collect();
        if plot.kind == PlotKind::Scaling {
            share_scales(&mut charts)?;
        }
        (!charts.is_empty()).then_some(Lines { charts })
    }

    /// Charts side by side.
    fn columns(&self) -> usize {
        match self.charts.len() {
            1 => 1,
            2 | 4 => 2,
            _ => 3,
        }
    }

    /// Height of the lines above a small chart.
    fn head_px(&self) -> u32 {
        let lines = self.charts.iter().map(|chart| chart.series.len()).max().unwrap_or(0) as i32;
        (TITLE_PX + lines * ROW_PX) as u32
    }

    fn row_px(&self) -> u32 {
        if self.charts.len() == 1 { HEIGHT_PX } else { self.head_px() + SMALL_HEIGHT_PX }
    }
}

impl Panel for Lines {
    fn height_px(&self) -> u32 {
        self.charts.len().div_ceil(self.columns()) as u32 * self.row_px()
    }

    fn draw(&self, area: &Area<'_>, colors: &StageColors) -> Drawn {
        if let [chart] = self.charts.as_slice() {
            return chart.draw_with_names(area, colors);
        }
        let width = WIDTH_PX / self.columns() as u32;
        let mut rest = area.clone();
        for row in self.charts.chunks(self.columns()) {
            let (mut line, below) = rest.split_vertically(self.row_px());
            for chart in row {
                let (place, right) = line.split_horizontally(width);
                chart.draw_small(&place, self.head_px(), colors)?;
                line = right;
            }
            rest = below;
        }
        Ok(())
    }
}

/// The same scales for all charts, so that they can be compared; none where a scale cannot be made.
fn share_scales(charts: &mut [Chart]) -> Option<()> {
    let of_all =
        |ends: fn(&Chart) -> Vec<f64>| Scale::fit(ScaleKind::Log, charts.iter().flat_map(ends));
    let (x, y) = (of_all(Chart::xs)?, of_all(Chart::ys)?);
    for chart in charts {
        (chart.x, chart.y) = (x.clone(), y.clone());
    }
    Some(())
}

fn sources<'p>(plot: &'p Plot, input: &PlotInput<'p>) -> Vec<Source<'p>> {
    let groups: Vec<(String, Vec<&Cell>)> = match &plot.over {
        Some(over) => groups(&input.cells, over),
        None => vec![(String::new(), input.cells.clone())],
    };
    let count = groups.len();
    let of = |(place, y): (usize, &'p Measure)| {
        let groups = groups.iter().enumerate();
        let of_group = groups.map(move |(group_place, (_, cells))| Source {
            y,
            place,
            group: names::group(plot, cells, input.experiment),
            group_place,
            groups: count,
            cells: cells.clone(),
        });
        of_group.collect::<Vec<_>>()
    };
    plot.y.iter().enumerate().flat_map(of).collect()
}

fn y_name(y: &Measure) -> String {
    y.stage_name().unwrap_or_else(|| y.label().words)
}

impl Chart {
    fn new(
        plot: &Plot,
        sources: &[&Source<'_>],
        together: bool,
        input: &PlotInput<'_>,
    ) -> Option<Chart> {
        let x_measure = plot.x.as_ref()?;
        let measures: Vec<&Measure> = sources.iter().map(|s| s.y).dedup().collect();
        let series =
            sources.iter().map(|source| Series::new(plot, x_measure, source, &measures, input));
        let series: Vec<Series> = series.filter(|series| !series.points.is_empty()).collect();
        let kind = match plot.kind {
            PlotKind::Scaling => ScaleKind::Log,
            _ => ScaleKind::Linear,
        };
        let title = match sources {
            _ if together => String::new(),
            [only] if plot.y.len() == 1 => only.group.clone(),
            several => y_name(several.first()?.y),
        };
        let mut chart = Chart {
            title,
            x_title: plot.x_title.clone().unwrap_or_else(|| x_measure.label().text()),
            y_title: names::y_title(plot, &measures),
            x: Scale::fit(kind, [1.0].into_iter())?,
            y: Scale::fit(kind, [1.0].into_iter())?,
            series,
        };
        chart.x = Scale::fit(kind, chart.xs().into_iter())?;
        chart.y = Scale::fit(kind, chart.ys().into_iter())?;
        Some(chart)
    }

    fn points(&self) -> impl Iterator<Item = &Point> {
        self.series.iter().flat_map(|series| &series.points)
    }

    fn xs(&self) -> Vec<f64> {
        self.points().map(|point| point.x).collect()
    }

    fn ys(&self) -> Vec<f64> {
        let of = |point: &Point| {
            let [low, high] = point.y.ends();
            let published = point.published.map(|(low, high)| [low, high]);
            [low, point.y.median, high].into_iter().chain(published.into_iter().flatten())
        };
        self.points().flat_map(of).collect()
    }
}

impl Series {
    fn new(
        plot: &Plot,
        x: &Measure,
        source: &Source<'_>,
        measures: &[&Measure],
        input: &PlotInput<'_>,
    ) -> Series {
        let y = source.y;
        let factors = [(x, &plot.x_title), (y, &plot.y_title)]
            .map(|(measure, title)| names::factor(measure, title.as_ref()));
        let is_category = plot.over.as_ref().is_some_and(|over| input.experiment.is_category(over));
        let point = |cell: &&Cell| {
            let measured = cell.measured()?;
            let reading = y.read(cell, measured)?;
            let name = plot.over.as_ref().filter(|_| is_category);
            let published = input.published(cell).filter(|_| *y == Measure::frame());
            let point = Point {
                x: x.read(cell, measured)?.median() * factors[0],
                y: reading.estimate().scaled(factors[1]),
                name: name.and_then(|over| cell.axes.get(over)).map(label_text),
                published: published.map(Published::span_ms),
            };
            Some((point, reading.n()))
        };
        let read: Vec<(Point, Option<usize>)> = source.cells.iter().filter_map(point).collect();
        let counts = counts(read.iter().filter_map(|(_, n)| *n));
        let mut points: Vec<Point> = read.into_iter().map(|(point, _)| point).collect();
        points.sort_by(|a, b| a.x.total_cmp(&b.x));
        let is_fitted = plot.kind == PlotKind::Scaling && !is_category;
        let fit = is_fitted.then(|| scaling(y, x, &source.cells, FIXED_SHARE).ok()).flatten();
        let remarks = [fit.as_ref().map(remark), counts];
        Series {
            name: source.name(measures),
            remarks: remarks.into_iter().flatten().collect(),
            color: source.color(measures),
            marker: source.marker(measures),
            points,
            joined: !is_category,
            fit: fit.map(|fit| ends(&fit, factors)),
        }
    }
}

impl Source<'_> {
    /// The measure where a chart has several, then the group.
    fn name(&self, measures: &[&Measure]) -> String {
        let measure = (measures.len() > 1 || self.group.is_empty()).then(|| y_name(self.y));
        let group = Some(self.group.clone()).filter(|group| !group.is_empty());
        measure.into_iter().chain(group).join(", ")
    }

    /// Stages have their own; groups of one measure are told apart by colours of the palette.
    fn color(&self, measures: &[&Measure]) -> SeriesColor {
        match self.y.stage_name() {
            Some(stage) if measures.len() > 1 || self.group.is_empty() => SeriesColor::Stage(stage),
            _ if measures.len() > 1 => SeriesColor::Number(self.place),
            _ => SeriesColor::Number(self.group_place),
        }
    }

    /// Another one for each series of a chart.
    fn marker(&self, measures: &[&Measure]) -> usize {
        match measures {
            [_] => self.group_place,
            _ => self.place * self.groups + self.group_place,
        }
    }
}

fn ends(fit: &Scaling, [x_factor, y_factor]: [f64; 2]) -> [(f64, f64); 2] {
    [fit.range.0, fit.range.1].map(|x| {
        let y = (fit.slope.intercept + fit.slope.slope * x.ln()).exp();
        (x * x_factor, y * y_factor)
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
    let left_out = match fit.left_out {
        0 => String::new(),
        cells => format!(", {cells} left out"),
    };
    format!("exponent {}{left_out}", exponent(fit))
}
