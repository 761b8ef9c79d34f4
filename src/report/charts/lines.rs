//! Panels of series over a number: scaling plots (logarithmic, with fitted exponents) and linear ones. Few series share a chart
//! and are named at their ends; many are drawn as small charts side by side.

use indexmap::IndexMap;
use itertools::Itertools;

use super::points::{MAX_Y_TITLE, Point, PointChart, Series};
use super::style::Marker;
use super::{Area, DrawResult, Panel, PlotInput, WIDTH_PX, names, style};
use crate::axis::{Scale, ScaleKind};
use crate::facts::{exponent, grown_exponent};
use crate::format::interval;
use crate::sizes;
use fathom_experiments::schema::{FIXED_SHARE, Plot, PlotKind, Published};
use fathom_experiments::{Measure, groups, label_text, scaling};
use fathom_record::Cell;

/// Series that one chart can hold: as many as the palette has colours.
const MAX_TOGETHER: usize = 7;
/// Height of a chart with its axis.
const HEIGHT_PX: u32 = 350;
const SMALL_HEIGHT_PX: u32 = 320;

pub struct LineCharts {
    charts: Vec<PointChart>,
}

/// A measure of the cells of a group, and where both stand in the plot.
struct LineGroup<'s> {
    y: &'s Measure,
    place: usize,
    /// What its cells share on the other axes.
    group: String,
    group_place: usize,
    groups: usize,
    cells: Vec<&'s Cell>,
}

impl LineCharts {
    /// None where no series has a point.
    pub fn new(plot: &Plot, input: &PlotInput<'_>) -> Option<LineCharts> {
        let mut charts: Vec<PointChart> = panels(plot, input)
            .iter()
            .flat_map(|(title, input)| panel_charts(plot, title, input))
            .collect();
        if plot.kind == PlotKind::Scaling || plot.y.len() == 1 {
            share_scales(&mut charts)?;
        }
        (!charts.is_empty()).then_some(LineCharts { charts })
    }

    /// The only chart.
    pub fn into_single(self) -> Option<PointChart> {
        self.charts.into_iter().exactly_one().ok()
    }

    /// Charts side by side: as many as the names of their series have room for.
    fn columns(&self) -> usize {
        let max_columns = match self.charts.len() {
            1 => 1,
            2 | 4 => 2,
            _ => 3,
        };
        let names_px = self.charts.iter().map(PointChart::names_px).max().unwrap_or(0);
        (2..=max_columns).rev().find(|columns| names_px <= WIDTH_PX / *columns as u32).unwrap_or(1)
    }

    fn head_px(&self) -> u32 {
        self.charts.iter().map(PointChart::head_px).max().unwrap_or_default()
    }

    fn row_px(&self) -> u32 {
        if self.charts.len() == 1 { HEIGHT_PX } else { self.head_px() + SMALL_HEIGHT_PX }
    }
}

impl Panel for LineCharts {
    fn height_px(&self) -> u32 {
        self.charts.len().div_ceil(self.columns()) as u32 * self.row_px()
    }

