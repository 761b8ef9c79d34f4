//! Cells of two runs, matched by what they ask for.

use std::collections::BTreeMap;

use itertools::Itertools;

use fathom_experiments::{flatten, label_text};
use fathom_record::Cell;

/// Differences that are named.
const MAX_NAMED: usize = 3;

/// Cells of two runs by what became of them.
#[derive(Default)]
pub struct MatchedCells<'a> {
    /// Of the same pipeline, scene and parameters, whether they were measured or not.
    pub pairs: Vec<[&'a Cell; 2]>,
    pub new: Vec<&'a Cell>,
    pub missing: Vec<&'a Cell>,
    /// Under one name with another pipeline, scene or parameter.
    pub redefined: Vec<[&'a Cell; 2]>,
}

impl<'a> MatchedCells<'a> {
    /// Of cells by their settings keys.
    pub fn match_runs(
        base: &BTreeMap<String, &'a Cell>,
        head: &BTreeMap<String, &'a Cell>,
    ) -> Self {
        let name = |cell: &'a Cell| (cell.experiment.as_str(), cell.cell.as_str());
        let is_pair = |base: &Cell, head: &Cell| base.has_same_sources(head) != Some(false);
        let mut cells = Self::default();
        let mut left = BTreeMap::new();
        for (key, cell) in base {
            match head.get(key).filter(|of_head| is_pair(cell, of_head)) {
                Some(of_head) => cells.pairs.push([cell, of_head]),
                None => drop(left.insert(name(cell), *cell)),
            }
        }
        for (key, cell) in head {
            if base.get(key).is_some_and(|of_base| is_pair(of_base, cell)) {
                continue;
            }
            match left.remove(&name(cell)) {
                Some(of_base) => cells.redefined.push([of_base, cell]),
                None => cells.new.push(cell),
            }
        }
        cells.missing = left.into_values().collect();
        cells
    }
}

/// What of a cell's definition differs: `view.width 800 → 400`.
pub fn redefinition([base, head]: [&Cell; 2]) -> String {
    let [before, after] = [base, head].map(|cell| {
        let of_cell = [("pipeline", &cell.pipeline), ("scene", &cell.scene)];
        let of_cell = of_cell.map(|(name, value)| (name.to_owned(), value.clone()));
        let stand_ins = ("stand-ins".to_owned(), cell.stand_ins.join(", "));
        let sources = base.has_same_sources(head).map(|_| cell.sources.clone());
        let params = flatten(&cell.params.to_map()).into_iter();
        let params = params.map(|(path, value)| (path, label_text(&value)));
        of_cell
            .into_iter()
            .chain([stand_ins])
            .chain(sources.unwrap_or_default())
            .chain(params)
            .collect::<BTreeMap<_, _>>()
    });
    let differing = before.keys().chain(after.keys()).unique();
    let differing = differing.filter(|name| before.get(*name) != after.get(*name));
    let differing = differing.take(MAX_NAMED);
    let value = |of: &BTreeMap<String, String>, name| of.get(name).map_or("none", |v| v).to_owned();
    differing
        .map(|name| format!("{name} {} → {}", value(&before, name), value(&after, name)))
        .join(", ")
}
