//! Panels of ratios: a measure at one value of an axis over that at another, a row for each group of cells, with the interval
//! and the band that a claim allows.

use maud::html;

use super::drawing::Drawing;
use super::rows::{Legend, Mark, Rows};
use super::{PlotInput, names, style};
use crate::format::interval;
use crate::svg::Shape;
use fathom_experiments::schema::{Plot, Test};
use fathom_experiments::{Measure, Reading, fits, groups, label_text, same};
use fathom_record::{Cell, Interval};

const ROW_PX: f64 = 34.0;
/// Room for a ratio with its interval and number of samples.
const RIGHT_PX: f64 = 230.0;

struct Row {
    label: String,
    stage: Option<String>,
    ratio: Reading,
    /// What a claim allows.
    band: Option<Interval>,
}

/// None where no group has both values.
pub fn drawing(plot: &Plot, input: &PlotInput<'_>) -> Option<Drawing> {
    let over = plot.over.as_ref()?;
    let groups = groups(&input.cells, over);
    let of_measure =
        |y| groups.iter().filter_map(move |(_, cells)| Row::new(plot, y, cells, input));
    let all: Vec<Row> = plot.y.iter().flat_map(of_measure).collect();
    let values = all.iter().flat_map(Row::shown).chain([1.0]);
    let mut rows = Rows::new(values, all.iter().map(|row| row.label.as_str()), RIGHT_PX)?;
    for row in &all {
        rows.push(&row.label, row.drawing(&rows, input));
    }
    let sides = [plot.numerator.as_ref()?, plot.denominator.as_ref()?].map(label_text);
    let axis = names::short_axis(over, input.experiment);
    let banded = all.iter().any(|row| row.band.is_some());
    let band = banded.then(|| (Mark::Band, "what the claim allows".to_owned()));
    let legend = Legend(band.into_iter().collect());
    let title = format!("{axis}: {}, ratio", sides.join(" over "));
    (!all.is_empty()).then(|| rows.drawing(legend, &title))
}

impl Row {
    fn new(plot: &Plot, y: &Measure, cells: &[&Cell], input: &PlotInput<'_>) -> Option<Row> {
        let over = plot.over.as_ref()?;
        let at = |wanted: &serde_json::Value| {
            cells.iter().find(|cell| cell.axes.get(over).is_some_and(|value| same(value, wanted)))
        };
        let (top, bottom) = (at(plot.numerator.as_ref()?)?, at(plot.denominator.as_ref()?)?);
        let read = |cell: &Cell| y.read(cell, cell.measured()?);
        let ratio = read(top)?.over(&read(bottom)?);
        let others = (top.axes.len() > 1).then(|| names::cell(top, Some(over), input.experiment));
        let what = Some(names::measure(y)).filter(|_| plot.y.len() > 1 || others.is_none());
        let label = others.into_iter().chain(what).collect::<Vec<_>>().join(": ");
        let band = band(plot, y, top, input);
        ratio.median().is_finite().then(|| Row { label, stage: y.stage_name(), ratio, band })
    }

    /// What the axis must hold: bands without an end reach to its edge.
    fn shown(&self) -> Vec<f64> {
        let band = self.band.map(|band| [band.low, band.high]).into_iter().flatten();
        let bounds = band.filter(|bound| bound.is_finite());
        let estimate = self.ratio.estimate();
        estimate.ends().into_iter().chain([estimate.median]).chain(bounds).collect()
    }

    fn drawing(&self, rows: &Rows, input: &PlotInput<'_>) -> Drawing {
        let estimate = self.ratio.estimate();
        let n = self.ratio.n().map_or_else(String::new, |n| format!(", n = {n}"));
        let color = self.stage.as_ref().map_or(style::color(0), |stage| input.colors.of(stage));
        let middle = ROW_PX / 2.0;
        let content = html! {
            @if let Some(Interval { low, high }) = self.band { (rows.band([low, high], [3.0, ROW_PX - 3.0])) }
            (rows.across(1.0, [0.0, ROW_PX], "leader"))
            (rows.interval(estimate.ends(), middle))
            (rows.mark(Shape::Circle, estimate.median, middle, Some(color)))
            (rows.at_the_right(middle, &format!("{}{n}", interval(&estimate))))
        };
        Drawing::new(ROW_PX, content)
    }
}

/// The band of the claim about this ratio of this group.
fn band(plot: &Plot, y: &Measure, cell: &Cell, input: &PlotInput<'_>) -> Option<Interval> {
    let claims = input.experiment.claim.iter().filter(|claim| fits(cell, &claim.filter));
    claims.into_iter().find_map(|claim| match &claim.test {
        Test::Ratio { y: of, over, numerator, denominator, low, high } => {
            let is_same = of == y
                && plot.over.as_ref() == Some(over)
                && plot.numerator.as_ref().is_some_and(|value| same(value, numerator))
                && plot.denominator.as_ref().is_some_and(|value| same(value, denominator));
            is_same.then_some(Interval { low: *low, high: *high })
        }
        _ => None,
    })
}
