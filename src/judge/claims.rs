//! Rulings on the claims of an experiment, by the cells of a run.

use std::collections::{BTreeSet, HashSet};

use itertools::Itertools;

use fathom_experiments::{self as experiments, Experiment, Ruling};
use fathom_record::{Cell, Profile, Run};

#[derive(Clone, Copy)]
pub struct RunCell<'a> {
    pub cell: &'a Cell,
    pub run: Option<&'a Run>,
}

/// Some of these cells were measured on a software driver.
pub fn is_software(entries: &[RunCell<'_>]) -> bool {
    entries.iter().any(|entry| entry.run.is_none_or(|run| run.adapter.software))
}

/// A ruling on each claim; `run` is the latest.
pub fn rulings(experiment: &Experiment, entries: &[RunCell<'_>], run: Option<&Run>) -> Vec<Ruling> {
    let cells = entries.iter().map(|entry| entry.cell).collect_vec();
    let mut rulings = experiment.rulings(&cells, is_software(entries));
    let is_quick = run.is_some_and(|run| run.profile == Profile::Quick);
    rulings.iter_mut().for_each(|ruling| ruling.is_quick = is_quick);
    rule_out_several_machines(experiment, entries, &cells, &mut rulings);
    rulings
}

/// No verdict rests on two machines: a run may go on elsewhere.
fn rule_out_several_machines(
    experiment: &Experiment,
    entries: &[RunCell<'_>],
    cells: &[&Cell],
    rulings: &mut [Ruling],
) {
    fn host<'a>(entry: &RunCell<'a>) -> Option<&'a str> {
        entry.run?.conditions.host.as_deref()
    }
    if entries.iter().filter_map(host).all_equal() {
        return;
    }
    for (claim, ruling) in experiment.claim.iter().zip(rulings) {
        let concerned: HashSet<*const Cell> =
            experiments::claimed_cells(claim, cells).into_iter().map(std::ptr::from_ref).collect();
        let of_claim = entries.iter().filter(|e| concerned.contains(&std::ptr::from_ref(e.cell)));
        let hosts: BTreeSet<&str> = of_claim.filter_map(host).collect();
        if hosts.len() > 1 {
            let reason = format!("its cells were measured on {}", hosts.iter().join(" and "));
            *ruling = Ruling::not_run(claim, reason);
        }
    }
}
