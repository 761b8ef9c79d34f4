//! Series over a number: points with their intervals and fitted power laws.

use itertools::Itertools;

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

/// A cell, in the units shown.
pub struct Point<'a> {
    pub x: f64,
    pub y: Estimate,
    /// None of an exact figure.
    pub n: Option<usize>,
    pub cell: &'a Cell,
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
