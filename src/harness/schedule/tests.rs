//! Whole runs on a modelled clock: a batch takes what its cells take.

use proptest::prelude::*;

use super::*;

/// What a cell takes in truth, seconds.
#[derive(Clone, Copy, Debug)]
struct Cost {
    prepare_s: f64,
    frame_s: f64,
    finish_s: f64,
}

const USUAL: Cost = Cost { prepare_s: 0.1, frame_s: 0.05, finish_s: 0.1 };

struct SimulatedRun {
    schedule: Schedule,
    costs: Vec<Vec<Cost>>,
    now_s: f64,
    done: Vec<Batch>,
}

impl SimulatedRun {
    /// Each experiment has one unit; the first cells of the first two are those of two pipelines.
    fn new(costs: Vec<Vec<Cost>>, claims: &[usize]) -> Self {
        let state = |pipeline: usize, cost: &Cost| CellState {
            pipeline: (pipeline % 2).to_string(),
            declared_s: cost.frame_s,
            half_width: 1.0,
            ..CellState::default()
        };
        let of_experiment = |(pipeline, costs): (usize, &Vec<Cost>)| {
            costs.iter().map(|cost| state(pipeline, cost)).collect()
        };
        let unit = |(experiment, costs): (usize, &Vec<Cost>)| ClaimUnit {
            experiment,
            cells: (0..costs.len()).collect(),
            claims: claims[experiment],
        };
        let schedule = Schedule {
            cells: costs.iter().enumerate().map(of_experiment).collect(),
            units: costs.iter().enumerate().map(unit).collect(),
            first: vec![(0, 0), (1, 0)],
            precision: 0.02,
            ..Schedule::default()
        };
        Self { schedule, costs, now_s: 0.0, done: Vec::new() }
    }

    /// The next batch, all of it.
    fn step(&mut self, budget_s: f64) -> bool {
        let Some(batch) = self.schedule.next(budget_s - self.now_s) else { return false };
        let cells = &mut self.schedule.cells[batch.experiment];
        let pairs: Vec<usize> = batch.cells.iter().map(|cell| cells[*cell].pairs).collect();
        for (cell, target) in batch.cells.iter().zip(targets(batch.goal, &pairs)) {
            let Cost { prepare_s, frame_s, finish_s } = self.costs[batch.experiment][*cell];
            let state = &mut cells[*cell];
            let first = CostForecast { pair_s: 2.0 * frame_s, ..CostForecast::default() };
            self.now_s += match batch.goal {
                Goal::FirstVisits => prepare_s + first.first_visits_s(),
                _ => prepare_s + first.visit_s(target - state.pairs),
            };
            self.now_s += if state.recorded { 0.0 } else { finish_s };
            state.recorded = true;
            state.pairs = target;
            state.costs = CellCosts {
                prepare_s: Some(prepare_s),
                pair_s: Some(2.0 * frame_s),
                finish_s: Some(finish_s),
            };
        }
        self.done.push(batch);
        true
    }

    fn run(mut self, budget_s: f64) -> Self {
        while self.step(budget_s) {}
        self
    }

    fn order(&self) -> Vec<(usize, Goal)> {
        self.done.iter().map(|batch| (batch.experiment, batch.goal)).collect()
    }
}

#[test]
fn each_pipeline_is_seen_first_then_claims_by_their_price_then_the_rest() {
    let slow = Cost { frame_s: 0.5, ..USUAL };
    let costs = vec![vec![USUAL; 2], vec![USUAL; 3], vec![slow; 2], vec![USUAL; 4]];
    let mut model = SimulatedRun::new(costs, &[1, 2, 3, 0]);
    for _ in 0..6 {
        assert!(model.step(1e6));
    }
    let (first, look) = (Goal::FirstVisits, Goal::FirstLook);
    let expected = [(0, first), (1, first), (1, look), (0, look), (2, look), (3, look)];
    assert_eq!(model.order(), expected);
    // The cell that was seen is sampled again beside those that it is compared with.
    assert_eq!(model.done[2].cells, [0, 1, 2]);
}

#[test]
fn open_claims_come_before_wide_cells_and_all_ends_when_nothing_is_open() {
    let mut model = SimulatedRun::new(vec![vec![USUAL; 2], vec![USUAL; 2]], &[1, 1]);
    for _ in 0..4 {
        assert!(model.step(1e6));
    }
    for state in model.schedule.cells.iter_mut().flatten() {
        state.half_width = 0.01;
    }
    assert_eq!(model.schedule.next(1e6), None, "all are precise, and no claim is open");
    model.schedule.cells[0][0].half_width = 0.5;
    model.schedule.open = vec![OpenClaim { experiment: 1, cells: vec![0, 1] }];
    let next = |model: &mut SimulatedRun| model.schedule.next(1e6).unwrap();
    assert_eq!(next(&mut model), Batch { experiment: 1, cells: vec![0, 1], goal: Goal::NextLook });
    model.schedule.open.clear();
    assert_eq!(next(&mut model), Batch { experiment: 0, cells: vec![0], goal: Goal::NextLook });
    model.schedule.cells[0][0].pairs = MAX_PAIRS;
    assert_eq!(model.schedule.next(1e6), None, "it has the most pairs");
}

