//! Heat maps: a coloured, numbered field per cell over two named axes, a map for each value of others.

use std::collections::HashMap;

use indexmap::IndexSet;
use plotters::prelude::*;
use serde_json::Value;

use super::{Area, Drawn, Panel, style, unit};
use crate::experiments::label_text;
use crate::experiments::schema::{Experiment, Plot};
use crate::record::Cell;
use crate::report::format::{Table, three};

const FIELD_PX: (i32, i32) = (66, 30);
/// Title of the figure, then of each map with its columns' labels above the fields.
const TITLE_PX: i32 = 34;
const HEAD_PX: i32 = 58;
/// Labels at the left of a map.
const LABELS_PX: i32 = 84;
const GAP_PX: i32 = 26;
/// Fields of all maps of a plot that are still drawn.
const MOST_FIELDS: usize = 10_000;
/// The colour scale at the right.
const LEGEND_PX: i32 = 110;

pub struct Map {
    plot: Plot,
    columns: Side,
    rows: Side,
    maps: Vec<Grid>,
    /// Smallest and largest value of all maps.
    range: (f64, f64),
}

/// What runs along a side of the maps.
struct Side {
    title: String,
    labels: IndexSet<Value>,
}

/// One map: its place on the other axes, and the fields row by row.
struct Grid {
    title: String,
    fields: Vec<Vec<Option<f64>>>,
}

impl Map {
    /// None where no cell has a value.
    ///
    /// # Errors
    /// More fields than can be read.
    pub fn new(
        plot: &Plot,
        experiment: &Experiment,
        cells: &[&Cell],
    ) -> Result<Option<Map>, &'static str> {
        let (Some(y), Some(across), Some(down)) = (plot.y.first(), &plot.columns, &plot.rows)
        else {
            return Ok(None);
        };
        let columns = Side::new(across, experiment, cells);
        let rows = Side::new(down, experiment, cells);
        let place = |cell: &Cell| -> Option<Vec<Value>> {
            plot.panels.iter().map(|name| cell.axes.get(name).cloned()).collect()
        };
        let panels: IndexSet<Vec<Value>> = cells.iter().filter_map(|cell| place(cell)).collect();
        if panels.len() * rows.labels.len() * columns.labels.len() > MOST_FIELDS {
            return Err("its maps have more than 10,000 fields, which cells.csv lists");
        }
        let read = |cell: &&Cell| {
            let value = y.read(cell, cell.measured()?)?.median() * unit(y);
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
        let grid = |panel: Vec<Value>| Grid {
            fields: (rows.labels.iter())
                .map(|row| {
                    let columns = columns.labels.iter();
                    columns.map(|column| field(&panel, row, column)).collect()
                })
                .collect(),
            title: title(plot, experiment, &panel),
        };
        let maps: Vec<Grid> = panels.into_iter().map(grid).collect();
        let all = || maps.iter().flat_map(|map| map.fields.iter().flatten().flatten());
        let ends = [f64::min, f64::max].map(|end| all().copied().reduce(end));
        let [Some(low), Some(high)] = ends else {
            return Ok(None);
        };
        Ok(Some(Map { plot: plot.clone(), columns, rows, maps, range: (low, high) }))
    }

    fn map_px(&self) -> (i32, i32) {
        let fields = |side: &Side, px: i32| side.labels.len() as i32 * px;
        (
            LABELS_PX + fields(&self.columns, FIELD_PX.0) + GAP_PX,
            HEAD_PX + fields(&self.rows, FIELD_PX.1) + GAP_PX,
        )
    }

    /// Maps beside each other.
    fn across(&self) -> i32 {
        let room = super::WIDTH_PX as i32 - LEGEND_PX - 16;
        (room / self.map_px().0).clamp(1, self.maps.len().max(1) as i32)
    }

