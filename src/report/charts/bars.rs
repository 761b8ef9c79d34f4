//! Panels of horizontal bars, a bar per cell: those of one value of an axis together and the other axes by colour, or an axis by colour and
//! the cells that differ in it alone together.

use indexmap::{IndexMap, IndexSet};
use plotters::prelude::RGBColor;

use super::chart::{BarChart, Item, Legend, Mark};
use super::{PlotInput, names, style};
use crate::format::{interval, three};
use fathom_experiments::label_text;
use fathom_experiments::schema::{Experiment, Plot, Published};
use fathom_record::{Cell, Estimate};

const BAR_PX: f64 = 16.0;
/// Between the bars of one value and those of the next.
const SPACE_PX: f64 = 10.0;

struct MeasureBar {
    series: usize,
    /// In the plot's unit.
    value: Estimate,
    /// None of an exact figure.
    n: Option<usize>,
    /// From the shortest to the longest published frame time.
    published: Option<[f64; 2]>,
}

/// None where no cell has a value.
pub fn chart(plot: &Plot, input: &PlotInput<'_>) -> Option<BarChart> {
    let y = plot.y.first()?;
    let mut series = IndexSet::new();
    let mut clusters = IndexMap::<String, Vec<MeasureBar>>::new();
    let factor = names::factor(y, plot.y_title.as_ref());
    for cell in &input.cells {
        let Some(value) = cell.measured().and_then(|figures| y.read(cell, figures)) else {
            continue;
        };
        let [label, color] = placed(plot, cell, input.experiment)?;
        let bar = MeasureBar {
            series: series.insert_full(color).0,
            value: value.figure().scaled(factor),
            n: value.n(),
            published: input.published(cell, y).map(Published::span_ms),
        };
        clusters.entry(label).or_default().push(bar);
    }
    let bars = || clusters.values().flatten();
    let color_of = |index| style::color_of(index, series.len());
    let named = series.iter().enumerate().filter(|(_, name)| !name.is_empty());
    let squares = named.map(|(index, name)| (Mark::Square(color_of(index)), name.clone()));
    let published = bars().any(|bar| bar.published.is_some());
    let published = published.then(|| (Mark::Published, "published".to_owned()));
    let ends = bars().flat_map(|bar| [bar.value.ends()[1], bar.published.map_or(0.0, |p| p[1])]);
    // Rows are pixels from the bottom.
    let rows = bars().count() as f64 * BAR_PX + clusters.len() as f64 * SPACE_PX;
    // A stage's own colour where no series need colours.
    let of_stage = y.stage_name().filter(|_| series.len() == 1);
    let of_stage = of_stage.map(|stage| style::stage_color(input.colors.color(&stage)));
    let mut row = rows - SPACE_PX / 2.0;
    let mut items = Vec::new();
    for (label, bars) in &clusters {
        items.push(Item::Label(label.clone(), row - BAR_PX * bars.len() as f64 / 2.0));
        for bar in bars {
            row -= BAR_PX;
            let color = of_stage.unwrap_or_else(|| color_of(bar.series));
            items.extend(bar.items(row, color));
        }
        row -= SPACE_PX;
    }
    Some(BarChart {
        x_title: names::y_title(plot, Some(y)),
        scale: BarChart::scale(ends)?,
        rows_px: rows as u32,
        rows,
        right_px: 96,
        legend: Legend(squares.chain(published).collect()),
        items,
    })
}

/// Words beside a cell's bar and those next to it, and what its colour stands for.
fn placed(plot: &Plot, cell: &Cell, experiment: &Experiment) -> Option<[String; 2]> {
    if let Some(axis) = &plot.colors {
        let color = names::value(axis, cell.axes.get(axis)?, experiment);
        return Some([names::cell(cell, Some(plot), experiment), color]);
    }
    let over = plot.over.as_ref()?;
    let label = match cell.axes.get(over)? {
        value if value.is_number() => names::value(over, value, experiment),
        value => label_text(value),
    };
    Some([label, names::group(plot, &[cell], experiment)])
}

impl MeasureBar {
    fn items(&self, row: f64, color: RGBColor) -> Vec<Item> {
        let (top, middle) = (row + BAR_PX, row + BAR_PX / 2.0);
        let [low, high] = self.value.ends();
        let published = self.published.into_iter().flatten();
        let published = published.map(|at| Item::Line([(at, row), (at, top)], 4));
        let n = self.n.map_or_else(String::new, |n| format!(", n = {n}"));
        let bar = Item::Bar([(0.0, row + 1.0), (self.value.median, top - 1.0)], color);
        let tip = Item::Tip(interval(&self.value) + &n);
        let mut items = vec![bar, tip, Item::Line([(low, middle), (high, middle)], 2)];
        items.extend(published);
        items.push(Item::Words(three(self.value.median) + &n, (high, middle), 6));
        items
    }
}