    fn draw(&self, area: &Area<'_>) -> DrawResult {
        if let [chart @ PointChart { title, .. }] = self.charts.as_slice()
            && title.is_empty()
        {
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
fn share_scales(charts: &mut [PointChart]) -> Option<()> {
    let all = || charts.iter().flat_map(|chart| &chart.series);
    let kind = charts.first()?.x.kind;
    let x = Scale::fit(kind, all().flat_map(Series::xs))?.with_sizes(all().flat_map(Series::xs));
    let y = Scale::fit(kind, all().flat_map(Series::ys))?;
    for chart in charts {
        (chart.x, chart.y) = (x.clone(), y.clone());
    }
    Some(())
}

/// The cells by their values on the axes that have charts of their own, each with its title.
fn panels<'s>(plot: &Plot, input: &PlotInput<'s>) -> IndexMap<String, PlotInput<'s>> {
    let mut panels = IndexMap::new();
    for cell in &input.cells {
        let value = |axis: &String| {
            cell.axes.get(axis).map(|value| names::value(axis, value, input.experiment))
        };
        let title = plot.panels.iter().filter_map(value).join(", ");
        let panel =
            panels.entry(title).or_insert_with(|| PlotInput { cells: Vec::new(), ..*input });
        panel.cells.push(*cell);
    }
    panels
}

fn panel_charts(plot: &Plot, panel: &str, input: &PlotInput<'_>) -> Vec<PointChart> {
    let parts = parts(plot, input);
    let together = parts.len() <= MAX_TOGETHER;
    let chart_of = |part: &LineGroup<'_>| match plot.y.len() {
        _ if together => 0,
        1 => part.group_place,
        _ => part.place,
    };
    let charts = parts.chunk_by(|a, b| chart_of(a) == chart_of(b));
    let charts = charts.filter_map(|parts| chart(plot, parts, together, input));
    let titled = charts.map(|chart| {
        let title = [panel, &chart.title].into_iter().filter(|part| !part.is_empty()).join(", ");
        PointChart { title, ..chart }
    });
    titled.collect()
}

fn parts<'s>(plot: &'s Plot, input: &PlotInput<'s>) -> Vec<LineGroup<'s>> {
    let groups: Vec<Vec<&Cell>> = match &plot.over {
        Some(over) => groups(&input.cells, over).into_iter().map(|(_, cells)| cells).collect(),
        None => vec![input.cells.clone()],
    };
    // A sweep names all stages of its pipeline.
    let is_drawn = |y: &&Measure| {
        let stage = y.stage_name().filter(|_| input.experiment.knee_share.is_some());
        let mut measured = input.cells.iter().filter_map(|cell| cell.measured());
        stage.is_none_or(|name| measured.any(|of| of.is_timed() && !sizes::is_small(of, &name)))
    };
    let mut parts = Vec::new();
    for (place, y) in plot.y.iter().filter(is_drawn).enumerate() {
        parts.extend(groups.iter().enumerate().map(|(group_place, cells)| LineGroup {
            y,
            place,
            group: names::group(plot, cells, input.experiment),
            group_place,
            groups: groups.len(),
            cells: cells.clone(),
        }));
    }
    parts
}