#[test]
fn one_cell_is_begun_however_short_the_time_if_there_is_any() {
    let model = || SimulatedRun::new(vec![vec![USUAL; 2], vec![USUAL]], &[1, 1]);
    assert!(model().run(0.0).done.is_empty());
    let model = model().run(1e-3);
    assert_eq!(model.done.len(), 1, "{:?}", model.done);
    assert_eq!((model.done[0].cells.len(), model.done[0].goal), (1, Goal::FirstVisits));
}

/// A later run that has what an earlier one left: it begins with the cells that were not reached.
#[test]
fn a_resumed_run_measures_what_was_not_reached_first() {
    let costs = vec![vec![USUAL; 2], vec![USUAL; 2], vec![USUAL; 2]];
    let mut model = SimulatedRun::new(costs, &[0, 0, 0]);
    for experiment in [0, 1] {
        for state in &mut model.schedule.cells[experiment] {
            (state.recorded, state.pairs) = (true, MIN_PAIRS);
        }
    }
    assert!(model.step(1e6) && model.step(1e6));
    assert_eq!(model.order()[0], (2, Goal::FirstLook));
    assert_eq!(model.order()[1].1, Goal::NextLook);
}

/// Cells that take little are not left out because the first that was seen took long.
#[test]
fn time_that_no_unit_seems_to_fit_into_is_used() {
    let long = Cost { finish_s: 5.0, ..USUAL };
    let model = SimulatedRun::new(vec![vec![long], vec![USUAL; 8]], &[0, 1]).run(30.0);
    assert!(model.schedule.all().all(|cell| cell.recorded), "{:?}", model.done);
}

/// Cells that are compared with each other and take longer together than any run has: each is measured by itself, by run after run.
#[test]
fn runs_that_are_shorter_than_a_unit_measure_its_cells_one_by_one() {
    let slow = Cost { frame_s: 1.0, ..USUAL };
    let mut model = SimulatedRun::new(vec![vec![USUAL], vec![slow; 8]], &[0, 1]);
    for run in 0..8 {
        model.now_s = 0.0;
        model = model.run(60.0);
        assert!(model.now_s <= 60.0, "run {run}: {} s", model.now_s);
    }
    assert!(model.schedule.all().all(|cell| cell.recorded), "{:?}", model.done);
    // Where there is time for all of them, they are sampled together.
    let together = SimulatedRun::new(vec![vec![USUAL], vec![slow; 8]], &[0, 1]).run(1e4);
    let second = together.done.iter().filter(|batch| batch.experiment == 1).nth(1).unwrap();
    assert_eq!((second.cells.len(), second.goal), (8, Goal::FirstLook));
}

proptest! {
    /// Where cells of one experiment take the same, whatever that is, a run ends within its budget.
    #[test]
    fn the_budget_is_kept(
        experiments in prop::collection::vec((1..6usize, 0.0..1.0f64, 0.001..0.5f64, 0.0..1.0f64), 2..8),
        budget_s in 10.0..200.0f64,
    ) {
        let cost = |(_, prepare_s, frame_s, finish_s): &(usize, f64, f64, f64)|
            Cost { prepare_s: *prepare_s, frame_s: *frame_s, finish_s: *finish_s };
        let costs: Vec<_> = experiments.iter().map(|of| vec![cost(of); of.0]).collect();
        let claims: Vec<usize> = (0..costs.len()).collect();
        let largest = costs.iter().flatten().map(|c| c.prepare_s + c.finish_s).fold(0.0, f64::max);
        let cells: usize = costs.iter().map(Vec::len).max().unwrap_or(0);
        let model = SimulatedRun::new(costs, &claims).run(budget_s);
        // The last batch may hold cells of an experiment of which nothing was seen before.
        prop_assert!(model.now_s <= budget_s + largest * cells as f64);
        prop_assert!(!model.done.is_empty());
    }
}

#[test]
fn sizes_of_a_sweep_are_begun_together() {
    let mut model = SimulatedRun::new(vec![vec![USUAL; 2], vec![USUAL; 3]], &[1, 0]);
    (model.schedule.first, model.schedule.sweeps) = (vec![(0, 0)], vec![(1, vec![0, 1, 2])]);
    let mut begun = Vec::new();
    for _ in 0..2 {
        let batch = model.schedule.next(1e3).unwrap();
        for cell in &batch.cells {
            model.schedule.cells[batch.experiment][*cell].recorded = true;
        }
        begun.push((batch.experiment, batch.cells, batch.goal));
    }
    let expected = [(0, vec![0], Goal::FirstVisits), (1, vec![0, 1, 2], Goal::FirstVisits)];
    assert_eq!(begun, expected);
}
