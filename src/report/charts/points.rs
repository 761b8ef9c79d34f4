//! Charts of points with their intervals: axes, joins, fits, and names at the ends of lines.

use itertools::Itertools;
use plotters::prelude::*;

use super::chart::{Mark, mesh, tip};
use super::style::{self, Marker};
use super::{Area, DrawResult, drawing};
use crate::axis::Scale;
use fathom_record::Estimate;

pub struct PointChart {
    /// Empty where it stands alone.
    pub title: String,
    pub x_title: String,
    pub y_title: String,
    pub x: Scale,
    pub y: Scale,
    pub series: Vec<Series>,
    pub changes: Vec<ChangeLine>,
}

pub struct Series {
    /// What tells it from the others of its chart; may be empty where it is alone.
    pub name: String,
    pub remarks: Vec<String>,
    pub color: RGBColor,
    pub marker: Marker,
    /// By x.
    pub points: Vec<Point>,
    /// Whether its points have an order, so that a line joins them.
    pub is_joined: bool,
    /// Ends of a fitted line.
    pub fit: Option<[[f64; 2]; 2]>,
}

#[derive(Clone)]
pub struct Point {
    pub x: f64,
    pub y: Estimate,
    pub tip: String,
    /// A name that stands above it.
    pub category: Option<String>,
    /// From the shortest to the longest published frame time.
    pub published: Option<[f64; 2]>,
}

/// A dashed vertical line.
pub struct ChangeLine {
    pub x: f64,
    pub color: RGBColor,
    pub tip: String,
}

/// A line of small type, and a chart's own title.
const ROW_PX: i32 = 16;
const TITLE_PX: i32 = 22;
/// Most pixels for the names at the ends of lines.
const MAX_NAMES_PX: u32 = 230;
/// The mark of published figures.
const STAR: [[(i32, i32); 2]; 4] =
    [[(-6, 0), (6, 0)], [(0, -6), (0, 6)], [(-4, -4), (4, 4)], [(-4, 4), (4, -4)]];
/// From the chart's edge to the marker and the words of a name.
const NAME_MARK_PX: i32 = 14;
const NAME_PX: i32 = 26;
/// Characters of the ordinate's title that fit beside a chart, its scale apart.
pub const MAX_Y_TITLE: usize = 34;
/// A name that is further than this from its line is joined to it.
const LEADER_FROM_PX: i32 = 8;
/// Where the names of series begin above a small chart, behind their marks.
const NAMES_PX: i32 = 36;

type PlotArea<'b> = DrawingArea<SVGBackend<'b>, Cartesian2d<Scale, Scale>>;

impl PointChart {
    /// The chart as a picture of its own; `about` says in one sentence what it shows.
    pub fn svg(&self, size_px: (u32, u32), about: &str) -> String {
        // At the right there is room for half of a label below the axis.
        drawing(size_px, about, |area| self.axes(area, 4, 44).map(|_| ()))
    }

    /// The only chart of a panel, with names at the ends of its series.
    pub fn draw_with_names(&self, area: &Area<'_>) -> DrawResult {
        let names: Vec<Vec<String>> = self.series.iter().map(Series::lines).collect();
        let longest = names.iter().flatten().map(|line| style::width_px(line, style::LABEL_PX));
        let names_px = longest.max().unwrap_or_default() + NAME_PX as u32;
        let plot = self.axes(area, 4, names_px)?;
        let ((x0, y0), (xs, ys)) = (area.get_base_pixel(), plot.get_pixel_range());
        let right = xs.end - x0;
        let ends = self.series.iter().map(|series| self.end(&plot, series) - y0).collect_vec();
        let edges = ends.iter().map(|y| y - ROW_PX / 2).collect_vec();
        let heights = names.iter().map(|lines| lines.len() as i32 * ROW_PX + 4).collect_vec();
        let placed = apart(&edges, &heights, [ys.start - y0, ys.end - y0]);
        for (((series, lines), end), edge) in self.series.iter().zip(&names).zip(ends).zip(placed) {
            let middle = edge + ROW_PX / 2;
            if (middle - end).abs() > LEADER_FROM_PX && series.is_joined {
                let leader = vec![(right, end), (right + 8, middle)];
                area.draw(&PathElement::new(leader, style::FAINT.stroke_width(1)))?;
            }
            Mark::Series(series.marker, series.color).draw(area, right + NAME_MARK_PX, middle)?;
            for (line, text) in (0..).zip(lines) {
                let style = if line == 0 { style::label() } else { style::small() };
                let at = (right + NAME_PX, middle + line * ROW_PX);
                area.draw_text(text, &style::starting(style), at)?;
            }
        }
        Ok(())
    }

