//! Which cells of an experiment one machine has to measure, and which of them next to each other.

use indexmap::{IndexMap, IndexSet};
use itertools::Itertools;
use serde_json::{Map, Value};

use super::claims::{by_other_axes, compared_cells};
use super::measure::fits_with;
use super::schema::{Claim, Experiment, PlotKind};
use super::{CellPlan, schema::Plot};
use fathom_record::Cell;

impl Experiment {
    /// Splits cells of this experiment into groups that nothing compares: no claim speaks of cells of two groups, and no line of
    /// a plot joins them. Indices into `plans`, in their order.
    pub fn units(&self, plans: &[CellPlan]) -> Vec<Vec<usize>> {
        let mut sets = DisjointSets::new(plans.len());
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
        let speaks =
            |claim: &&Claim| fitting(plans, &claim.filter).iter().any(|i| unit.contains(i));
        self.claim.iter().filter(speaks).count()
    }

    /// Orders cells of this experiment so that times which a claim compares can be measured next to each other. Each chain holds the
    /// cells that claims connect, also through others; a cell that no claim on a time compares is a chain of its own. A cell has two
    /// neighbours at most, and claims on few cells come first: the two cells of a ratio are neighbours, then those of the steps of
    /// a sweep, as far as both have a side free. Indices into `cells`, which may be without results.
    pub fn chains(&self, cells: &[&Cell]) -> Vec<Vec<usize>> {
        let names: IndexSet<&str> = cells.iter().map(|cell| cell.cell.as_str()).collect();
        let sets = self.claim.iter().flat_map(|claim| compared_cells(claim, cells));
        let links: Vec<[usize; 2]> = sets
            .sorted_by_key(Vec::len)
            .flat_map(|set| set.into_iter().tuple_windows().collect_vec())
            .filter_map(|(a, b)| {
                Some([names.get_index_of(&*a.cell)?, names.get_index_of(&*b.cell)?])
            })
            .collect();
        let mut chains: Vec<Vec<usize>> = (0..cells.len()).map(|cell| vec![cell]).collect();
        for link in &links {
            join(&mut chains, *link, true);
        }
        for link in &links {
            join(&mut chains, *link, false);
        }
        chains.retain(|chain| !chain.is_empty());
        chains
    }
}

/// Makes one chain of the two that hold these cells: with the cells as neighbours, or at all. The second chain is left empty.
fn join(chains: &mut [Vec<usize>], [a, b]: [usize; 2], as_neighbours: bool) {
    let holding = |cell: usize| chains.iter().position(|chain| chain.contains(&cell));
    let (Some(of_a), Some(of_b)) = (holding(a), holding(b)) else { return };
    let ends = |chain: &[usize], cell| [chain.first(), chain.last()].contains(&Some(&cell));
    let free = ends(&chains[of_a], a) && ends(&chains[of_b], b);
    if of_a == of_b || as_neighbours && !free {
        return;
    }
    let mut second = std::mem::take(&mut chains[of_b]);
    let first = &mut chains[of_a];
    if as_neighbours && first.last() != Some(&a) {
        first.reverse();
    }
    if as_neighbours && second.first() != Some(&b) {
        second.reverse();
    }
    first.append(&mut second);
}

/// Whether a plot of this kind holds its cells against each other.
fn joins_cells(plot: &Plot) -> bool {
    match plot.kind {
        PlotKind::Scaling | PlotKind::Lines => true,
        PlotKind::Stacked | PlotKind::Bars => false,
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
struct DisjointSets(Vec<usize>);

impl DisjointSets {
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
    use crate::fixtures::{self, cell};
    use fathom_record::{Outcome, Profile};

    fn units(toml: &str) -> Vec<Vec<String>> {
        let experiment = fixtures::own(toml);
        let plans = experiment.cells(Profile::Quick, &[], &[]).unwrap();
        let names = |unit: Vec<usize>| unit.iter().map(|i| plans[*i].cell.clone()).collect();
        experiment.units(&plans).into_iter().map(names).collect()
    }

    const SWEEP: &str = r#"
        [[sweep]]
        [[sweep.axis]]
        name = "caustics.grid"
        values = [10, 20]
        [[sweep.axis]]
        name = "scene"
        values = ["tank", "pool"]
    "#;

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

    const SWEPT: &str = r#"
[[sweep]]
[sweep.axis."caustics.grid"]
values = [10, 20, 40, 80]
[sweep.axis."caustics.filter"]
values = [true, false]
[claim.ratio]
text = "x"
test.ratio = { y = "stage:a", over = "caustics.filter", numerator = true, denominator = false, low = 1, high = 2 }
where = { "caustics.grid" = 80 }
"#;

    fn chains(claims: &str) -> Vec<String> {
        let experiment = fixtures::own(&format!("{SWEPT}{claims}"));
        let plans = experiment.cells(Profile::Quick, &[], &[]).unwrap();
        let outcome = Outcome::Skipped { reason: String::new() };
        let mut records = plans.iter().map(|plan| cell(plan, outcome.clone())).collect_vec();
        let cells: Vec<&Cell> = fixtures::cells(&mut records).map(|cell| &*cell).collect();
        let name = |index: &usize| {
            let axes = &cells[*index].axes;
            let filter = if axes["caustics.filter"] == true { "f" } else { "" };
            format!("{}{filter}", axes["caustics.grid"])
        };
        let chains = experiment.chains(&cells);
        chains.iter().map(|chain| chain.iter().map(name).join(" ")).collect()
    }

    #[test]
    fn cells_of_a_ratio_are_neighbours_and_those_of_a_slope_as_far_as_they_can() {
        assert_eq!(chains(""), ["10f", "10", "20f", "20", "40f", "40", "80f 80"]);
        let slope = r#"
[claim.slope]
text = "x"
test.slope = { y = "TIME", x = "axis:caustics.grid", over = "caustics.grid", expected = 1.0, tolerance = 0.1 }
"#;
        let of_stage = slope.replace("TIME", "stage:a");
        assert_eq!(chains(&of_stage), ["10 20 40 80 80f 40f 20f 10f"]);
        let unfiltered = of_stage.replace("text", "where = { \"caustics.filter\" = false }\ntext");
        assert_eq!(chains(&unfiltered), ["10f", "10 20 40 80 80f", "20f", "40f"].map(String::from));
        let no_time = slope.replace("TIME", "quantity:error");
        assert_eq!(chains(&no_time).len(), 7, "nothing is timed");
    }

    #[test]
    fn a_cell_with_three_partners_has_two_neighbours_and_all_of_them_in_its_chain() {
        let lowest = r#"
[claim.lowest]
text = "x"
test.ratio = { y = "frame", over = "caustics.grid", numerator = 10, high = 1.0 }
[claim.far]
text = "x"
test.ratio = { y = "fps", numerator = { caustics.grid = 10, caustics.filter = false }, denominator = { caustics.grid = 80, caustics.filter = true }, high = 1.0 }
"#;
        let [chain] = &chains(lowest)[..] else { panic!("one chain") };
        assert!(
            format!(" {chain} ").contains(" 10 80f 80 ")
                || format!(" {chain} ").contains(" 80 80f 10 "),
            "{chain}"
        );
        assert_eq!(chain.split(' ').count(), 8, "{chain}");
    }
}
