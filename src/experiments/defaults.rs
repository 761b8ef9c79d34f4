//! Which of a pipeline's cells is nearest to the pipeline's defaults: a run measures it first, and a page shows it.

use std::collections::HashMap;

use itertools::Itertools;
use serde_json::{Map, Value};

use super::{CellPlan, flatten};

/// What the distance of a cell from the defaults is read from.
pub struct CellSettings<'a> {
    /// It is a cell of a sweep.
    pub swept: bool,
    /// Parameters that its plan sets; none where no plan has it.
    pub settings: Option<usize>,
    pub scene: &'a str,
    pub params: Map<String, Value>,
}

/// The smaller, the nearer. Cells of an experiment without a sweep come first; then those whose experiment sets the fewest
/// parameters; then those with the fewest parameters that differ from what most of the cells have.
pub type Distance = (bool, usize, usize);

/// Distances of the cells of one pipeline.
pub fn distances(cells: &[CellSettings<'_>]) -> Vec<Distance> {
    let settings = |cell: &CellSettings<'_>| -> Vec<(String, String)> {
        let scene = ("scene".to_owned(), cell.scene.into());
        let all = flatten(&cell.params).into_iter().chain([scene]);
        all.map(|(path, value)| (path, value.to_string())).collect()
    };
    let all: Vec<_> = cells.iter().map(settings).collect();
    let counts = all.iter().flatten().counts();
    let mut max_counts: HashMap<&str, usize> = HashMap::new();
    for ((path, _), count) in &counts {
        let max_count = max_counts.entry(path).or_default();
        *max_count = (*max_count).max(*count);
    }
    let is_unusual = |entry: &&(String, String)| counts[*entry] < max_counts[entry.0.as_str()];
    let unusual = all.iter().map(|settings| settings.iter().filter(is_unusual).count());
    let distances = cells.iter().zip(unusual);
    distances.map(|(cell, n)| (cell.swept, cell.settings.unwrap_or(usize::MAX), n)).collect()
}

impl CellPlan {
    /// How many parameters it sets.
    pub fn settings(&self) -> usize {
        self.overrides.iter().map(|(path, _)| path).unique().count()
    }
}