    /// Height that the names at the ends of its series and the axis below need.
    pub fn ends_px(&self) -> u32 {
        let lines = self.series.iter().map(|series| series.lines().len() as i32 * ROW_PX + 4);
        (lines.sum::<i32>() + 60) as u32
    }

    /// One of several charts, with its title and the names of its series above.
    pub fn draw_small(&self, area: &Area<'_>, head_px: u32) -> DrawResult {
        area.draw_text(&self.title, &style::label(), (16, 2))?;
        for (index, series) in (0..).zip(&self.series) {
            let y = TITLE_PX + index * ROW_PX + 6;
            Mark::Series(series.marker, series.color).draw(area, 24, y)?;
            area.draw_text(&self.named(series), &style::starting(style::small()), (NAMES_PX, y))?;
        }
        self.axes(area, head_px, 14).map(|_| ())
    }

    /// Height of the lines above a small chart.
    pub fn head_px(&self) -> u32 {
        (TITLE_PX + self.series.len() as i32 * ROW_PX) as u32
    }

    /// A series' name with its remarks, as it stands above a small chart.
    fn named(&self, series: &Series) -> String {
        let is_title = series.name == self.title || self.series.len() == 1;
        let name = Some(&series.name).filter(|name| !is_title && !name.is_empty());
        let remarks = Some(series.remarks.join(", ")).filter(|line| !line.is_empty());
        name.cloned().into_iter().chain(remarks).join(": ")
    }

    /// Width that the lines above a small chart need.
    pub fn names_px(&self) -> u32 {
        let longest = self.series.iter().map(|series| self.named(series).chars().count()).max();
        NAMES_PX as u32 + (style::SMALL_CHARACTER_PX * longest.unwrap_or(0) as f64).ceil() as u32
    }

    fn axes<'b>(&self, area: &Area<'b>, top_px: u32, right_px: u32) -> DrawResult<PlotArea<'b>> {
        let mut chart = ChartBuilder::on(area)
            .margin_top(top_px + 6)
            .margin_right(right_px)
            .margin_left(10)
            .margin_bottom(4)
            .x_label_area_size(if self.x_title.is_empty() { 24 } else { 44 })
            .y_label_area_size(84)
            .build_cartesian_2d(self.x.clone(), self.y.clone())?;
        mesh(&mut chart)
            .y_labels(20)
            .x_label_formatter(&|at| self.x.tick_label(*at))
            .y_label_formatter(&|at| self.y.tick_label(*at))
            .x_desc(&self.x_title)
            .y_desc(&self.y_title)
            .draw()?;
        let plot = chart.plotting_area().clone();
        let canvas = PlotCanvas { area: &plot, chart: self };
        self.changes.iter().try_for_each(|change| canvas.change(change))?;
        self.series.iter().try_for_each(|series| canvas.series(series))?;
        Ok(plot)
    }

    /// Whether no series has a point of the same name above it.
    fn is_uppermost(&self, point: &Point) -> bool {
        let points = self.series.iter().flat_map(|series| &series.points);
        let mut same = points.filter(|other| other.category == point.category);
        same.all(|other| other.y.median <= point.y.median)
    }

    /// Pixel height of a series' last point.
    fn end(&self, plot: &PlotArea<'_>, series: &Series) -> i32 {
        let last = series.points.last();
        let at =
            last.and_then(|point| Some((self.x.coord(point.x)?, self.y.coord(point.y.median)?)));
        at.map_or(0, |at| plot.map_coordinate(&at).1)
    }
}

impl Series {
    /// Its name and remarks, in lines that fit beside the chart.
    fn lines(&self) -> Vec<String> {
        let fitting = style::max_characters(MAX_NAMES_PX);
        let parts = std::iter::once(&self.name).chain(&self.remarks);
        let filled_parts = parts.filter(|part| !part.is_empty());
        filled_parts.flat_map(|part| style::wrap(part, fitting)).collect()
    }

    pub fn xs(&self) -> impl Iterator<Item = f64> {
        self.points.iter().map(|point| point.x)
    }

    /// Median, interval and published figures of every point.
    pub fn ys(&self) -> impl Iterator<Item = f64> {
        self.points.iter().flat_map(|point| {
            let [low, high] = point.y.ends();
            [low, point.y.median, high].into_iter().chain(point.published.into_iter().flatten())
        })
    }
}

struct PlotCanvas<'a, 'b> {
    area: &'a PlotArea<'b>,
    chart: &'a PointChart,
}

impl PlotCanvas<'_, '_> {
    fn coordinates(&self, x: f64, y: f64) -> Option<(f64, f64)> {
        Some((self.chart.x.coord(x)?, self.chart.y.coord(y)?))
    }

    fn line(&self, ends: [Option<(f64, f64)>; 2], style: ShapeStyle) -> DrawResult {
        let [Some(a), Some(b)] = ends else {
            return Ok(());
        };
        self.area.draw(&PathElement::new(vec![a, b], style))
    }

