//! Which of a run's cells belong to a shard.
//!
//! Whole [units](Experiment::units) are dealt out in turn, the largest first. Every machine comes to the same division, as it follows
//! from the plan alone.

use std::cmp::Reverse;

use itertools::Itertools as _;

use fathom_experiments::{CellPlan, Experiment};
use fathom_record::Part;

/// Drops the cells of other shards. `expanded` holds those of each experiment.
pub fn retain_shard(part: Part, experiments: &[Experiment], expanded: &mut [Vec<CellPlan>]) {
    let mut chosen = vec![Vec::new(); expanded.len()];
    let units = units(experiments, expanded);
    let own = units.iter().skip(part.number as usize - 1).step_by(part.of as usize);
    own.for_each(|(experiment, cells)| chosen[*experiment].extend(cells));
    for (plans, chosen) in expanded.iter_mut().zip(chosen) {
        let mut index = 0..;
        plans.retain(|_| index.next().is_some_and(|index| chosen.contains(&index)));
    }
}

/// Experiments and cells that go to one shard together: the largest first; equally large ones in the order of the plan.
fn units(experiments: &[Experiment], expanded: &[Vec<CellPlan>]) -> Vec<(usize, Vec<usize>)> {
    let pairs = experiments.iter().zip(expanded).enumerate();
    let units = pairs.flat_map(|(number, (experiment, plans))| {
        experiment.units(plans).into_iter().map(move |cells| (number, cells))
    });
    units.sorted_by_key(|(_, cells)| Reverse(cells.len())).collect()
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

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

    fn shard_cells(
        number: u32,
        of: u32,
        experiments: &[Experiment],
        expanded: &[Vec<CellPlan>],
    ) -> Vec<Vec<CellPlan>> {
        let mut mine = expanded.to_vec();
        retain_shard(Part { number, of }, experiments, &mut mine);
        mine
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
                let mine = names(&shard_cells(number, of, &experiments, &expanded));
                count += mine.len();
                all.extend(mine);
            }
            let whole = names(&expanded);
            assert_eq!((count, all.len()), (whole.len(), whole.len()), "{of} shards");
            let most = names(&shard_cells(1, of, &experiments, &expanded)).len();
            let least = names(&shard_cells(of, of, &experiments, &expanded)).len();
            let largest = units(&experiments, &expanded)[0].1.len();
            assert!(most - least <= largest, "{of} shards: {most} and {least} cells");
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
            let mine = shard_cells(number, 7, &experiments, &expanded);
            for (experiment, (mine, whole)) in experiments.iter().zip(mine.iter().zip(&expanded)) {
                let all = lengths(experiment, whole);
                assert!(lengths(experiment, mine).is_subset(&all), "{}", experiment.id);
            }
        }
    }
}
