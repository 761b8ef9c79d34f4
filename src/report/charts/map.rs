//! Heat maps: a coloured, numbered field per cell over two named axes, a map for each value of others.

use std::collections::HashMap;

use indexmap::IndexSet;
use itertools::Itertools;
use plotters::prelude::*;
use serde_json::Value;

use super::{Area, DrawResult, Panel, PlotInput, WIDTH_PX, names, style};
use crate::axis::{Scale, ScaleKind};
use crate::format::three;
use fathom_experiments::label_text;
use fathom_experiments::schema::{Experiment, Plot};
use fathom_record::Cell;

const FIELD_PX: (i32, i32) = (66, 30);
/// A line on what is shown, then each map's title with its columns' labels above the fields.
const TITLE_PX: i32 = 24;
const HEAD_PX: i32 = 58;
/// Labels at the left of a map.
const LABELS_PX: i32 = 104;
const GAP_PX: i32 = 18;
/// Fields of all maps of a plot that are still drawn.
const MAX_FIELDS: usize = 10_000;

pub struct MapPanel {
    /// What the fields show.
    shows: String,
    columns: MapSide,
    rows: MapSide,
    maps: Vec<MapGrid>,
    /// Of the colours of all maps, so that a colour is one value throughout.
    scale: Scale,
}

/// What runs along a side of the maps.
struct MapSide {
    title: String,
    labels: IndexSet<Value>,
}

/// One map: its place on the other axes, and the fields row by row.
struct MapGrid {
    title: String,
    fields: Vec<Vec<Option<f64>>>,
}

