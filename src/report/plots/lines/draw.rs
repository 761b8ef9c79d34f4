//! Drawing of charts of series: axes, points, fits, and names at the ends of lines.

use super::super::chart::mesh;
use super::*;

/// The mark of published figures.
const STAR: [[(i32, i32); 2]; 4] =
    [[(-6, 0), (6, 0)], [(0, -6), (0, 6)], [(-4, -4), (4, 4)], [(-4, 4), (4, -4)]];
/// From the chart's edge to the marker and the words of a name.
const NAME_MARK_PX: i32 = 14;
const NAME_PX: i32 = 26;
/// Characters of the ordinate's title that fit beside a chart, its scale apart.
const MOST_Y_TITLE: usize = 34;
/// A name that is further than this from its line is joined to it.
const LEADER_FROM_PX: i32 = 8;

impl Chart {
    /// The only chart of a panel, with names at the ends of its series.
    pub fn draw_with_names(&self, area: &Area<'_>, colors: &StageColors) -> Drawn {
        let names: Vec<Vec<String>> = self.series.iter().map(Series::lines).collect();
        let longest = names.iter().flatten().map(|line| style::width_px(line, style::LABEL_PX));
        let names_px = longest.max().unwrap_or_default() + NAME_PX as u32;
        let plot = self.axes(area, 4, names_px, colors)?;
        let (right, top) = (plot.get_pixel_range().0.end, plot.get_pixel_range().1.start);
        let (x0, y0) = area.get_base_pixel();
        let wanted: Vec<i32> =
            self.series.iter().map(|series| self.end(&plot, series) - y0).collect();
        let heights: Vec<i32> = names.iter().map(|lines| lines.len() as i32 * ROW_PX + 4).collect();
        let bottom = plot.get_pixel_range().1.end - y0;
        for (index, y) in placed(&wanted, &heights, top - y0, bottom).into_iter().enumerate() {
            let (series, lines) = (&self.series[index], &names[index]);
            let color = series.color.of(colors);
            let middle = y + ROW_PX / 2;
            if (middle - wanted[index]).abs() > LEADER_FROM_PX && series.joined {
                let ends = vec![(right - x0, wanted[index]), (right - x0 + 8, middle)];
                area.draw(&PathElement::new(ends, style::FAINT.stroke_width(1)))?;
            }
            Mark::Series(series.marker, color).draw(area, (right - x0 + NAME_MARK_PX, middle))?;
            for (line, text) in (0..).zip(lines) {
                let style = if line == 0 { style::label() } else { style::small() };
                let at = (right - x0 + NAME_PX, middle + line * ROW_PX);
                area.draw_text(text, &style::starting(style), at)?;
            }
        }
        Ok(())
    }

    /// One of several charts, with its title and the names of its series above.
    pub fn draw_small(&self, area: &Area<'_>, head_px: u32, colors: &StageColors) -> Drawn {
        area.draw_text(&self.title, &style::label(), (16, 2))?;
        for (index, series) in (0..).zip(&self.series) {
            let y = TITLE_PX + index * ROW_PX + 6;
            Mark::Series(series.marker, series.color.of(colors)).draw(area, (24, y))?;
            let is_title = series.name == self.title || self.series.len() == 1;
            let name = Some(&series.name).filter(|name| !is_title && !name.is_empty());
            let remarks = Some(series.remarks.join(", ")).filter(|line| !line.is_empty());
            let line = name.cloned().into_iter().chain(remarks).join(": ");
            area.draw_text(&line, &style::starting(style::small()), (36, y))?;
        }
        self.axes(area, head_px, 14, colors).map(|_| ())
    }

    fn axes<'b>(
        &self,
        area: &Area<'b>,
        top_px: u32,
        right_px: u32,
        colors: &StageColors,
    ) -> Result<PlotArea<'b>, super::super::Fault> {
        let mut chart = ChartBuilder::on(area)
            .margin_top(top_px + 6)
            .margin_right(right_px)
            .margin_left(10)
            .margin_bottom(4)
            .x_label_area_size(44)
            .y_label_area_size(70)
            .build_cartesian_2d(self.x.clone(), self.y.clone())?;
        mesh(&mut chart)
            .y_labels(20)
            .x_label_formatter(&|at| self.x.tick_label(*at))
            .y_label_formatter(&|at| self.y.tick_label(*at))
            .x_desc(format!("{}, {} scale", self.x_title, self.x.kind.short()))
            .y_desc(format!("{}, {}", style::cut(&self.y_title, MOST_Y_TITLE), self.y.kind.short()))
            .draw()?;
        let plot = chart.plotting_area().clone();
        let canvas = Canvas { area: &plot, chart: self };
        for series in &self.series {
            canvas.series(series, series.color.of(colors))?;
        }
        Ok(plot)
    }

    /// Whether no series has a point of the same name above it.
    fn is_uppermost(&self, point: &Point) -> bool {
        let mut same = self.points().filter(|other| other.name == point.name);
        same.all(|other| other.y.median <= point.y.median)
    }

    /// Pixel height of a series' last point.
    fn end(&self, plot: &PlotArea<'_>, series: &Series) -> i32 {
        let last = series.points.last();
        let at = last.and_then(|point| Some((self.x.at(point.x)?, self.y.at(point.y.median)?)));
        at.map_or(0, |at| plot.map_coordinate(&at).1)
    }
}

