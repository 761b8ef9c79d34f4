//! Which cells two runs have in common.

use std::collections::BTreeMap;

use itertools::Itertools;

use fathom_experiments::{flatten, label_text};
use fathom_record::{Cell, OVER_BUDGET, Outcome};

/// Names that stand in one row.
pub const MAX_NAMED: usize = 3;

/// A cell, and what there is to say of it.
pub type CellRemark<'a> = (&'a Cell, String);

/// Cells of two runs by what became of them.
#[derive(Default)]
pub struct CellMatches<'a> {
    /// Of the same pipeline, scene and parameters, measured in both runs.
    pub both: Vec<[&'a Cell; 2]>,
    pub new: Vec<CellRemark<'a>>,
    pub missing: Vec<CellRemark<'a>>,
    /// Measured in the base only, and why.
    pub lost: Vec<CellRemark<'a>>,
    /// Measured in the head only, and why not in the base.
    pub gained: Vec<CellRemark<'a>>,
    /// Under one name with another pipeline, scene or parameter.
    pub redefined: Vec<CellRemark<'a>>,
}

impl<'a> CellMatches<'a> {
    pub fn match_runs([base, head]: [Vec<&'a Cell>; 2]) -> Self {
        let name = |cell: &&'a Cell| (cell.experiment.as_str(), cell.cell.as_str());
        let mut before: BTreeMap<_, &Cell> = base.iter().map(|cell| (name(cell), *cell)).collect();
        let mut cells = Self::default();
        for cell in head {
            match before.remove(&name(&cell)) {
                Some(earlier) => cells.add([earlier, cell]),
                None => cells.new.push((cell, String::new())),
            }
        }
        let left = base.into_iter().filter(|cell| before.contains_key(&name(cell)));
        cells.missing = left.map(|cell| (cell, String::new())).collect();
        cells
    }

    fn add(&mut self, [base, head]: [&'a Cell; 2]) {
        let reason = |cell: &Cell| match &cell.outcome {
            Outcome::Skipped { reason } | Outcome::Failed { reason } => reason.clone(),
            Outcome::OverBudget => OVER_BUDGET.to_owned(),
            Outcome::Measured(_) => String::new(),
        };
        match (base.measured(), head.measured()) {
            _ if base.settings_key() != head.settings_key()
                || base.has_same_sources(head) == Some(false) =>
            {
                self.redefined.push((head, redefinition(base, head)));
            }
            (Some(_), Some(_)) => self.both.push([base, head]),
            (Some(_), None) => self.lost.push((head, reason(head))),
            (None, Some(_)) => self.gained.push((head, reason(base))),
            (None, None) => {}
        }
    }
}

/// What of a cell's definition differs: `view.width 800 → 400`.
pub fn redefinition(base: &Cell, head: &Cell) -> String {
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
