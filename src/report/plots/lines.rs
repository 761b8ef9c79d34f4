//! Panels of series over a number: scaling plots (logarithmic, with fitted exponents) and linear ones. Few series share a chart
//! and are named at their ends; many are drawn as small charts side by side.

mod draw;

use itertools::Itertools;
use plotters::prelude::*;
use serde_json::Value;

use super::chart::Mark;
use super::{Area, Drawn, Panel, PlotInput, WIDTH_PX, names, style};
use crate::axis::{Scale, ScaleKind};
use crate::facts::exponent;
use crate::series::{Figures, Point, Source};
use crate::svg::Marker;
use fathom_experiments::schema::{Plot, PlotKind, Published};
use fathom_experiments::{Measure, groups, label_text};
use fathom_record::Cell;

/// Series that one chart can hold.
const MOST_TOGETHER: usize = 5;
/// Height of a chart with its axis.
const HEIGHT_PX: u32 = 350;
const SMALL_HEIGHT_PX: u32 = 320;
/// A line of small type, and a chart's own title.
const ROW_PX: i32 = 16;
const TITLE_PX: i32 = 22;
/// Most pixels for the names at the ends of lines.
const MOST_NAMES_PX: u32 = 230;

pub struct Lines<'s> {
    charts: Vec<Chart<'s>>,
}

struct Chart<'s> {
    /// Empty where there is one chart.
    title: String,
    x_title: String,
    y_title: String,
    x: Scale,
    y: Scale,
    series: Vec<Series<'s>>,
    /// The axis whose values are categories, which stand above the points.
    category: Option<&'s str>,
}

struct Series<'s> {
    /// What tells it from the others of its chart; may be empty where it is alone.
    name: String,
    color: RGBColor,
    marker: Marker,
    figures: Figures<'s>,
    input: &'s PlotInput<'s>,
}

/// A measure of the cells of a group, and where both stand in the plot.
struct Part<'s> {
    y: &'s Measure,
    place: usize,
    /// What its cells share on the other axes.
    group: String,
    group_place: usize,
    groups: usize,
    cells: Vec<&'s Cell>,
}

impl<'s> Lines<'s> {
    /// None where no series has a point.
    pub fn new(plot: &'s Plot, input: &'s PlotInput<'s>) -> Option<Lines<'s>> {
        let parts = parts(plot, input);
        let together = parts.len() <= MOST_TOGETHER;
        let chart_of = |part: &Part<'_>| match plot.y.len() {
            _ if together => 0,
            1 => part.group_place,
            _ => part.place,
        };
        let charts = parts.chunk_by(|a, b| chart_of(a) == chart_of(b));
        let charts = charts.filter_map(|parts| Chart::new(plot, parts, together, input));
        let mut charts: Vec<Chart<'_>> = charts.collect();
        if plot.kind == PlotKind::Scaling {
            share_scales(&mut charts)?;
        }
        (!charts.is_empty()).then_some(Lines { charts })
    }

