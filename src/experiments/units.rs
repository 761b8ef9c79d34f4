//! Which cells of an experiment one machine has to measure.

use indexmap::IndexMap;
use serde_json::{Map, Value};

use super::claims::by_other_axes;
use super::measure::fits_with;
use super::schema::{Claim, Experiment, PlotKind};
use super::{CellPlan, schema::Plot};

impl Experiment {
    /// Splits cells of this experiment into groups that nothing compares: no claim speaks of cells of two groups, and no line or
    /// ratio of a plot joins them. Indices into `plans`, in their order.
    pub fn units(&self, plans: &[CellPlan]) -> Vec<Vec<usize>> {
        let mut sets = Sets::new(plans.len());
        for claim in &self.claim {
            sets.join(fitting(plans, &claim.filter));
        }
        for plot in self.plot.iter().filter(|plot| joins_cells(plot)) {
            let fitting = fitting(plans, &plot.filter);
            match &plot.over {
                Some(over) => {
                    let groups = by_other_axes(fitting, over, |index| &plans[*index].axes);
                    groups.into_values().for_each(|group| sets.join(group));
                }
                None => sets.join(fitting),
            }
        }
        sets.groups()
    }

    /// How many claims speak of cells of this group of [`units`](Self::units).
    pub fn claims_on(&self, plans: &[CellPlan], unit: &[usize]) -> usize {
        let speaks = |claim: &&Claim| fitting(plans, &claim.filter).iter().any(|i| unit.contains(i));
        self.claim.iter().filter(speaks).count()
    }
}

/// Whether a plot of this kind holds its cells against each other.
fn joins_cells(plot: &Plot) -> bool {
    match plot.kind {
        PlotKind::Scaling | PlotKind::Lines | PlotKind::Ratios => true,
        PlotKind::Stacked | PlotKind::Bars | PlotKind::Map => false,
    }
}

/// The cells that may fit a filter: what it asks of parameters, which a plan does not have resolved, is taken for given.
fn fitting(plans: &[CellPlan], filter: &Map<String, Value>) -> Vec<usize> {
    let fits = |CellPlan { axes, scene, pipeline, .. }: &CellPlan| {
        fits_with(filter, axes, [scene, pipeline], |_, _| true)
    };
    (0..plans.len()).filter(|index| fits(&plans[*index])).collect()
}

/// Disjoint sets of the numbers below a count, each with its least member as its name.
struct Sets(Vec<usize>);

impl Sets {
    fn new(count: usize) -> Self {
        Self((0..count).collect())
    }

    fn name(&mut self, mut member: usize) -> usize {
        while self.0[member] != member {
            self.0[member] = self.0[self.0[member]];
            member = self.0[member];
        }
        member
    }

    fn join(&mut self, members: Vec<usize>) {
        for pair in members.windows(2) {
            let [a, b] = [pair[0], pair[1]].map(|member| self.name(member));
            self.0[a.max(b)] = a.min(b);
        }
    }

    fn groups(mut self) -> Vec<Vec<usize>> {
        let mut groups = IndexMap::<usize, Vec<usize>>::new();
        for member in 0..self.0.len() {
            groups.entry(self.name(member)).or_default().push(member);
        }
        groups.into_values().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fathom_record::Profile;

    fn units(toml: &str) -> Vec<Vec<String>> {
        let experiment = Experiment::parse("own", toml).unwrap();
        let plans = experiment.cells(Profile::Quick, &[], &[]).unwrap();
        let names = |unit: Vec<usize>| unit.iter().map(|i| plans[*i].cell.clone()).collect();
        experiment.units(&plans).into_iter().map(names).collect()
    }

    const SWEEP: &str = r#"
        id = "own"
        title = "Own"
        source = "none"
        pipeline = "underwater"
        scene = "tank"
        [[sweep]]
        [[sweep.axis]]
        name = "caustics.grid"
        values = [10, 20]
        [[sweep.axis]]
        name = "scene"
        values = ["tank", "pool"]
    "#;

    #[test]
    fn cells_that_nothing_compares_are_apart() {
        assert_eq!(units(SWEEP).len(), 4);
    }

    #[test]
    fn a_claim_keeps_the_cells_that_it_speaks_of_together() {
        let claim = r#"
            [[claim]]
            id = "rising"
            text = "It rises"
            where = { scene = "tank" }
            test.monotone = { y = "frame", x = "axis:caustics.grid", over = "caustics.grid", direction = "rising" }
        "#;
        let found = units(&(SWEEP.to_owned() + claim));
        let joined = found.iter().find(|unit| unit.len() > 1).unwrap();
        assert_eq!(found.len(), 3);
        assert!(joined.iter().all(|cell| cell.contains("scene=tank")), "{joined:?}");
        // A claim of several groups is one verdict.
        let all = claim.replace("where = { scene = \"tank\" }", "");
        assert_eq!(units(&(SWEEP.to_owned() + &all)).len(), 1);
    }

    #[test]
    fn lines_of_a_plot_are_not_torn() {
        let plot = r#"
            [[plot]]
            title = "Frames"
            kind = "scaling"
            over = "caustics.grid"
            x = "axis:caustics.grid"
            y = ["frame"]
        "#;
        let found = units(&(SWEEP.to_owned() + plot));
        assert_eq!(found.len(), 2);
        let bars =
            plot.replace("\"scaling\"", "\"bars\"").replace("x = \"axis:caustics.grid\"", "");
        assert_eq!(units(&(SWEEP.to_owned() + &bars)).len(), 4);
    }

    #[test]
    fn every_cell_of_every_builtin_experiment_is_in_one_unit() {
        for id in Experiment::builtin_ids() {
            let experiment = Experiment::load(&id).unwrap();
            let plans = experiment.cells(Profile::Quick, &[], &[]).unwrap();
            let units = experiment.units(&plans);
            let mut members: Vec<usize> = units.iter().flatten().copied().collect();
            members.sort_unstable();
            println!("{id} {} {:?}", plans.len(), units.iter().map(Vec::len).collect::<Vec<_>>());
            assert!(members.into_iter().eq(0..plans.len()), "{id}");
        }
    }
}