fn chart(
    plot: &Plot,
    parts: &[LineGroup<'_>],
    together: bool,
    input: &PlotInput<'_>,
) -> Option<PointChart> {
    let kind = match plot.kind {
        PlotKind::Scaling => ScaleKind::Log,
        _ => ScaleKind::Linear,
    };
    let measure = plot.x.as_ref()?;
    let several = together && plot.y.len() > 1;
    let mut all: Vec<(&Measure, Series)> = Vec::new();
    for part in parts {
        let series = series(plot, measure, part, several, input);
        // What would hide another is drawn once, under both names.
        match all.iter_mut().find(|(y, other)| *y == part.y && coincide(other, &series)) {
            _ if series.points.is_empty() => {}
            Some((_, other)) => other.name += &format!("; {}", series.name),
            None => all.push((part.y, series)),
        }
    }
    let series: Vec<Series> = all.into_iter().map(|(_, series)| series).collect();
    let first = parts.first()?;
    let xs = || series.iter().flat_map(Series::xs);
    let x = Scale::fit(kind, xs())?.with_sizes(xs());
    let y = Scale::fit(kind, series.iter().flat_map(Series::ys))?;
    let x_title = plot.x_title.clone().unwrap_or_else(|| measure.label().text());
    let y_title = names::y_title(plot, (!several).then_some(first.y));
    Some(PointChart {
        title: match plot.y.len() {
            _ if together => String::new(),
            1 => first.group.clone(),
            _ => names::measure(first.y),
        },
        x_title: format!("{x_title}, {} scale", kind.name()),
        y_title: format!("{}, {}", style::truncate(&y_title, MAX_Y_TITLE), kind.name()),
        x,
        y,
        series,
        changes: Vec::new(),
    })
}

/// One would hide the other.
fn coincide(a: &Series, b: &Series) -> bool {
    let places =
        |series: &Series| series.points.iter().map(|point| [point.x, point.y.median]).collect_vec();
    places(a) == places(b)
}

/// `several`: its chart has several measures. A stage has its colour; else measures, or groups of one, have those of the palette.
fn series(
    plot: &Plot,
    x: &Measure,
    part: &LineGroup<'_>,
    several: bool,
    input: &PlotInput<'_>,
) -> Series {
    let LineGroup { y, place, group_place, groups, .. } = *part;
    let factors = [(x, &plot.x_title), (y, &plot.y_title)]
        .map(|(measure, title)| names::factor(measure, title.as_ref()));
    let category = plot.over.as_ref().filter(|over| input.experiment.is_category(over));
    let is_sweep = input.experiment.knee_share.is_some() && y.is_time();
    let max_fixed = if is_sweep { f64::INFINITY } else { FIXED_SHARE };
    let fit = (category.is_none() && plot.kind == PlotKind::Scaling)
        .then(|| scaling(y, x, &part.cells, max_fixed).ok())
        .flatten();
    let mut counts = Vec::new();
    let point = |cell: &&Cell| {
        let measured = cell.measured()?;
        let reading = y.read(cell, measured)?;
        let x = x.read(cell, measured)?.median() * factors[0];
        let value = reading.figure().scaled(factors[1]);
        counts.extend(reading.n());
        let n = reading.n().map_or_else(String::new, |n| format!(", n = {n}"));
        Some(Point {
            x,
            tip: format!("{}: {}{n}", cell.cell, interval(&value)),
            y: value,
            category: category.and_then(|over| cell.axes.get(over)).map(label_text),
            published: input.published(cell, y).map(Published::span_ms),
        })
    };
    let points = part.cells.iter().filter_map(point);
    let points = points.sorted_by(|a, b| a.x.total_cmp(&b.x)).collect_vec();
    let min_y =
        points.iter().map(|point| point.y.median / factors[1]).fold(f64::INFINITY, f64::min);
    let grown = fit.as_ref().map(|fit| match fit.left_out {
        _ if is_sweep => grown_exponent(fit, min_y),
        0 => exponent(fit),
        cells => format!("{}, {cells} left out", exponent(fit)),
    });
    let is_named = several || part.group.is_empty();
    let name = is_named.then(|| names::measure(y));
    let group = Some(part.group.clone()).filter(|group| !group.is_empty());
    Series {
        name: name.into_iter().chain(group).join(", "),
        remarks: remarks(grown, counts),
        color: match y.stage_name().filter(|stage| input.colors.has(stage)) {
            Some(stage) => style::stage_color(input.colors.color(&stage)),
            _ if several => style::color(place),
            _ => style::color(group_place),
        },
        marker: Marker::nth(if several { place * groups + group_place } else { group_place }),
        points,
        is_joined: category.is_none(),
        fit: fit.map(|fit| {
            [fit.range.0, fit.range.1].map(|x| {
                let y = (fit.slope.intercept + fit.slope.slope * x.ln()).exp();
                [x * factors[0], y * factors[1]]
            })
        }),
    }
}

/// The fitted exponent, and the fewest and the most samples of a point where not all are exact.
fn remarks(exponent: Option<String>, counts: Vec<usize>) -> Vec<String> {
    let exponent = exponent.map(|exponent| format!("exponent {exponent}"));
    let counts = counts.into_iter().minmax().into_option().map(|counts| match counts {
        (min, max) if min == max => format!("n = {min}"),
        (min, max) => format!("n = {min} – {max}"),
    });
    exponent.into_iter().chain(counts).collect()
}
