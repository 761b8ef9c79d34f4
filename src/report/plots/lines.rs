//! Panels of series over a number: scaling plots (logarithmic, with fitted exponents) and linear ones. Few series share a chart
//! and are named at their ends; many are drawn as small charts side by side.

mod draw;

use itertools::{Itertools, MinMaxResult};
use plotters::prelude::*;

use super::chart::Mark;
use super::{Area, Drawn, Panel, PlotInput, WIDTH_PX, names, style};
use crate::axis::{Scale, ScaleKind};
use crate::colors::StageColors;
use crate::facts::exponent;
use crate::series;
use fathom_experiments::schema::{Plot, PlotKind, Published};
use fathom_experiments::{Measure, Scaling, groups, label_text};
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
    fit: Option<[[f64; 2]; 2]>,
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
    published: Option<[f64; 2]>,
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
    let of_all = |ends: fn(&[Series]) -> Vec<f64>| {
        Scale::fit(ScaleKind::Log, charts.iter().flat_map(|chart| ends(&chart.series)))
    };
    let (x, y) = (of_all(xs)?, of_all(ys)?);
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
            several => names::measure(several.first()?.y),
        };
        Some(Chart {
            title,
            x_title: plot.x_title.clone().unwrap_or_else(|| x_measure.label().text()),
            y_title: names::y_title(plot, &measures),
            x: Scale::fit(kind, xs(&series))?,
            y: Scale::fit(kind, ys(&series))?,
            series,
        })
    }

    fn points(&self) -> impl Iterator<Item = &Point> {
        self.series.iter().flat_map(|series| &series.points)
    }
}

fn xs(series: &[Series]) -> Vec<f64> {
    series.iter().flat_map(|series| &series.points).map(|point| point.x).collect()
}

fn ys(series: &[Series]) -> Vec<f64> {
    let of = |point: &Point| {
        let [low, high] = point.y.ends();
        [low, point.y.median, high].into_iter().chain(point.published.into_iter().flatten())
    };
    series.iter().flat_map(|series| &series.points).flat_map(of).collect()
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
        let fitted = plot.kind == PlotKind::Scaling;
        let figures = series::Source { x, y, factors, joined: !is_category, fitted };
        let figures = figures.read(&source.cells);
        let point = |point: &series::Point<'_>| {
            let name = plot.over.as_ref().filter(|_| is_category);
            let published = input.published(point.cell).filter(|_| *y == Measure::frame());
            Point {
                x: point.x,
                y: point.y,
                name: name.and_then(|over| point.cell.axes.get(over)).map(label_text),
                published: published.map(Published::span_ms),
            }
        };
        let fit = figures.fitted();
        let remarks = [fit.map(remark), counts(figures.points.iter().filter_map(|point| point.n))];
        Series {
            name: source.name(measures),
            remarks: remarks.into_iter().flatten().collect(),
            color: source.color(measures),
            marker: source.marker(measures),
            points: figures.points.iter().map(point).collect(),
            joined: figures.joined,
            fit: fit.map(|fit| figures.ends_of(fit)),
        }
    }
}

impl Source<'_> {
    /// The measure where a chart has several, then the group.
    fn name(&self, measures: &[&Measure]) -> String {
        let measure = (measures.len() > 1 || self.group.is_empty()).then(|| names::measure(self.y));
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
