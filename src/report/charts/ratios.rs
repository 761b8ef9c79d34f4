//! Panels of ratios: a measure at one value of an axis over that at another, a row for each group of cells, with the interval
//! and the band that a claim allows.

use plotters::prelude::RGBColor;
use serde_json::Value;

use super::chart::{BarChart, Item, Legend, Mark};
use super::{PlotInput, names, style};
use crate::axis::{Scale, ScaleKind};
use crate::format::interval;
use fathom_experiments::schema::{Plot, Test};
use fathom_experiments::{Measure, Quantity, fits, groups, label_text, same};
use fathom_record::{Cell, Interval};

const ROW_PX: u32 = 34;
/// Room for a ratio with its interval and number of samples.
const RIGHT_PX: u32 = 230;

struct RatioRow {
    label: String,
    color: RGBColor,
    ratio: Quantity,
    /// What a claim allows.
    band: Option<Interval>,
}

/// None where no group has both values.
pub fn chart(plot: &Plot, input: &PlotInput<'_>) -> Option<BarChart> {
    let over = plot.over.as_ref()?;
    let sides = [plot.numerator.as_ref()?, plot.denominator.as_ref()?];
    let groups = groups(&input.cells, over);
    let of_measure =
        |y| groups.iter().filter_map(move |(_, cells)| RatioRow::new(plot, y, sides, cells, input));
    let rows: Vec<RatioRow> = plot.y.iter().flat_map(of_measure).collect();
    let shown = rows.iter().flat_map(RatioRow::shown).chain([1.0]);
    let mut scale = Scale::fit(ScaleKind::Linear, shown)?;
    scale.low = scale.low.max(0.0);
    let banded = rows.iter().any(|row| row.band.is_some());
    let legend = (Mark::Square(style::BAND), "what the claim allows".to_owned());
    let count = rows.len();
    let items = rows.iter().zip((0..count).rev()).flat_map(|(row, at)| row.items(at, &scale));
    let axis = names::short_axis(over, input.experiment);
    (count > 0).then(|| BarChart {
        x_title: format!(
            "{axis}: {}, ratio with its 95 % interval",
            sides.map(label_text).join(" over ")
        ),
        items: items.chain([Item::Line([(1.0, 0.0), (1.0, count as f64)], 1)]).collect(),
        scale: scale.clone(),
        rows_px: count as u32 * ROW_PX,
        rows: count as f64,
        right_px: RIGHT_PX,
        legend: Legend(banded.then_some(legend).into_iter().collect()),
    })
}

impl RatioRow {
    fn new(
        plot: &Plot,
        y: &Measure,
        sides: [&Value; 2],
        cells: &[&Cell],
        input: &PlotInput<'_>,
    ) -> Option<RatioRow> {
        let over = plot.over.as_ref()?;
        let at = |wanted: &Value| {
            cells.iter().find(|cell| cell.axes.get(over).is_some_and(|value| same(value, wanted)))
        };
        let [top, bottom] = [at(sides[0])?, at(sides[1])?];
        let read = |cell: &Cell| y.read(cell, cell.measured()?);
        let ratio = read(top)?.ratio_to(&read(bottom)?);
        let others = (top.axes.len() > 1).then(|| names::cell(top, Some(over), input.experiment));
        let what = (plot.y.len() > 1 || others.is_none()).then(|| names::measure(y));
        let label = others.into_iter().chain(what).collect::<Vec<_>>().join(": ");
        let stage = y.stage_name();
        let color = stage.map_or(style::color(0), |s| style::stage_color(input.colors.color(&s)));
        let band = band(plot, y, sides, top, input);
        ratio.median().is_finite().then_some(RatioRow { label, color, ratio, band })
    }

    /// What the axis must hold: bands without an end reach to its edge.
    fn shown(&self) -> Vec<f64> {
        let band = self.band.map(|band| [band.low, band.high]).into_iter().flatten();
        let bounds = band.filter(|bound| bound.is_finite());
        let estimate = self.ratio.estimate();
        estimate.ends().into_iter().chain([estimate.median]).chain(bounds).collect()
    }

    fn items(&self, row: usize, scale: &Scale) -> Vec<Item> {
        let (row, middle) = (row as f64, row as f64 + 0.5);
        let band = self.band.map(|Interval { low, high }| {
            let corners = [(low.max(scale.low), row + 0.08), (high.min(scale.high), row + 0.92)];
            Item::Bar(corners, style::BAND)
        });
        let estimate = self.ratio.estimate();
        let n = self.ratio.n().map_or_else(String::new, |n| format!(", n = {n}"));
        let marks = [
            Item::Line(estimate.ends().map(|end| (end, middle)), 2),
            Item::Dot((estimate.median, middle), self.color),
            Item::Label(self.label.clone(), middle),
            Item::Words(interval(&estimate) + &n, (scale.high, middle), 8),
        ];
        band.into_iter().chain(marks).collect()
    }
}

/// The band of the claim about this ratio of this group.
fn band(
    plot: &Plot,
    y: &Measure,
    sides: [&Value; 2],
    cell: &Cell,
    input: &PlotInput<'_>,
) -> Option<Interval> {
    let claims = input.experiment.claim.iter().filter(|claim| fits(cell, &claim.filter));
    claims.into_iter().find_map(|claim| match &claim.test {
        Test::Ratio { y: of, over, numerator, denominator, low, high } => {
            let is_same = of == y
                && plot.over.as_ref() == Some(over)
                && same(sides[0], numerator)
                && same(sides[1], denominator);
            is_same.then_some(Interval { low: *low, high: *high })
        }
        _ => None,
    })
}
