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
    done: Vec<(f64, Batch)>,
}

impl SimulatedRun {
    /// Each experiment has one unit; the first cells of the first two are those of two pipelines.
    fn new(costs: Vec<Vec<Cost>>, claims: &[usize]) -> Self {
        let state = |pipeline: usize, cost: &Cost| CellState {
            pipeline: (pipeline % 2).to_string(),
            declared_s: cost.frame_s,
            visited_s: f64::NEG_INFINITY,
            half_width: f64::INFINITY,
            ..CellState::default()
        };
        let of_experiment = |(pipeline, costs): (usize, &Vec<Cost>)| {
            costs.iter().map(|cost| state(pipeline, cost)).collect()
        };
        let unit = |(experiment, costs): (usize, &Vec<Cost>)| ClaimUnit {
            experiment,
            cells: (0..costs.len()).collect(),
            claims: claims[experiment],
            is_promised: false,
        };
        let schedule = Schedule {
            cells: costs.iter().enumerate().map(of_experiment).collect(),
            units: costs.iter().enumerate().map(unit).collect(),
            first: vec![(0, 0), (1, 0)],
            sweeps: Vec::new(),
            max_visits: MAX_VISITS as usize,
        };
        Self { schedule, costs, now_s: 0.0, done: Vec::new() }
    }

    /// The next batch, all of it, after the time that it has to wait for; none at the end.
    fn step(&mut self, budget_s: f64) -> bool {
        let batch = loop {
            match self.schedule.next(self.now_s, budget_s - self.now_s) {
                Next::Visit(batch) => break batch,
                Next::Wait(wait_s) => self.now_s += wait_s,
                Next::End => return false,
            }
        };
        self.schedule.begin(&batch);
        let begun_s = self.now_s;
        for cell in &batch.cells {
            let Cost { prepare_s, frame_s, finish_s } = self.costs[batch.experiment][*cell];
            let state = &mut self.schedule.cells[batch.experiment][*cell];
            let finish_s = if state.recorded { 0.0 } else { finish_s };
            let forecast = CostForecast { prepare_s, pair_s: 2.0 * frame_s, finish_s };
            self.now_s += forecast.visit_s();
            state.visits += usize::from(self.now_s - state.visited_s >= VISIT_S);
            (state.recorded, state.visited_s) = (true, self.now_s);
            state.half_width = if state.visits < MIN_VISITS { f64::INFINITY } else { frame_s };
            let [prepare_s, pair_s] = [prepare_s, 2.0 * frame_s].map(Some);
            state.costs = CellCosts { prepare_s, pair_s, finish_s: Some(finish_s) };
        }
        self.done.push((begun_s, batch));
        true
    }

    fn run(mut self, budget_s: f64) -> Self {
        while self.step(budget_s) {}
        self
    }

    fn order(&self) -> Vec<(usize, usize)> {
        self.done.iter().map(|(_, batch)| (batch.experiment, batch.cells.len())).collect()
    }

    fn visits(&self, experiment: usize) -> Vec<usize> {
        self.schedule.cells[experiment].iter().map(|state| state.visits).collect()
    }
}

#[test]
fn each_pipeline_is_seen_first_then_claims_by_their_price_then_the_rest_and_all_again() {
    let slow = Cost { frame_s: 0.5, ..USUAL };
    let costs = vec![vec![USUAL; 2], vec![USUAL; 3], vec![slow; 2], vec![USUAL; 4]];
    let mut model = SimulatedRun::new(costs, &[1, 2, 3, 0]);
    for _ in 0..10 {
        assert!(model.step(1e6));
    }
    // The cell that was seen is sampled again beside those that it is compared with.
    let around = [(1, 3), (0, 2), (2, 2), (3, 4)];
    assert_eq!(model.order(), [&[(0, 1), (1, 1)], &around[..], &around[..]].concat());
}

/// Visits of a cell lie apart, and those that an interval takes come to all that was begun before a further one.
#[test]
fn visits_go_around_until_all_have_enough_and_then_to_the_widest() {
    let slow = Cost { frame_s: 0.5, ..USUAL };
    let model = SimulatedRun::new(vec![vec![USUAL; 2], vec![USUAL; 2], vec![slow; 2]], &[1, 1, 1]);
    let model = model.run(200.0);
    for experiment in 0..3 {
        let of = model.done.iter().filter(|(_, batch)| batch.experiment == experiment);
        let at_s: Vec<f64> = of.skip(1).map(|(at_s, _)| *at_s).collect();
        assert!(at_s.windows(2).all(|pair| pair[1] - pair[0] >= VISIT_S), "{at_s:?}");
        assert!(model.visits(experiment).iter().all(|visits| *visits >= MIN_VISITS));
    }
    let mut late = SimulatedRun::new(vec![vec![USUAL]; 3], &[1, 1, 1]);
    for (cells, half_width) in late.schedule.cells.iter_mut().zip([0.1, 0.3, 0.2]) {
        (cells[0].recorded, cells[0].visits, cells[0].half_width) = (true, MIN_VISITS, half_width);
    }
    assert!(late.step(1e3));
    assert_eq!(late.order(), [(1, 1)]);
    let whole = SimulatedRun::new(vec![vec![USUAL], vec![USUAL]], &[1, 1]).run(1e6);
    assert_eq!((whole.visits(0), whole.visits(1)), (vec![12], vec![12]));
}