    fn series(&self, series: &Series) -> DrawResult {
        let Series { points, color, .. } = series;
        for (a, b) in points.iter().tuple_windows().filter(|_| series.is_joined) {
            let ends = [a, b].map(|point| self.coordinates(point.x, point.y.median));
            let width_px = if series.fit.is_some() { 1 } else { 2 };
            self.line(ends, color.mix(0.8).stroke_width(width_px))?;
        }
        if let Some(ends) = series.fit {
            self.dashed(ends.map(|[x, y]| self.coordinates(x, y)), *color)?;
        }
        points.iter().try_for_each(|point| self.point(point, series))
    }

    fn point(&self, point: &Point, series: &Series) -> DrawResult {
        let Series { color, marker, .. } = *series;
        let area = self.area.strip_coord_spec();
        let (x0, y0) = area.get_base_pixel();
        let px = |y: f64| {
            let (x, y) = self.area.map_coordinate(&self.coordinates(point.x, y)?);
            Some((x - x0, y - y0))
        };
        let ends = point.y.interval.and_then(|i| Some([px(i.low)?, px(i.high)?]));
        if let Some([(x, low), (_, high)]) = ends {
            let bar = [-4, 4, 0].map(|cap| (x + cap, low)).into_iter();
            let bar = bar.chain([0, -4, 4].map(|cap| (x + cap, high)));
            area.draw(&PathElement::new(bar.collect::<Vec<_>>(), color.stroke_width(2)))?;
        }
        let Some((x, y)) = px(point.y.median) else { return Ok(()) };
        Mark::Series(marker, color).draw(&area, x, y)?;
        tip(&area, &point.tip)?;
        if let Some(name) = point.category.as_ref().filter(|_| self.chart.is_uppermost(point)) {
            area.draw_text(name, &style::centered(style::small()), (x, y - 15))?;
        }
        point.published.map_or(Ok(()), |span| self.published(point.x, span))
    }

    fn change(&self, change: &ChangeLine) -> DrawResult {
        let [low, high] = [self.chart.y.low, self.chart.y.high];
        self.dashed([Some((change.x, low)), Some((change.x, high))], change.color)?;
        tip(&self.area.strip_coord_spec(), &change.tip)
    }

    fn dashed(&self, ends: [Option<(f64, f64)>; 2], color: RGBColor) -> DrawResult {
        const DASH_PX: f64 = 11.0;
        let [Some(a), Some(b)] = ends else {
            return Ok(());
        };
        let at = |share: f64| Some((a.0 + share * (b.0 - a.0), a.1 + share * (b.1 - a.1)));
        let (width, height) = self.area.dim_in_pixel();
        let PointChart { x, y, .. } = self.chart;
        let across = (b.0 - a.0) / (x.high - x.low) * f64::from(width);
        let up = (b.1 - a.1) / (y.high - y.low) * f64::from(height);
        let dashes = (across.hypot(up) / DASH_PX).ceil();
        for dash in 0..dashes as usize {
            let start = dash as f64 / dashes;
            let end = (dash as f64 + 0.6) / dashes;
            self.line([at(start), at(end)], color.stroke_width(2))?;
        }
        Ok(())
    }

    fn published(&self, x: f64, [low, high]: [f64; 2]) -> DrawResult {
        let ends = [self.coordinates(x, low), self.coordinates(x, high)];
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

/// Moves blocks of these heights down where they would cover the one above, and up where they would reach below the bottom: upper
/// edges in, upper edges out, in pixels.
fn apart(edges_px: &[i32], heights_px: &[i32], [top_px, bottom_px]: [i32; 2]) -> Vec<i32> {
    let mut order: Vec<usize> = (0..edges_px.len()).collect();
    order.sort_by_key(|index| edges_px[*index]);
    let mut placed = edges_px.to_vec();
    let mut free = top_px;
    for index in &order {
        placed[*index] = placed[*index].max(free);
        free = placed[*index] + heights_px[*index];
    }
    let mut end = bottom_px;
    for index in order.into_iter().rev() {
        placed[index] = placed[index].min(end - heights_px[index]);
        end = placed[index];
    }
    placed
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_are_moved_apart_in_their_order_and_stay_inside() {
        for (edges, height, bottom, expected) in [
            (&[10, 50][..], 14, 114, &[10, 50][..]),
            (&[50, 50, 52], 14, 114, &[50, 64, 78]),
            (&[98, 96], 14, 114, &[100, 86]),
            (&[12, 14, 82], 20, 120, &[12, 32, 82]),
            // What does not fit below is moved up.
            (&[92, 90], 20, 110, &[90, 70]),
        ] {
            assert_eq!(apart(edges, &vec![height; edges.len()], [0, bottom]), expected);
        }
    }
}
