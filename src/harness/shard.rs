//! Which of a run's cells belong to a shard.
//!
//! Whole [units](Experiment::units) are handed out, the costliest first, each to the shard that has the least so far. This is the
//! rule of the longest processing time (Graham 1969, "Bounds on Multiprocessing Timing Anomalies", SIAM J. Appl. Math. 17(2)):
//! the fullest shard takes at most 4/3 of what the best division would give it. Every machine comes to the same division, as
//! it follows from the plan alone.

use fathom_experiments::{CellPlan, Experiment};
use fathom_record::Part;

/// What every cell costs beside the sampling of its frames, as a share of what a timed cell of weight 1 costs: in the reference
/// run on llvmpipe set-up took 0.17 s per cell, and a timed cell 1.5 to 2 s.
const SET_UP_COST: f64 = 0.1;

/// Cells of one experiment that go to one shard together.
struct Unit {
    experiment: usize,
    cells: Vec<usize>,
    cost: f64,
}

/// Drops the cells of other shards. `expanded` holds those of each experiment.
pub fn keep(part: Part, experiments: &[Experiment], expanded: &mut [Vec<CellPlan>]) {
    let mut kept = vec![Vec::new(); expanded.len()];
    let units = units(experiments, expanded);
    for (unit, shard) in units.iter().zip(assigned(&units, part.of)) {
        if shard + 1 == part.number {
            kept[unit.experiment].extend(&unit.cells);
        }
    }
    for (plans, kept) in expanded.iter_mut().zip(kept) {
        let mut index = 0..;
        plans.retain(|_| index.next().is_some_and(|index| kept.contains(&index)));
    }
}

/// The costliest first; equally costly ones in the order of the plan.
fn units(experiments: &[Experiment], expanded: &[Vec<CellPlan>]) -> Vec<Unit> {
    let of_experiment = |(index, (experiment, plans)): (usize, (&Experiment, &Vec<CellPlan>))| {
        let cost = |cell: &usize| SET_UP_COST + sampling_cost(experiment, &plans[*cell]);
        let units = experiment.units(plans).into_iter();
        let units = units.map(|cells| Unit {
            experiment: index,
            cost: cells.iter().map(cost).sum(),
            cells,
        });
        units.collect::<Vec<_>>()
    };
    let pairs = experiments.iter().zip(expanded).enumerate();
    let mut units: Vec<Unit> = pairs.flat_map(of_experiment).collect();
    units.sort_by(|a, b| b.cost.total_cmp(&a.cost));
    units
}

/// A run's time is divided among timed cells by the weights of their experiments.
fn sampling_cost(experiment: &Experiment, plan: &CellPlan) -> f64 {
    if plan.errors_only { 0.0 } else { experiment.weight }
}

/// The shard of each unit, from 0.
fn assigned(units: &[Unit], shards: u32) -> Vec<u32> {
    let mut loads = vec![0.0_f64; shards as usize];
    let assign = |unit: &Unit| {
        let (shard, load) = loads.iter_mut().enumerate().min_by(|a, b| a.1.total_cmp(b.1))?;
        *load += unit.cost;
        u32::try_from(shard).ok()
    };
    units.iter().filter_map(assign).collect()
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use proptest::prelude::*;

    use super::*;
    use crate::catalog::Catalog;
    use crate::plan::{self, Request};
    use fathom_record::Profile;

    fn builtin() -> (Vec<Experiment>, Vec<Vec<CellPlan>>) {
        let request = Request::default();
        let experiments = request.load(&Catalog::builtin()).unwrap();
        let expanded = plan::expand(&experiments, &request, Profile::Quick).unwrap();
        (experiments, expanded)
    }

    /// The cells of one shard.
    fn kept(
        number: u32,
        of: u32,
        experiments: &[Experiment],
        expanded: &[Vec<CellPlan>],
    ) -> Vec<Vec<CellPlan>> {
        let mut mine = expanded.to_vec();
        keep(Part { number, of }, experiments, &mut mine);
        mine
    }

    /// What each shard takes.
    fn loads(units: &[Unit], shards: u32) -> Vec<f64> {
        let mut loads = vec![0.0_f64; shards as usize];
        for (unit, shard) in units.iter().zip(assigned(units, shards)) {
            loads[shard as usize] += unit.cost;
        }
        loads
    }

    fn names(expanded: &[Vec<CellPlan>]) -> Vec<(String, String)> {
        let plans = expanded.iter().flatten();
        plans.map(|plan| (plan.experiment.clone(), plan.cell.clone())).collect()
    }

    #[test]
    fn each_cell_is_in_one_shard() {
        let (experiments, expanded) = builtin();
        for of in [1, 2, 3, 8, 64] {
            let mut all = BTreeSet::new();
            let mut count = 0;
            for number in 1..=of {
                let mine = names(&kept(number, of, &experiments, &expanded));
                count += mine.len();
                all.extend(mine);
            }
            let whole = names(&expanded);
            assert_eq!((count, all.len()), (whole.len(), whole.len()), "{of} shards");
        }
    }

    /// Cells of one claim are in one shard.
    #[test]
    fn no_claim_speaks_of_two_shards() {
        let (experiments, expanded) = builtin();
        let lengths = |experiment: &Experiment, plans: &[CellPlan]| {
            let name = |unit: &Vec<usize>| (plans[unit[0]].cell.clone(), unit.len());
            experiment.units(plans).iter().map(name).collect::<BTreeSet<_>>()
        };
        for number in 1..=7 {
            let mine = kept(number, 7, &experiments, &expanded);
            for (experiment, (mine, whole)) in experiments.iter().zip(mine.iter().zip(&expanded)) {
                let all = lengths(experiment, whole);
                assert!(lengths(experiment, mine).is_subset(&all), "{}", experiment.id);
            }
        }
    }

    proptest! {
        /// Graham's bound holds for any costs.
        #[test]
        fn no_shard_takes_much_more_than_the_others(
            mut costs in prop::collection::vec(0.1..10.0f64, 1..60), shards in 1..20u32,
        ) {
            costs.sort_by(|a, b| b.total_cmp(a));
            let unit = |cost: &f64| Unit { experiment: 0, cells: Vec::new(), cost: *cost };
            let units: Vec<Unit> = costs.iter().map(unit).collect();
            let loads = loads(&units, shards);
            let [fullest, emptiest] =
                [loads.iter().copied().fold(0.0, f64::max), loads.iter().copied().fold(f64::INFINITY, f64::min)];
            prop_assert!(fullest - emptiest <= costs[0] + 1e-9);
            prop_assert!((loads.iter().sum::<f64>() - costs.iter().sum::<f64>()).abs() < 1e-9);
        }
    }
}
