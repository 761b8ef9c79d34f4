//! What cells, axes and values are called on plots.

use itertools::Itertools;
use serde_json::Value;

use super::{PlotInput, style};
use fathom_experiments::schema::{Experiment, Plot};
use fathom_experiments::words;
use fathom_experiments::{Measure, label_text};
use fathom_record::Cell;

/// The axis' own title, else its words.
pub fn axis(name: &str, experiment: &Experiment) -> String {
    let axis = experiment.axes().find(|axis| axis.name == name);
    let title = axis.and_then(|axis| axis.title.clone());
    title.unwrap_or_else(|| words::parameter_label(name))
}

/// A value on an axis. Names on an axis without a title stand alone, everything else behind what the axis is called.
pub fn value(axis_name: &str, value: &Value, experiment: &Experiment) -> String {
    let is_titled = experiment.axes().any(|axis| axis.name == axis_name && axis.title.is_some());
    match value {
        Value::String(text) if !is_titled && text.parse::<f64>().is_err() => text.clone(),
        other => format!("{} {}", short_axis(axis_name, experiment), label_text(other)),
    }
}

/// The shorter of the axis' title and its words.
fn short_axis(name: &str, experiment: &Experiment) -> String {
    let names = [axis(name, experiment), words::parameter_label(name)];
    let shortest = names.into_iter().min_by_key(|name| name.chars().count());
    shortest.unwrap_or_default()
}

/// A cell's values on all axes but those that the plot names; its scene where it has no axis.
pub fn cell(cell: &Cell, plot: Option<&Plot>, experiment: &Experiment) -> String {
    let is_named = |name: &str| plot.is_some_and(|plot| plot.axes().contains(&name));
    let axes = cell.axes.iter().filter(|(name, _)| !is_named(name));
    let values: Vec<String> = axes.map(|(name, v)| value(name, v, experiment)).collect();
    if cell.axes.is_empty() { cell.scene.clone() } else { values.join(", ") }
}

/// [`cell`] of each, by the last words of the axes' paths where one is wider than so many pixels: `resolution 128, rays 16`.
pub fn cells(cells: &[&Cell], experiment: &Experiment, max_px: u32) -> Vec<String> {
    let names: Vec<String> = cells.iter().map(|one| cell(one, None, experiment)).collect();
    if names.iter().all(|name| style::width_px(name, style::LABEL_PX) <= max_px) {
        return names;
    }
    let leaf = |path: &String| path.rsplit('.').next().unwrap_or_default().replace('_', " ");
    let short = |one: &&Cell| {
        one.axes.iter().map(|(path, v)| format!("{} {}", leaf(path), label_text(v))).join(", ")
    };
    cells.iter().map(short).collect()
}

/// A stage's name, or the measure in words.
pub fn measure(y: &Measure) -> String {
    y.stage_name().unwrap_or_else(|| y.label().words)
}

/// The factor from a measure's value to that on the ordinate. A title of the plot's own speaks of values as recorded.
pub fn factor(y: &Measure, title: Option<&String>) -> f64 {
    match title {
        Some(_) if y.is_time() => words::FigureUnit::Milliseconds.factor(),
        Some(_) => 1.0,
        None => y.label().unit.factor(),
    }
}

/// The title of the ordinate, which may show one measure only.
pub fn y_title(plot: &Plot, only: Option<&Measure>) -> String {
    match (&plot.y_title, only) {
        (Some(title), _) => title.clone(),
        (None, Some(only)) if !only.is_time() => only.label().text(),
        _ => "time (ms)".to_owned(),
    }
}

/// What the cells of a group share on the axes that a plot is not over; empty where there are none.
pub fn group(plot: &Plot, cells: &[&Cell], experiment: &Experiment) -> String {
    match (&plot.over, cells.first()) {
        (Some(_), Some(first)) if first.axes.len() > 1 => cell(first, Some(plot), experiment),
        _ => String::new(),
    }
}

/// Sizes that a reader of a plot asks for first: dotted paths of parameters.
const SIZES: [&str; 11] = [
    "caustics.grid",
    "caustics.buffer",
    "godrays.grid",
    "godrays.buffer",
    "transfer.grid",
    "planar.texels",
    "ldi.layers",
    "voxel.resolution",
    "ao.rays",
    "ao.samples",
    "shadow.size",
];

/// Scene, viewport and sizes that all measured cells share: `tank, 800 × 800 px, caustic photon grid 200`.
pub(super) fn common(input: &PlotInput<'_>) -> String {
    let cells: Vec<&Cell> =
        input.cells.iter().copied().filter(|cell| cell.measured().is_some()).collect();
    let Some(first) = cells.first() else { return String::new() };
    let shared = |path: &str| {
        let value = first.params.lookup(path)?;
        cells.iter().all(|cell| cell.params.lookup(path) == Some(value)).then_some(value)
    };
    let scene = cells.iter().all(|cell| cell.scene == first.scene);
    let scene = scene.then(|| format!("scene {}", first.scene));
    let viewport = match (shared("view.width"), shared("view.height")) {
        (Some(width), Some(height)) => Some(format!("viewport {width} × {height} px")),
        _ => None,
    };
    let size = |path: &str| {
        let value = label_text(shared(path)?);
        // A size of 0 is taken from another.
        let is_given = value.split('x').any(|side| side != "0");
        is_given.then(|| format!("{} {value}", words::parameter_label(path)))
    };
    let sizes = SIZES.iter().filter_map(|path| size(path));
    scene.into_iter().chain(viewport).chain(sizes).collect::<Vec<_>>().join(" · ")
}
