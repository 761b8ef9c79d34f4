//! Cells of two runs, matched by their names and by what they ask for.

use std::collections::BTreeMap;

use itertools::Itertools;

use fathom_experiments::{flatten, label_text};
use fathom_record::Cell;

/// Differences that are named.
const MAX_NAMED: usize = 3;

/// Cells of a run by experiment and name.
pub type RunCells<'a> = BTreeMap<(&'a str, &'a str), &'a Cell>;

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
    pub fn match_runs(mut base: RunCells<'a>, head: RunCells<'a>) -> Self {
        let mut cells = Self::default();
        for (name, cell) in head {
            match base.remove(&name) {
                Some(of_base) if is_same(of_base, cell) => cells.pairs.push([of_base, cell]),
                Some(of_base) => cells.redefined.push([of_base, cell]),
                None => cells.new.push(cell),
            }
        }
        cells.missing = base.into_values().collect();
        cells
    }
}

fn is_same(base: &Cell, head: &Cell) -> bool {
    base.settings_key() == head.settings_key() && base.has_same_sources(head) != Some(false)
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