impl MapPanel {
    /// None where no cell has a value.
    ///
    /// # Errors
    /// More fields than can be read.
    pub fn new(plot: &Plot, input: &PlotInput<'_>) -> Result<Option<MapPanel>, &'static str> {
        let PlotInput { experiment, cells, .. } = input;
        let (Some(y), Some(across), Some(down)) = (plot.y.first(), &plot.columns, &plot.rows)
        else {
            return Ok(None);
        };
        let columns = MapSide::new(across, experiment, cells);
        let rows = MapSide::new(down, experiment, cells);
        let place = |cell: &Cell| -> Option<Vec<Value>> {
            plot.panels.iter().map(|name| cell.axes.get(name).cloned()).collect()
        };
        let panels: IndexSet<Vec<Value>> = cells.iter().filter_map(|cell| place(cell)).collect();
        if panels.len() * rows.labels.len() * columns.labels.len() > MAX_FIELDS {
            return Err("its maps have more than 10,000 fields, which cells.csv lists");
        }
        let factor = names::factor(y, plot.y_title.as_ref());
        let read = |cell: &&Cell| {
            let value = y.read(cell, cell.measured()?)?.median() * factor;
            let key = (place(cell)?, cell.axes.get(down)?.clone(), cell.axes.get(across)?.clone());
            value.is_finite().then_some((key, value))
        };
        let mut values: HashMap<(Vec<Value>, Value, Value), f64> = HashMap::new();
        for (key, value) in cells.iter().filter_map(read) {
            values.entry(key).or_insert(value);
        }
        let field = |panel: &Vec<Value>, row: &Value, column: &Value| {
            let key = (panel.clone(), row.clone(), column.clone());
            values.get(&key).copied()
        };
        let grid = |panel: Vec<Value>| {
            let fields = rows.labels.iter().map(|row| {
                let columns = columns.labels.iter();
                columns.map(|column| field(&panel, row, column)).collect()
            });
            MapGrid { title: title(plot, experiment, &panel), fields: fields.collect() }
        };
        let has_a_value = |map: &MapGrid| map.fields.iter().flatten().any(Option::is_some);
        let maps: Vec<MapGrid> = panels.into_iter().map(grid).filter(has_a_value).collect();
        let shows = names::y_title(plot, Some(y));
        let scale = scale(values.values().copied());
        Ok(scale.map(|scale| MapPanel { shows, columns, rows, maps, scale }))
    }

    fn map_px(&self) -> (i32, i32) {
        let fields = |side: &MapSide, px: i32| side.labels.len() as i32 * px;
        (
            LABELS_PX + fields(&self.columns, FIELD_PX.0) + GAP_PX,
            HEAD_PX + fields(&self.rows, FIELD_PX.1) + GAP_PX,
        )
    }

    /// Maps beside each other.
    fn across(&self) -> i32 {
        let room = WIDTH_PX as i32 - 16;
        (room / self.map_px().0).clamp(1, self.maps.len().max(1) as i32)
    }

    fn map(&self, area: &Area<'_>, map: &MapGrid, (x, y): (i32, i32)) -> DrawResult {
        let (left, top) = (x + LABELS_PX, y + HEAD_PX);
        let write = |line: &str, style: &TextStyle<'_>, at| area.draw_text(line, style, at);
        write(&map.title, &style::label(), (left, y + 2))?;
        write(&self.columns.title, &style::small(), (left, y + 20))?;
        write(&self.rows.title, &style::small(), (x, y + 38))?;
        for (index, column) in self.columns.labels.iter().enumerate() {
            let middle = left + index as i32 * FIELD_PX.0 + FIELD_PX.0 / 2;
            write(&label_text(column), &style::centered(style::label()), (middle, top - 10))?;
        }
        for (index, (row, fields)) in self.rows.labels.iter().zip(&map.fields).enumerate() {
            let upper = top + index as i32 * FIELD_PX.1;
            let middle = upper + FIELD_PX.1 / 2;
            write(&label_text(row), &style::ending(style::label()), (left - 8, middle))?;
            for (index, field) in fields.iter().enumerate() {
                field_of(area, &self.scale, *field, (left + index as i32 * FIELD_PX.0, upper))?;
            }
        }
        Ok(())
    }
}

/// A coloured field with its number.
fn field_of(area: &Area<'_>, scale: &Scale, value: Option<f64>, (x, y): (i32, i32)) -> DrawResult {
    // Of a single value all shares are 0.
    let share = |value| scale.coord(value).map(|at| scale.share(at).max(0.0));
    let color = value.and_then(share).map_or(style::GAPS, style::shade);
    let corners = [(x + 1, y + 1), (x + FIELD_PX.0 - 1, y + FIELD_PX.1 - 1)];
    area.draw(&Rectangle::new(corners, color.filled()))?;
    let number = value.map_or_else(|| "–".to_owned(), three);
    let ink = style::on(color, style::label());
    let middle = (x + FIELD_PX.0 / 2, y + FIELD_PX.1 / 2);
    area.draw_text(&number, &style::centered(ink), middle)
}

/// Values above it over the smallest need a logarithm, so that small ones differ in colour, too.
const LOG_ABOVE: f64 = 10.0;

/// From the smallest to the largest value; none where there is no value.
fn scale(values: impl Iterator<Item = f64>) -> Option<Scale> {
    let (low, high) = values.minmax().into_option()?;
    let kind = match low > 0.0 && high > LOG_ABOVE * low {
        true => ScaleKind::Log,
        false => ScaleKind::Linear,
    };
    Scale::spanning(kind, [low, high])
}

impl Panel for MapPanel {
    fn height_px(&self) -> u32 {
        let lines = (self.maps.len() as i32 + self.across() - 1) / self.across();
        (TITLE_PX + lines * self.map_px().1 + 8) as u32
    }

    fn draw(&self, area: &Area<'_>) -> DrawResult {
        let line = format!(
            "{}. Colours run from the smallest value (dark) to the largest (light), {} scale.",
            self.shows,
            self.scale.kind.name()
        );
        area.draw_text(&line, &style::small(), (16, 4))?;
        let (width, height) = self.map_px();
        for (index, map) in self.maps.iter().enumerate() {
            let index = index as i32;
            let at =
                (16 + index % self.across() * width, TITLE_PX + index / self.across() * height);
            self.map(area, map, at)?;
        }
        Ok(())
    }
}

/// The panel's place on the axes that have panels: `bunny, threshold 0.5`.
fn title(plot: &Plot, experiment: &Experiment, panel: &[Value]) -> String {
    let named = plot.panels.iter().zip(panel);
    let parts: Vec<String> = named.map(|(name, v)| names::value(name, v, experiment)).collect();
    parts.join(", ")
}

impl MapSide {
    /// The axis' values that measured cells have, in the order of the cells.
    fn new(name: &str, experiment: &Experiment, cells: &[&Cell]) -> MapSide {
        let measured = cells.iter().filter(|cell| cell.measured().is_some());
        MapSide {
            title: names::axis(name, experiment),
            labels: measured.filter_map(|cell| cell.axes.get(name).cloned()).collect(),
        }
    }
}