    fn map(&self, area: &Area<'_>, map: &Grid, (x, y): (i32, i32)) -> Drawn {
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
                self.field(area, *field, (left + index as i32 * FIELD_PX.0, upper))?;
            }
        }
        Ok(())
    }

    fn field(&self, area: &Area<'_>, value: Option<f64>, (x, y): (i32, i32)) -> Drawn {
        let color = value.map_or(style::GRID, |value| style::shade(self.share(value)));
        let corners = [(x + 1, y + 1), (x + FIELD_PX.0 - 1, y + FIELD_PX.1 - 1)];
        area.draw(&Rectangle::new(corners, color.filled()))?;
        let number = value.map_or_else(|| "–".to_owned(), three);
        let ink = style::on(color, style::label());
        let middle = (x + FIELD_PX.0 / 2, y + FIELD_PX.1 / 2);
        area.draw_text(&number, &style::centered(ink), middle)
    }

    /// Place of a value on the colour scale, 0 … 1.
    fn share(&self, value: f64) -> f64 {
        let (low, high) = self.range;
        if high > low { (value - low) / (high - low) } else { 0.0 }
    }

    fn legend(&self, area: &Area<'_>) -> Drawn {
        const STEPS: i32 = 40;
        let left = super::WIDTH_PX as i32 - LEGEND_PX + 10;
        let top = TITLE_PX + HEAD_PX;
        let height = (self.rows.labels.len() as i32 * FIELD_PX.1).max(90);
        for step in 0..STEPS {
            let edge = |step: i32| top + height * step / STEPS;
            let share = 1.0 - (f64::from(step) + 0.5) / f64::from(STEPS);
            let corners = [(left, edge(step)), (left + 16, edge(step + 1))];
            area.draw(&Rectangle::new(corners, style::shade(share).filled()))?;
        }
        let (low, high) = self.range;
        for share in [0.0, 0.5, 1.0] {
            let label = three(low + share * (high - low));
            let at = (left + 22, top + height - (share * f64::from(height)) as i32);
            area.draw_text(&label, &style::starting(style::label()), at)?;
        }
        let title = self.plot.y_title.clone();
        let title = title.unwrap_or_else(|| self.plot.y[0].to_string());
        let title = style::wrap(&title, 18);
        let start = top - 8 - 15 * title.len() as i32;
        for (line, piece) in (0..).zip(&title) {
            area.draw_text(piece, &style::small(), (left, start + 15 * line))?;
        }
        Ok(())
    }
}

impl Panel for Map {
    fn height_px(&self) -> u32 {
        let lines = (self.maps.len() as i32 + self.across() - 1) / self.across();
        (TITLE_PX + lines * self.map_px().1 + 8) as u32
    }

    fn draw(&self, area: &Area<'_>) -> Drawn {
        area.draw_text(&self.plot.title, &style::heading(), (16, 8))?;
        let (width, height) = self.map_px();
        for (index, map) in self.maps.iter().enumerate() {
            let index = index as i32;
            let at =
                (16 + index % self.across() * width, TITLE_PX + index / self.across() * height);
            self.map(area, map, at)?;
        }
        self.legend(area)
    }

    fn tables(&self) -> Vec<(String, Table)> {
        let table = |map: &Grid| {
            let corner = format!("{} \\ {}", self.rows.title, self.columns.title);
            let head = self.columns.labels.iter().map(label_text);
            let mut table = Table::new([corner].into_iter().chain(head));
            for (row, fields) in self.rows.labels.iter().zip(&map.fields) {
                let fields = fields.iter().map(|field| field.map_or_else(|| "–".to_owned(), three));
                table.row([label_text(row)].into_iter().chain(fields));
            }
            let title = [self.plot.title.as_str(), &map.title];
            let title: Vec<&str> = title.into_iter().filter(|part| !part.is_empty()).collect();
            (title.join(", "), table)
        };
        self.maps.iter().map(table).collect()
    }
}

/// The panel's place on the axes that have panels: `bunny, threshold 0.5`.
fn title(plot: &Plot, experiment: &Experiment, panel: &[Value]) -> String {
    let names = plot.panels.iter().zip(panel);
    let parts: Vec<String> = names
        .map(|(name, value)| match value {
            Value::String(text) => text.clone(),
            other => format!("{} {}", axis_title(name, experiment), label_text(other)),
        })
        .collect();
    parts.join(", ")
}

fn axis_title(name: &str, experiment: &Experiment) -> String {
    let axis = experiment.axes().find(|axis| axis.name == name);
    let title = axis.and_then(|axis| axis.title.clone());
    title.unwrap_or_else(|| name.to_owned())
}

impl Side {
    /// The axis' values that measured cells have, in the order of the cells.
    fn new(name: &str, experiment: &Experiment, cells: &[&Cell]) -> Side {
        let measured = cells.iter().filter(|cell| cell.measured().is_some());
        Side {
            title: axis_title(name, experiment),
            labels: measured.filter_map(|cell| cell.axes.get(name).cloned()).collect(),
        }
    }
}
