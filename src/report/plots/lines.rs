//! Panels of series over a number: scaling plots (logarithmic, with fitted exponents) and linear ones. Few series share a chart
//! and are named at their ends; many are drawn as small charts side by side.

use itertools::{Itertools, MinMaxResult};
use maud::{Markup, html};

use super::drawing::{Drawing, MARGIN_PX, WIDTH_PX};
use super::{PlotInput, names, style};
use crate::axis::{Axis, ScaleKind, tenth};
use crate::facts::exponent;
use crate::series::{Series, Source};
use crate::svg::{Shape, apart, shortened, text_px, x_axis, y_axis};
use fathom_experiments::schema::{Plot, PlotKind, Published};
use fathom_experiments::{Measure, Scaling, groups, label_text};
use fathom_record::Cell;

/// Series that one chart can hold.
const MOST_TOGETHER: usize = 5;
/// Height of a chart between its axes, and from there to its end.
const HEIGHT_PX: f64 = 280.0;
const SMALL_HEIGHT_PX: f64 = 170.0;
const AXIS_PX: f64 = 50.0;
/// Room for the ordinate's title above a chart, and for its labels at the left.
const TITLE_PX: f64 = 24.0;
const LEFT_PX: f64 = 70.0;
/// A line of small type.
const ROW_PX: f64 = 16.0;
/// Most pixels for the names at the ends of lines.
const MOST_NAMES_PX: f64 = 230.0;
/// Characters of a name that fit there.
const NAME_CHARACTERS: usize = 34;
/// A name that is further than this from its line is joined to it.
const LEADER_FROM_PX: f64 = 8.0;

struct Chart<'p> {
    /// Empty where there is one chart.
    title: String,
    y_title: String,
    series: Vec<Series<'p>>,
    ends: [Axis; 2],
}

/// A measure of the cells of a group, by their places in the plot.
#[derive(Clone, Copy)]
struct Place {
    y: usize,
    group: usize,
}

/// What the charts of a plot are made from.
struct Lines<'p> {
    plot: &'p Plot,
    input: &'p PlotInput<'p>,
    x: &'p Measure,
    /// The cells that differ in the plot's axis only, by what they share.
    groups: Vec<(String, Vec<&'p Cell>)>,
    kind: ScaleKind,
    /// Cells of a category have no order.
    is_category: bool,
}

/// None where no series has a point.
pub fn drawing(plot: &Plot, input: &PlotInput<'_>) -> Option<Drawing> {
    let groups = match &plot.over {
        Some(over) => groups(&input.cells, over).into_iter().map(|(_, cells)| cells).collect(),
        None => vec![input.cells.clone()],
    };
    let named = |cells: Vec<_>| (names::group(plot, &cells, input.experiment), cells);
    let lines = Lines {
        plot,
        input,
        x: plot.x.as_ref()?,
        groups: groups.into_iter().map(named).collect(),
        kind: if plot.kind == PlotKind::Scaling { ScaleKind::Log } else { ScaleKind::Linear },
        is_category: plot.over.as_ref().is_some_and(|over| input.experiment.is_category(over)),
    };
    let mut charts = lines.charts();
    if lines.kind == ScaleKind::Log {
        // The same axes for all charts, so that they can be compared.
        let ends = lines.axes(charts.iter().flat_map(|chart| &chart.series))?;
        charts.iter_mut().for_each(|chart| chart.ends = ends.clone());
    }
    match charts.as_slice() {
        [] => None,
        [chart] => Some(lines.with_names(chart)),
        several => {
            let columns = if matches!(several.len(), 2 | 4) { 2 } else { 3 };
            let width_px = tenth(WIDTH_PX / columns as f64);
            let small = several.iter().map(|chart| lines.small(chart, width_px)).collect_vec();
            Some(Drawing::grid(&small, columns, width_px))
        }
    }
}

