//! Series over a number, as page and plots both show them: points with their intervals and fitted power laws. Here is also how the
//! page draws them.

use std::ops::Deref;

use itertools::Itertools;
use maud::{Markup, html};

use crate::axis::Axis;
use crate::svg::Marker;
use fathom_experiments::schema::FIXED_SHARE;
use fathom_experiments::{Measure, Scaling, scaling};
use fathom_record::{Cell, Estimate};

/// A measure of cells that differ along an axis.
pub struct Figures<'a> {
    pub y: &'a Measure,
    /// By x, in the units shown.
    pub points: Vec<Point<'a>>,
    /// Whether its points have an order, so that a line may join them.
    pub joined: bool,
    /// Why there is no exponent, where one was asked for.
    pub fit: Option<Result<Scaling, String>>,
    /// Of x and y, from the record to what is shown.
    factors: [f64; 2],
}

/// Figures as the page draws them.
pub struct Series<'a> {
    pub figures: Figures<'a>,
    /// What tells it from the others of its chart.
    pub name: String,
    /// Of CSS.
    pub color: String,
    /// Its run's place on the page.
    pub run: usize,
    pub marker: Marker,
}

impl<'a> Deref for Series<'a> {
    type Target = Figures<'a>;

    fn deref(&self) -> &Figures<'a> {
        &self.figures
    }
}

/// A cell, in the units shown.
pub struct Point<'a> {
    pub x: f64,
    pub y: Estimate,
    /// None of an exact figure.
    pub n: Option<usize>,
    pub cell: &'a Cell,
    /// What the mark tells under the pointer.
    pub tip: Option<String>,
}

/// What a series is read from.
pub struct Source<'a> {
    pub x: &'a Measure,
    pub y: &'a Measure,
    pub factors: [f64; 2],
    /// Whether cells have an order.
    pub joined: bool,
    /// Whether a power law is asked for.
    pub fitted: bool,
}

impl<'a> Source<'a> {
    pub fn read(&self, cells: &[&'a Cell]) -> Figures<'a> {
        let Source { x, y, factors, joined, fitted } = *self;
        let point = |cell: &&'a Cell| {
            let measured = cell.measured()?;
            let reading = y.read(cell, measured)?;
            Some(Point {
                x: x.read(cell, measured)?.median() * factors[0],
                y: reading.estimate().scaled(factors[1]),
                n: reading.n(),
                cell,
                tip: None,
            })
        };
        let points = cells.iter().filter_map(point);
        let points = points.sorted_by(|a, b| a.x.total_cmp(&b.x)).collect();
        let fit = (joined && fitted).then(|| scaling(y, x, cells, FIXED_SHARE));
        Figures { y, points, joined, fit, factors }
    }
}

impl Figures<'_> {
    /// One would hide the other.
    pub fn coincides(&self, other: &Figures<'_>) -> bool {
        let places = |figures: &Figures<'_>| {
            figures.points.iter().map(|point| [point.x, point.y.median]).collect_vec()
        };
        self.y == other.y && places(self) == places(other)
    }

    pub fn fitted(&self) -> Option<&Scaling> {
        self.fit.as_ref()?.as_ref().ok()
    }

    /// Median and interval of every point.
    pub fn ends(&self) -> impl Iterator<Item = f64> {
        self.points.iter().flat_map(|point| {
            let [low, high] = point.y.ends();
            [low, point.y.median, high]
        })
    }

    /// Ends of a fitted line, in the units shown.
    pub fn ends_of(&self, fit: &Scaling) -> [[f64; 2]; 2] {
        [fit.range.0, fit.range.1].map(|x| {
            let y = (fit.slope.intercept + fit.slope.slope * x.ln()).exp();
            [x * self.factors[0], y * self.factors[1]]
        })
    }
}

impl Series<'_> {
    /// A line through the points of an axis that has an order, and the fitted power law over the cells that it was fitted to.
    pub fn lines(&self, [x, y]: [&Axis; 2]) -> Markup {
        let joined = self.points.iter().filter(|_| self.joined);
        let joined = joined.map(|point| [point.x, point.y.median]).collect_vec();
        let fitted = self.fitted().map_or_else(Vec::new, |fit| self.ends_of(fit).to_vec());
        let line = |ends: &[[f64; 2]]| {
            let places = ends.iter().filter_map(|at| Some([x.px(at[0])?, y.px_within(at[1])]));
            places.map(|[x, y]| format!("{x},{y}")).join(" ")
        };
        let [joined, fitted] = [joined, fitted].map(|ends| line(&ends));
        html! {
            @if !joined.is_empty() {
                polyline.series.join[!fitted.is_empty()] points=(joined) style={ "stroke:" (self.color) } {}
            }
            @if !fitted.is_empty() {
                polyline.series.fit points=(fitted) style={ "stroke:" (self.color) } {}
            }
        }
    }

    /// A mark and the interval of each point that the axes can show.
    pub fn marks(&self, [x, y]: [&Axis; 2]) -> Markup {
        let placed = self.points.iter().filter_map(|point| {
            let at = [x.px(point.x)?, y.px(point.y.median)?];
            Some((at, point.y.ends().map(|end| y.px_within(end)), &point.tip))
        });
        let Marker { shape, hollow } = self.marker;
        let fill = if hollow { "var(--ground)" } else { &self.color };
        html! {
            g data-series=(self.name) {
                @for ([x, y], [low, high], tip) in placed {
                    @if low - high > 1.0 { line.whisker x1=(x) x2=(x) y1=(low) y2=(high) style={ "stroke:" (self.color) } {} }
                    path.mark d=(shape.path([x, y])) style={ "fill:" (fill) ";stroke:" (self.color) } {
                        @if let Some(tip) = tip { title { (tip) } }
                    }
                }
            }
        }
    }
}