    /// Charts side by side: as many as the names of their series have room for.
    fn columns(&self) -> usize {
        let most = match self.charts.len() {
            1 => 1,
            2 | 4 => 2,
            _ => 3,
        };
        let names_px = self.charts.iter().map(Chart::names_px).max().unwrap_or(0);
        (2..=most).rev().find(|columns| names_px <= WIDTH_PX / *columns as u32).unwrap_or(1)
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

impl Panel for Lines<'_> {
    fn height_px(&self) -> u32 {
        self.charts.len().div_ceil(self.columns()) as u32 * self.row_px()
    }

    fn draw(&self, area: &Area<'_>) -> Drawn {
        if let [chart] = self.charts.as_slice() {
            return chart.draw_with_names(area);
        }
        let width = WIDTH_PX / self.columns() as u32;
        let mut rest = area.clone();
        for row in self.charts.chunks(self.columns()) {
            let (mut line, below) = rest.split_vertically(self.row_px());
            for chart in row {
                let (place, right) = line.split_horizontally(width);
                chart.draw_small(&place, self.head_px())?;
                line = right;
            }
            rest = below;
        }
        Ok(())
    }
}

/// The same scales for all charts, so that they can be compared; none where a scale cannot be made.
fn share_scales(charts: &mut [Chart<'_>]) -> Option<()> {
    let all = || charts.iter().flat_map(|chart| &chart.series);
    let x = Scale::fit(ScaleKind::Log, all().flat_map(Series::xs))?;
    let y = Scale::fit(ScaleKind::Log, all().flat_map(Series::ys))?;
    for chart in charts {
        (chart.x, chart.y) = (x.clone(), y.clone());
    }
    Some(())
}

fn parts<'s>(plot: &'s Plot, input: &PlotInput<'s>) -> Vec<Part<'s>> {
    let groups: Vec<Vec<&Cell>> = match &plot.over {
        Some(over) => groups(&input.cells, over).into_iter().map(|(_, cells)| cells).collect(),
        None => vec![input.cells.clone()],
    };
    let pairs = plot.y.iter().enumerate().cartesian_product(groups.iter().enumerate());
    let part = |((place, y), (group_place, cells)): ((usize, _), (usize, &Vec<&'s Cell>))| Part {
        y,
        place,
        group: names::group(plot, cells, input.experiment),
        group_place,
        groups: groups.len(),
        cells: cells.clone(),
    };
    pairs.map(part).collect()
}

impl<'s> Chart<'s> {
    fn new(
        plot: &'s Plot,
        parts: &[Part<'s>],
        together: bool,
        input: &'s PlotInput<'s>,
    ) -> Option<Chart<'s>> {
        let kind = match plot.kind {
            PlotKind::Scaling => ScaleKind::Log,
            _ => ScaleKind::Linear,
        };
        let x = plot.x.as_ref()?;
        let several = together && plot.y.len() > 1;
        let series = parts.iter().map(|part| Series::new(plot, x, part, several, input));
        let mut series: Vec<Series<'_>> =
            series.filter(|series| !series.figures.points.is_empty()).collect();
        // What would hide another is drawn once, under both names.
        for hidden in (1..series.len()).rev() {
            let same = |other: &Series<'_>| other.figures.coincides(&series[hidden].figures);
            if let Some(place) = series[..hidden].iter().position(same) {
                let name = series.remove(hidden).name;
                series[place].name += &format!("; {name}");
            }
        }
        let first = parts.first()?;
        Some(Chart {
            title: match plot.y.len() {
                _ if together => String::new(),
                1 => first.group.clone(),
                _ => names::measure(first.y),
            },
            x_title: plot.x_title.clone().unwrap_or_else(|| x.label().text()),
            y_title: names::y_title(plot, (!several).then_some(first.y)),
            x: Scale::fit(kind, series.iter().flat_map(Series::xs))?,
            y: Scale::fit(kind, series.iter().flat_map(Series::ys))?,
            category: plot.over.as_deref().filter(|over| input.experiment.is_category(over)),
            series,
        })
    }

    /// Of a category: its value on the axis.
    fn category_of<'p>(&self, point: &Point<'p>) -> Option<&'p Value> {
        point.cell.axes.get(self.category?)
    }
}

impl<'s> Series<'s> {
    /// `several`: its chart has several measures. A stage has its colour; else measures, or groups of one, have those of the palette.
    fn new(
        plot: &'s Plot,
        x: &'s Measure,
        part: &Part<'s>,
        several: bool,
        input: &'s PlotInput<'s>,
    ) -> Series<'s> {
        let Part { y, place, group_place, groups, .. } = *part;
        let factors = [(x, &plot.x_title), (y, &plot.y_title)]
            .map(|(measure, title)| names::factor(measure, title.as_ref()));
        let joined = plot.over.as_ref().is_none_or(|over| !input.experiment.is_category(over));
        let fitted = plot.kind == PlotKind::Scaling;
        let is_named = several || part.group.is_empty();
        let name = is_named.then(|| names::measure(y));
        let group = Some(part.group.clone()).filter(|group| !group.is_empty());
        Series {
            name: name.into_iter().chain(group).join(", "),
            color: match y.stage_name().filter(|stage| input.colors.has(stage)) {
                Some(stage) => style::of_stage(input.colors.of(&stage)),
                _ if several => style::color(place),
                _ => style::color(group_place),
            },
            marker: Marker::of(if several { place * groups + group_place } else { group_place }),
            figures: Source { x, y, factors, joined, fitted }.read(&part.cells),
            input,
        }
    }

    /// From the shortest to the longest published frame time of a point.
    fn published(&self, point: &Point<'_>) -> Option<[f64; 2]> {
        self.input.published(point.cell, self.figures.y).map(Published::span_ms)
    }

    fn xs(&self) -> impl Iterator<Item = f64> {
        self.figures.points.iter().map(|point| point.x)
    }

    fn ys(&self) -> impl Iterator<Item = f64> {
        let published = self.figures.points.iter().filter_map(|point| self.published(point));
        self.figures.ends().chain(published.flatten())
    }

    /// The fitted exponent, and the fewest and the most samples of a point where not all are exact.
    fn remarks(&self) -> Vec<String> {
        let exponent = self.figures.fitted().map(|fit| match fit.left_out {
            0 => format!("exponent {}", exponent(fit)),
            cells => format!("exponent {}, {cells} left out", exponent(fit)),
        });
        let counts = self.figures.points.iter().filter_map(|point| point.n);
        let counts = counts.minmax().into_option().map(|counts| match counts {
            (least, most) if least == most => format!("n = {least}"),
            (least, most) => format!("n = {least} – {most}"),
        });
        exponent.into_iter().chain(counts).collect()
    }
}