impl<'p> Lines<'p> {
    fn charts(&self) -> Vec<Chart<'p>> {
        let measures = 0..self.plot.y.len();
        let places = measures.cartesian_product(0..self.groups.len());
        let places = places.map(|(y, group)| Place { y, group }).collect_vec();
        let together = places.len() <= MOST_TOGETHER;
        let charts: Vec<Vec<Place>> = if together {
            vec![places]
        } else if self.plot.y.len() > 1 {
            places
                .into_iter()
                .chunk_by(|place| place.y)
                .into_iter()
                .map(|(_, of)| of.collect())
                .collect()
        } else {
            places.into_iter().map(|place| vec![place]).collect()
        };
        charts.iter().filter_map(|places| self.chart(places, together)).collect()
    }

    fn chart(&self, places: &[Place], together: bool) -> Option<Chart<'p>> {
        let measures = places.iter().map(|place| &self.plot.y[place.y]).dedup().collect_vec();
        let series = places.iter().map(|place| self.series(*place, measures.len() > 1));
        let series = series.filter(|series| !series.points.is_empty()).collect_vec();
        let title = match places {
            _ if together => String::new(),
            [only] if self.plot.y.len() == 1 => self.groups[only.group].0.clone(),
            several => names::measure(&self.plot.y[several.first()?.y]),
        };
        let y_title = names::y_title(self.plot, &measures);
        let ends = self.axes(&series)?;
        Some(Chart { title, y_title, series, ends })
    }

    /// Named by the measure where its chart has several, then by the group. Stages have colours of their own; groups of one measure
    /// are told apart by those of the palette.
    fn series(&self, place: Place, several: bool) -> Series<'p> {
        let y = &self.plot.y[place.y];
        let (group, cells) = &self.groups[place.group];
        let by_measure = several || group.is_empty();
        let names = by_measure.then(|| names::measure(y)).into_iter().chain([group.clone()]);
        let color = match y.stage_name().filter(|_| by_measure) {
            Some(stage) => self.input.colors.of(&stage),
            None => style::color(if several { place.y } else { place.group }),
        };
        let groups = if several { self.groups.len() } else { 0 };
        let factors = [(self.x, &self.plot.x_title), (y, &self.plot.y_title)];
        let source = Source {
            x: self.x,
            y,
            factors: factors.map(|(measure, title)| names::factor(measure, title.as_ref())),
            joined: !self.is_category,
            fitted: self.kind == ScaleKind::Log,
        };
        let name = names.filter(|name| !name.is_empty()).join(", ");
        source.read(cells, name, color.hex(), Shape::of(place.y * groups + place.group))
    }

    /// Axes that hold all points with what was published for them, of some length; none where an axis cannot be made.
    fn axes<'s>(&self, series: impl IntoIterator<Item = &'s Series<'s>>) -> Option<[Axis; 2]> {
        let series = series.into_iter().collect_vec();
        let xs = series.iter().flat_map(|series| &series.points).map(|point| point.x);
        let published = series.iter().flat_map(|series| self.published(series));
        let published = published.flat_map(|(_, span)| span);
        let ys = series.iter().flat_map(|series| series.ends()).chain(published);
        Some([Axis::fit(self.kind, xs, [0.0, 1.0])?, Axis::fit(self.kind, ys, [0.0, 1.0])?])
    }

    /// The published frame times of a series' cells, from the shortest to the longest, by x.
    fn published(&self, series: &Series<'_>) -> Vec<(f64, [f64; 2])> {
        let of_frames = *series.y == Measure::frame();
        let points = series.points.iter().filter(|_| of_frames);
        let published =
            points.filter_map(|point| Some((point.x, self.input.published(point.cell)?)));
        published.map(|(x, published)| (x, Published::span_ms(published))).collect()
    }

    /// The only chart of a panel, with names at the ends of its series.
    fn with_names(&self, chart: &Chart<'_>) -> Drawing {
        let remarks = |series: &Series<'_>| {
            let remarks = remarks(series);
            let parts = [&series.name].into_iter().chain(&remarks).filter(|part| !part.is_empty());
            parts.flat_map(|part| style::wrap(part, NAME_CHARACTERS)).collect_vec()
        };
        let names = chart.series.iter().map(remarks).collect_vec();
        let longest = names.iter().flatten().map(|line| text_px(line)).fold(0.0, f64::max);
        let right = tenth(WIDTH_PX - longest.min(MOST_NAMES_PX) - 36.0);
        let bottom = TITLE_PX + HEIGHT_PX;
        let axes = [chart.ends[0].along([LEFT_PX, right]), chart.ends[1].along([bottom, TITLE_PX])];
        let ends = chart.series.iter().map(|series| series.end_px(&axes[1])).collect_vec();
        let edges = ends.iter().map(|end| end - ROW_PX / 2.0).collect_vec();
        let heights = names.iter().map(|lines| lines.len() as f64 * ROW_PX + 4.0).collect_vec();
        let placed = apart(&edges, &heights, [TITLE_PX, bottom]);
        let content = html! {
            (self.plane(chart, [&axes[0], &axes[1]], [right, TITLE_PX, bottom]))
            @for (((series, lines), end), edge) in chart.series.iter().zip(&names).zip(ends).zip(placed) {
                @let middle = tenth(edge + ROW_PX / 2.0);
                @if series.joined && (middle - end).abs() > LEADER_FROM_PX {
                    line.leader x1=(right) y1=(end) x2=(right + 8.0) y2=(middle) {}
                }
                (mark(series, [right + 14.0, middle]))
                @for (row, line) in lines.iter().enumerate() {
                    text.small[row > 0] x=(right + 26.0) y=(tenth(middle + 4.0 + row as f64 * ROW_PX)) { (line) }
                }
            }
        };
        Drawing::new(bottom + AXIS_PX, content)
    }

    /// One of several charts, with its title and the names of its series above.
    fn small(&self, chart: &Chart<'_>, width_px: f64) -> Drawing {
        let told = chart.series.iter().map(|series| {
            let is_title = series.name == chart.title || chart.series.len() == 1;
            let name = Some(series.name.clone()).filter(|name| !is_title && !name.is_empty());
            let remarks = Some(remarks(series).join(", ")).filter(|line| !line.is_empty());
            name.into_iter().chain(remarks).join(": ")
        });
        let top = ROW_PX * (chart.series.len() + 1) as f64 + TITLE_PX;
        let [right, bottom] = [width_px - 14.0, top + SMALL_HEIGHT_PX];
        let axes = [chart.ends[0].along([LEFT_PX, right]), chart.ends[1].along([bottom, top])];
        let content = html! {
            text x=(MARGIN_PX) y="12" { (chart.title) }
            @for (row, (series, words)) in chart.series.iter().zip(told).enumerate() {
                @let middle = ROW_PX * (row as f64 + 1.0) + 8.0;
                (mark(series, [MARGIN_PX + 8.0, middle]))
                text.small x=(MARGIN_PX + 20.0) y=(middle + 4.0) { (words) }
            }
            (self.plane(chart, [&axes[0], &axes[1]], [right, top, bottom]))
        };
        Drawing::new(bottom + AXIS_PX, content)
    }

    /// Axes, lines, points, and what was published.
    fn plane(&self, chart: &Chart<'_>, axes: [&Axis; 2], [right, top, bottom]: [f64; 3]) -> Markup {
        let [x, y] = axes;
        let x_title = self.plot.x_title.clone().unwrap_or_else(|| self.x.label().text());
        let title = |title: &str| format!("{title}, {}", self.kind.name());
        let y_title = shortened(&title(&chart.y_title), right);
        html! {
            (x_axis(x, [top, bottom], &title(&x_title)))
            (Drawing::y_title(top, &y_title))
            (y_axis(y, [LEFT_PX, right], ""))
            @for series in &chart.series { (series.lines(axes)) }
            @for series in &chart.series { (series.marks(axes)) }
            @for ([x, y], name) in self.categories(chart, axes) {
                text.small x=(x) y=(y - 11.0) text-anchor="middle" { (name) }
            }
            @for (at, span) in chart.series.iter().flat_map(|series| self.published(series)) {
                @if let (Some(x), [Some(low), Some(high)]) = (x.px(at), span.map(|value| y.px(value))) {
                    line.line x1=(x) x2=(x) y1=(low) y2=(high) {}
                    @for y in [low, high] { line.published x1=(x - 6.0) x2=(x + 6.0) y1=(y) y2=(y) {} }
                }
            }
        }
    }

    /// Names of the values of a category, each above the uppermost of its points.
    fn categories(&self, chart: &Chart<'_>, [x, y]: [&Axis; 2]) -> Vec<([f64; 2], String)> {
        let Some(over) = self.plot.over.as_ref().filter(|_| self.is_category) else {
            return Vec::new();
        };
        let points = chart.series.iter().flat_map(|series| &series.points);
        let named = points.filter_map(|point| {
            let name = label_text(point.cell.axes.get(over)?);
            Some((name, [x.px(point.x)?, y.px(point.y.median)?]))
        });
        let by_name = named.into_grouping_map().min_by(|_, a, b| a[1].total_cmp(&b[1]));
        by_name.into_iter().map(|(name, at)| (at, name)).sorted_by(|a, b| a.1.cmp(&b.1)).collect()
    }
}

fn mark(series: &Series<'_>, at: [f64; 2]) -> Markup {
    html! { path d=(series.shape.path(at)) fill=(series.color) {} }
}

/// The fitted exponent, and the number of samples.
fn remarks(series: &Series<'_>) -> Vec<String> {
    let counts = series.points.iter().filter_map(|point| point.n);
    let counts = match counts.minmax() {
        MinMaxResult::NoElements => None,
        MinMaxResult::MinMax(least, most) if least < most => Some(format!("n = {least} – {most}")),
        MinMaxResult::OneElement(n) | MinMaxResult::MinMax(n, _) => Some(format!("n = {n}")),
    };
    series.fitted().map(fitted).into_iter().chain(counts).collect()
}

fn fitted(fit: &Scaling) -> String {
    let left_out = match fit.left_out {
        0 => String::new(),
        cells => format!(", {cells} left out"),
    };
    format!("exponent {}{left_out}", exponent(fit))
}