type PlotArea<'b> = DrawingArea<SVGBackend<'b>, Cartesian2d<Scale, Scale>>;

/// Upper edges of blocks of these heights, in the order of the wanted middles of their first lines, without overlap.
fn placed(wanted: &[i32], heights: &[i32], top: i32, bottom: i32) -> Vec<i32> {
    let order: Vec<usize> = (0..wanted.len()).sorted_by_key(|index| wanted[*index]).collect();
    let mut edges = vec![0; wanted.len()];
    let mut free = top;
    for index in &order {
        edges[*index] = free.max(wanted[*index] - ROW_PX / 2);
        free = edges[*index] + heights[*index];
    }
    let mut limit = bottom;
    for index in order.iter().rev() {
        edges[*index] = edges[*index].min(limit - heights[*index]);
        limit = edges[*index];
    }
    edges
}

impl Series {
    /// Its name and remarks, in lines that fit beside the chart.
    fn lines(&self) -> Vec<String> {
        let fitting = style::fitting(MOST_NAMES_PX);
        let parts =
            std::iter::once(&self.name).chain(&self.remarks).filter(|part| !part.is_empty());
        parts.flat_map(|part| style::wrap(part, fitting)).collect()
    }
}

struct Canvas<'a, 'b> {
    area: &'a PlotArea<'b>,
    chart: &'a Chart,
}

impl Canvas<'_, '_> {
    fn at(&self, x: f64, y: f64) -> Option<(f64, f64)> {
        Some((self.chart.x.at(x)?, self.chart.y.at(y)?))
    }

    fn line(&self, ends: [Option<(f64, f64)>; 2], style: ShapeStyle) -> Drawn {
        let [Some(a), Some(b)] = ends else {
            return Ok(());
        };
        self.area.draw(&PathElement::new(vec![a, b], style))
    }

    fn series(&self, series: &Series, color: RGBColor) -> Drawn {
        let pairs = series.points.windows(2).filter(|_| series.joined);
        for pair in pairs {
            let ends = [&pair[0], &pair[1]].map(|point| self.at(point.x, point.y.median));
            self.line(ends, color.mix(0.45).stroke_width(1))?;
        }
        if let Some(ends) = &series.fit {
            self.fit(ends, color)?;
        }
        series.points.iter().try_for_each(|point| self.point(point, series.marker, color))
    }

    fn point(&self, point: &Point, marker: usize, color: RGBColor) -> Drawn {
        let ends = point.y.ends().map(|y| self.at(point.x, y));
        if point.y.interval.is_some() {
            self.line(ends, color.stroke_width(2))?;
            for at in ends.into_iter().flatten() {
                let cap = EmptyElement::at(at)
                    + PathElement::new(vec![(-4, 0), (4, 0)], color.stroke_width(2));
                self.area.draw(&cap)?;
            }
        }
        let Some(at) = self.at(point.x, point.y.median) else { return Ok(()) };
        let shape = EmptyElement::at(at) + Polygon::new(style::marker(marker), color.filled());
        self.area.draw(&shape)?;
        if let Some(name) = point.name.as_ref().filter(|_| self.chart.is_uppermost(point)) {
            let above = Text::new(name.clone(), (0, -15), style::centered(style::small()));
            self.area.draw(&(EmptyElement::at(at) + above))?;
        }
        point.published.map_or(Ok(()), |span| self.published(point.x, span))
    }

    /// The fitted line over the cells it was fitted to, dashed.
    fn fit(&self, ends: &[[f64; 2]; 2], color: RGBColor) -> Drawn {
        const DASH_PX: f64 = 11.0;
        let [Some(a), Some(b)] = ends.map(|[x, y]| self.at(x, y)) else {
            return Ok(());
        };
        let at = |share: f64| Some((a.0 + share * (b.0 - a.0), a.1 + share * (b.1 - a.1)));
        let (width, height) = self.area.dim_in_pixel();
        let Chart { x, y, .. } = self.chart;
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

    fn published(&self, x: f64, [low, high]: [f64; 2]) -> Drawn {
        let ends = [self.at(x, low), self.at(x, high)];
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_stand_apart_in_the_order_of_their_lines() {
        assert_eq!(placed(&[20, 22, 90], &[20, 20, 20], 0, 120), [12, 32, 82]);
        // What does not fit below is moved up.
        assert_eq!(placed(&[100, 98], &[20, 20], 0, 110), [90, 70]);
    }
}