/// Of what does not fit four times there is one visit, for its errors and pictures, and none at the cost of what was begun.
#[test]
fn what_fits_once_only_takes_the_time_that_is_left() {
    let slow = Cost { frame_s: 2.0, ..USUAL };
    let model = SimulatedRun::new(vec![vec![USUAL; 4], vec![USUAL; 4], vec![slow; 2]], &[1, 1, 9]);
    let model = model.run(50.0);
    assert!(model.now_s <= 50.0, "{}", model.now_s);
    assert!([0, 1].iter().all(|of| model.visits(*of).iter().all(|visits| *visits >= MIN_VISITS)));
    assert_eq!(model.visits(2), [1, 1], "{:?}", model.order());
}

/// One that was visited alone, long before the others of its unit.
#[test]
fn what_is_compared_is_visited_together_at_all_its_visits() {
    let mut model = SimulatedRun::new(vec![vec![USUAL; 3], vec![USUAL]], &[1, 1]);
    assert!(model.step(1e6));
    model.now_s += 60.0;
    let order = model.run(140.0).order();
    assert!(order.iter().skip(1).all(|(of, cells)| *of == 1 || *cells == 3), "{order:?}");
}

#[test]
fn one_cell_is_begun_however_short_the_time_if_there_is_any() {
    let model = || SimulatedRun::new(vec![vec![USUAL; 2], vec![USUAL]], &[1, 1]);
    assert!(model().run(0.0).done.is_empty());
    assert_eq!(model().run(1e-3).order(), [(0, 1)]);
}

/// A later run that has what an earlier one left: it begins with the cells that were not reached.
#[test]
fn a_resumed_run_measures_what_was_not_reached_first() {
    let costs = vec![vec![USUAL; 2], vec![USUAL; 2], vec![USUAL; 2]];
    let mut model = SimulatedRun::new(costs, &[0, 0, 0]);
    for state in model.schedule.cells[..2].iter_mut().flatten() {
        (state.recorded, state.visits) = (true, MIN_VISITS);
    }
    let order = model.run(100.0).order();
    assert!(order[0] == (2, 2) && order[1].0 != 2, "{order:?}");
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
    let slow = Cost { frame_s: 4.0, ..USUAL };
    let mut model = SimulatedRun::new(vec![vec![USUAL], vec![slow; 8]], &[0, 1]);
    for run in 0..8 {
        model.now_s = 0.0;
        model = model.run(60.0);
        assert!(model.now_s <= 60.0, "run {run}: {} s", model.now_s);
    }
    assert!(model.schedule.all().all(|cell| cell.recorded), "{:?}", model.done);
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
    assert!(model.step(1e3) && model.step(1e3));
    assert_eq!(model.order(), [(0, 1), (1, 3)]);
}

/// What is foreseen after a first visit to each cell is what all visits of an interval take.
#[test]
fn a_budget_is_too_short_below_what_is_foreseen() {
    let slow = Cost { frame_s: 1.0, ..USUAL };
    for costs in [vec![vec![USUAL; 2], vec![USUAL; 3]], vec![vec![slow; 4], vec![slow; 2]]] {
        let least = |budget_s: f64| {
            let model = SimulatedRun::new(costs.clone(), &[1, 1]).run(budget_s);
            model.schedule.all().map(|cell| cell.visits).min().unwrap()
        };
        let mut model = SimulatedRun::new(costs.clone(), &[1, 1]);
        while model.schedule.all().any(|cell| cell.visits == 0) && model.step(1e3) {}
        let needed_s = model.now_s + model.schedule.needed_s();
        assert!(least(1.05 * needed_s) >= MIN_VISITS, "{needed_s} s");
        assert!(least(0.85 * needed_s) < MIN_VISITS, "{needed_s} s");
        while model.step(1e3) {}
        assert_eq!(model.schedule.needed_s(), 0.0);
    }
}
