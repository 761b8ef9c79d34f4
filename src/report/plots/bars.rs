//! Panels of horizontal bars over a named axis: a bar per cell, those of one value together, the other axes by colour.

use indexmap::{IndexMap, IndexSet};
use maud::html;

use super::drawing::Drawing;
use super::rows::{Legend, Mark, Rows};
use super::{PlotInput, names, style};
use crate::colors::Color;
use crate::format::three;
use fathom_experiments::schema::{Plot, Published};
use fathom_experiments::{Measure, label_text};
use fathom_record::{Cell, Estimate};

const BAR_PX: f64 = 20.0;
/// Above and below the bars of one value.
const SPACE_PX: f64 = 7.0;
/// Room for figures.
const RIGHT_PX: f64 = 96.0;

struct Bar {
    series: usize,
    /// In the plot's unit.
    value: Estimate,
    /// None of an exact figure.
    n: Option<usize>,
    /// From the shortest to the longest published frame time.
    published: Option<[f64; 2]>,
}

/// None where no cell has a value.
pub fn drawing(plot: &Plot, input: &PlotInput<'_>) -> Option<Drawing> {
    let (y, over) = (plot.y.first()?, plot.over.as_ref()?);
    let mut series = IndexSet::new();
    // Values of the axis, each with a bar for each series that has one.
    let mut clusters = IndexMap::<String, Vec<Bar>>::new();
    let factor = names::factor(y, plot.y_title.as_ref());
    for cell in &input.cells {
        let Some(value) = cell.measured().and_then(|figures| y.read(cell, figures)) else {
            continue;
        };
        let published = input.published(cell).filter(|_| *y == Measure::frame());
        let bar = Bar {
            series: series.insert_full(series_name(cell, over, input)).0,
            value: value.estimate().scaled(factor),
            n: value.n(),
            published: published.map(Published::span_ms),
        };
        let label = cell.axes.get(over).map(label_text).unwrap_or_default();
        clusters.entry(label).or_default().push(bar);
    }
    let bars = || clusters.values().flatten();
    let ends =
        bars().flat_map(|bar| [bar.value.ends()[1], bar.published.map_or(0.0, |span| span[1])]);
    let mut rows = Rows::new(ends, clusters.keys().map(String::as_str), RIGHT_PX)?;
    let of_stage = y.stage_name().filter(|_| series.len() == 1);
    let of_stage = of_stage.map(|stage| input.colors.of(&stage));
    for (label, bars) in &clusters {
        let color = |bar: &Bar| of_stage.unwrap_or_else(|| style::color(bar.series));
        let bars = bars.iter().map(|bar| bar.drawing(&rows, color(bar)));
        let space = || [Drawing::space(SPACE_PX)];
        let row = Drawing::column(space().into_iter().chain(bars).chain(space()));
        rows.push(label, row);
    }
    let named = series.iter().enumerate().filter(|(_, name)| !name.is_empty());
    let named = named.map(|(index, name)| (Mark::Square(style::color(index)), name.clone()));
    let published = bars().any(|bar| bar.published.is_some());
    let published = published.then(|| (Mark::Published, "published".to_owned()));
    Some(rows.drawing(Legend(named.chain(published).collect()), &names::y_title(plot, &[y])))
}

/// The cell's values on the other axes; empty where it has none.
fn series_name(cell: &Cell, over: &str, input: &PlotInput<'_>) -> String {
    if cell.axes.len() > 1 {
        names::cell(cell, Some(over), input.experiment)
    } else {
        String::new()
    }
}

impl Bar {
    fn drawing(&self, rows: &Rows, color: Color) -> Drawing {
        let middle = BAR_PX / 2.0;
        let ends = self.value.ends();
        let n = self.n.map_or_else(String::new, |n| format!(", n = {n}"));
        let content = html! {
            (rows.bar([0.0, self.value.median], [2.0, BAR_PX - 2.0], color))
            (rows.interval(ends, middle))
            @for at in self.published.into_iter().flatten() { (rows.across(at, [0.0, BAR_PX], "published")) }
            (rows.beside(ends[1], middle, &format!("{}{n}", three(self.value.median))))
        };
        Drawing::new(BAR_PX, content)
    }
}
