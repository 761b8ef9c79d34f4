//! Heat maps: a coloured, numbered field per cell over two named axes, a map for each value of others.

use std::collections::HashMap;

use indexmap::IndexSet;
use itertools::Itertools;
use maud::html;
use serde_json::Value;

use super::drawing::{Drawing, MARGIN_PX, WIDTH_PX};
use super::{PlotInput, names, style};
use crate::format::three;
use fathom_experiments::label_text;
use fathom_experiments::schema::{Experiment, Plot};
use fathom_record::Cell;

const FIELD_PX: [f64; 2] = [66.0, 30.0];
/// Each map's title with its columns' labels above the fields.
const HEAD_PX: f64 = 58.0;
/// Labels at the left of a map.
const LABELS_PX: f64 = 104.0;
const GAP_PX: f64 = 18.0;
/// Fields of all maps of a plot that are still drawn.
const MOST_FIELDS: usize = 10_000;

/// What runs along a side of the maps.
struct Side {
    title: String,
    labels: IndexSet<Value>,
}

/// None where no cell has a value.
///
/// # Errors
/// More fields than can be read.
pub fn drawing(plot: &Plot, input: &PlotInput<'_>) -> Result<Option<Drawing>, &'static str> {
    let PlotInput { experiment, cells, .. } = input;
    let (Some(y), Some(across), Some(down)) = (plot.y.first(), &plot.columns, &plot.rows) else {
        return Ok(None);
    };
    let sides = [across, down].map(|name| Side::new(name, experiment, cells));
    let place = |cell: &Cell| -> Option<Vec<Value>> {
        plot.panels.iter().map(|name| cell.axes.get(name).cloned()).collect()
    };
    let panels: IndexSet<Vec<Value>> = cells.iter().filter_map(|cell| place(cell)).collect();
    if panels.len() * sides.iter().map(|side| side.labels.len()).product::<usize>() > MOST_FIELDS {
        return Err("its maps have more than 10,000 fields, which cells.csv lists");
    }
    let factor = names::factor(y, plot.y_title.as_ref());
    let mut values: HashMap<(Vec<Value>, [Value; 2]), f64> = HashMap::new();
    let read = |cell: &&Cell| {
        let value = y.read(cell, cell.measured()?)?.median() * factor;
        let at = [cell.axes.get(across)?.clone(), cell.axes.get(down)?.clone()];
        value.is_finite().then_some(((place(cell)?, at), value))
    };
    for (key, value) in cells.iter().filter_map(read) {
        values.entry(key).or_insert(value);
    }
    let maps = panels.iter().filter_map(|panel| {
        let value = |at: [Value; 2]| values.get(&(panel.clone(), at)).copied();
        map(&sides, &title(plot, experiment, panel), value)
    });
    let maps: Vec<Drawing> = maps.collect();
    let width_px = LABELS_PX + sides[0].labels.len() as f64 * FIELD_PX[0] + GAP_PX;
    let columns = ((WIDTH_PX - MARGIN_PX) / width_px) as usize;
    let of = if maps.len() > 1 { "each map's" } else { "the" };
    let shows = format!(
        "{}. Colours run linearly from {of} smallest value (dark) to its largest (light).",
        names::y_title(plot, &[y])
    );
    let grid = Drawing::grid(&maps, columns.clamp(1, maps.len().max(1)), width_px);
    let parts = [Drawing::lines(MARGIN_PX, &[shows]), Drawing::space(7.0), grid];
    Ok((!maps.is_empty()).then(|| Drawing::column(parts)))
}

/// One map: its title, and a field for each column and row; none where it has no value.
fn map(
    [columns, rows]: &[Side; 2],
    title: &str,
    value: impl Fn([Value; 2]) -> Option<f64>,
) -> Option<Drawing> {
    let places =
        rows.labels.iter().enumerate().cartesian_product(columns.labels.iter().enumerate());
    let fields = places.map(|((row, down), (column, across))| {
        let at = [
            LABELS_PX + MARGIN_PX + column as f64 * FIELD_PX[0],
            HEAD_PX + row as f64 * FIELD_PX[1],
        ];
        (at, value([across.clone(), down.clone()]))
    });
    let fields = fields.collect_vec();
    let values = fields.iter().filter_map(|(_, value)| *value);
    // Of this map alone: a map of large values takes no colours from the others.
    let (low, high) = values.minmax_by(f64::total_cmp).into_option()?;
    let share = |value: f64| if high > low { (value - low) / (high - low) } else { 0.0 };
    let left = MARGIN_PX + LABELS_PX;
    let content = html! {
        text x=(left) y="12" { (title) }
        text.small x=(left) y="30" { (columns.title) }
        text.small x=(MARGIN_PX) y="48" { (rows.title) }
        @for (index, label) in columns.labels.iter().enumerate() {
            text x=(left + (index as f64 + 0.5) * FIELD_PX[0]) y=(HEAD_PX - 6.0) text-anchor="middle" { (label_text(label)) }
        }
        @for (index, label) in rows.labels.iter().enumerate() {
            text x=(left - 8.0) y=(HEAD_PX + (index as f64 + 0.5) * FIELD_PX[1] + 4.0) text-anchor="end" { (label_text(label)) }
        }
        @for ([x, y], value) in &fields {
            @let color = value.map_or(style::GAPS, |value| style::shade(share(value)));
            rect x=(x + 1.0) y=(y + 1.0) width=(FIELD_PX[0] - 2.0) height=(FIELD_PX[1] - 2.0) fill=(color.hex()) {}
            text x=(x + FIELD_PX[0] / 2.0) y=(y + FIELD_PX[1] / 2.0 + 4.0) text-anchor="middle" style={ "fill:" (color.ink().hex()) } {
                (value.map_or_else(|| "–".to_owned(), three))
            }
        }
    };
    let height_px = HEAD_PX + rows.labels.len() as f64 * FIELD_PX[1] + GAP_PX;
    Some(Drawing::new(height_px, content))
}

/// The panel's place on the axes that have panels: `bunny, threshold 0.5`.
fn title(plot: &Plot, experiment: &Experiment, panel: &[Value]) -> String {
    let named = plot.panels.iter().zip(panel);
    named.map(|(name, value)| names::value(name, value, experiment)).join(", ")
}

impl Side {
    /// The axis' values that measured cells have, in the order of the cells.
    fn new(name: &str, experiment: &Experiment, cells: &[&Cell]) -> Side {
        let measured = cells.iter().filter(|cell| cell.measured().is_some());
        Side {
            title: names::axis(name, experiment),
            labels: measured.filter_map(|cell| cell.axes.get(name).cloned()).collect(),
        }
    }
}
