//! Which cells of a run are visited next: by time alone, whatever was measured.
//!
//! A run goes around. It begins cells in the order of one list, as far as [`MIN_VISITS`] visits to each fit into the time that is left:
//!
//! 1. the cell of each pipeline that is nearest to the pipeline's defaults, the cheapest pipeline first, and all sizes of a sweep together;
//! 2. units of cells that claims speak of, those first that have the most claims per second of foreseen time;
//! 3. units without claims, the cheapest first.
//!
//! Then it visits what it has begun again and again, what has the fewest visits first, until all have [`MIN_VISITS`]. Visits to a cell lie
//! [`VISIT_S`] apart. What time is left goes to one visit of further cells, as their errors and pictures need no more, then to further
//! visits, the unit with the widest interval first. A unit is what
//! [`Experiment::units`](fathom_experiments::Experiment::units) gives: cells that are compared are sampled in the same rounds.
//!
//! What a cell will take is foreseen from the cell itself, where it was measured before; else its frame from its declared work, in
//! the proportion in which the seen frames of the pipeline (or of all pipelines) stand to theirs, and its preparation and the
//! reading of its figures from the mean of the experiment's cells, or of all cells.

use std::cmp::Ordering;

use itertools::Itertools as _;

use super::sample::CostForecast;
use fathom_base::visits::{MIN_VISITS, VISIT_S};

/// Visits to a cell at most, where no other number is asked for: Student's t hardly shrinks beyond, and the error with the root alone.
pub const MAX_VISITS: u32 = 12;
/// Foreseen for a step of which nothing was seen yet, seconds.
const ASSUMED_STEP_S: f64 = 0.1;
/// Shortest frame that is foreseen, seconds: submissions cost that much.
const SHORTEST_FRAME_S: f64 = 1e-4;

/// Cells of one experiment that are compared with each other.
#[derive(Clone, Debug)]
pub struct ClaimUnit {
    pub experiment: usize,
    pub cells: Vec<usize>,
    /// Claims that speak of them.
    pub claims: usize,
    /// There was time for all visits that an interval takes.
    pub is_promised: bool,
}

/// What a cell's steps took, seconds.
#[derive(Clone, Copy, Debug, Default)]
pub struct CellCosts {
    pub prepare_s: Option<f64>,
    pub pair_s: Option<f64>,
    /// Until its figures were read for the first time; later they are known.
    pub finish_s: Option<f64>,
}

/// How far a cell is.
#[derive(Clone, Debug, Default)]
pub struct CellState {
    pub pipeline: String,
    /// Of one frame, from its declared work.
    pub declared_s: f64,
    /// Its times are not asked for.
    pub untimed: bool,
    /// It has a record.
    pub recorded: bool,
    /// It was skipped or failed.
    pub is_excluded: bool,
    pub visits: usize,
    /// When the latest was, on the run's clock, seconds.
    pub visited_s: f64,
    /// Half the width of its interval over its middle.
    pub half_width: f64,
    pub costs: CellCosts,
}

impl CellState {
    fn is_new(&self) -> bool {
        !self.is_excluded && !self.recorded
    }
}

/// Cells to visit next.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Batch {
    pub experiment: usize,
    pub cells: Vec<usize>,
    /// Of what a page shows first.
    pub is_first: bool,
    /// The unit that is begun with it.
    begins: Option<usize>,
}

#[derive(Clone, Debug, PartialEq)]
pub enum Next {
    Visit(Batch),
    /// Nothing is due before so many seconds are over.
    Wait(f64),
    /// Nothing is left, or nothing fits into the time.
    End,
}

/// The state of a run.
#[derive(Clone, Debug, Default)]
pub struct Schedule {
    /// Of each experiment.
    pub cells: Vec<Vec<CellState>>,
    pub units: Vec<ClaimUnit>,
    /// Experiment and cell: one for each pipeline.
    pub first: Vec<(usize, usize)>,
    /// Experiment and cells: the sizes of each sweep.
    pub sweeps: Vec<(usize, Vec<usize>)>,
    /// To a cell at most.
    pub max_visits: usize,
}

impl Schedule {
    /// What to do now, if `left_s` are left. A run that has measured nothing begins one batch whatever is foreseen, if there is any time.
    pub fn next(&self, now_s: f64, left_s: f64) -> Next {
        let left_s = if self.has_measured() || left_s <= 0.0 { left_s } else { f64::INFINITY };
        let min_visits = MIN_VISITS.min(self.max_visits);
        if let Some(batch) = self.first_batch(left_s) {
            return Next::Visit(batch);
        }
        let owed_s = self.owed_s(min_visits);
        if let Some(unit) = self.unit_to_begin(left_s, owed_s, min_visits) {
            let batch = self.batch(unit, self.max_visits);
            return Next::Visit(Batch { begins: Some(unit), ..batch });
        }
        let promised = self.due(now_s, min_visits, |unit| unit.is_promised);
        let order = |unit: &usize| (self.fewest_visits(*unit), self.visited_s(*unit));
        let owed = promised
            .into_iter()
            .min_by(|a, b| order(a).partial_cmp(&order(b)).unwrap_or(Ordering::Equal));
        if let Some(unit) = owed {
            let batch = self.batch(unit, min_visits);
            if self.cost_s(&batch) <= left_s {
                return Next::Visit(batch);
            }
        }
        let spare_s = left_s - owed_s;
        if let Some(batch) = self.single_visit(spare_s).or_else(|| self.further(now_s, spare_s)) {
            return Next::Visit(batch);
        }
        self.wait(now_s, left_s)
    }

    /// This batch is visited now.
    pub fn begin(&mut self, batch: &Batch) {
        if let Some(unit) = batch.begins {
            self.units[unit].is_promised = true;
        }
    }

    /// Something was measured, now or before.
    pub fn has_measured(&self) -> bool {
        self.all().any(|cell| cell.recorded && !cell.is_excluded)
    }

    pub fn all(&self) -> impl Iterator<Item = &CellState> {
        self.cells.iter().flatten()
    }

    /// The fewest and the most visits to a timed cell that was begun.
    pub fn visits(&self) -> Option<(usize, usize)> {
        let timed = self.all().filter(|cell| !cell.untimed && !cell.is_excluded && cell.visits > 0);
        timed.map(|cell| cell.visits).minmax().into_option()
    }

    /// Foreseen until every cell has the visits that an interval takes, seconds; before anything was measured only the waits between them.
    pub fn needed_s(&self) -> f64 {
        let (min_visits, is_seen) = (MIN_VISITS.min(self.max_visits), self.has_measured());
        let needed = (0..self.units.len()).map(|unit| {
            let lacking = min_visits.saturating_sub(self.fewest_visits(unit));
            let new_s = self.cost_s(&self.batch(unit, 0));
            let is_new = usize::from(new_s > 0.0).min(lacking);
            let own_s = if is_seen { new_s + self.later_s(unit, lacking - is_new) } else { 0.0 };
            // Each further visit waits for the one before.
            (own_s, own_s + (lacking - is_new) as f64 * VISIT_S)
        });
        let (all_s, apart_s) = needed.fold((0.0, 0.0_f64), |a, b| (a.0 + b.0, a.1.max(b.1)));
        all_s.max(apart_s)
    }

    /// What a page shows first.
    fn first_batch(&self, left_s: f64) -> Option<Batch> {
        let alone = self.first.iter().map(|(experiment, cell)| (*experiment, vec![*cell]));
        let batches = alone.chain(self.sweeps.iter().cloned()).map(|(experiment, cells)| {
            let is_new = |cell: &usize| self.cells[experiment][*cell].is_new();
            let cells = cells.into_iter().filter(is_new).collect();
            Batch { experiment, cells, is_first: true, begins: None }
        });
        self.cheapest(batches, left_s)
    }

    /// Of these the cheapest that fits.
    fn cheapest(&self, batches: impl Iterator<Item = Batch>, left_s: f64) -> Option<Batch> {
        let priced = batches.filter(|batch| !batch.cells.is_empty());
        let priced = priced.map(|batch| (self.cost_s(&batch), batch));
        let fitting = priced.filter(|(cost_s, _)| *cost_s <= left_s);
        fitting.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, batch)| batch)
    }

    /// The unit to begin, if all visits to it that an interval takes fit.
    fn unit_to_begin(&self, left_s: f64, owed_s: f64, min_visits: usize) -> Option<usize> {
        let price = |unit: usize| {
            let batch = self.batch(unit, self.max_visits);
            let all_s = self.cost_s(&batch) + self.later_s(unit, min_visits.saturating_sub(1));
            let ClaimUnit { claims, is_promised, .. } = self.units[unit];
            let is_new =
                batch.cells.iter().any(|cell| self.cells[batch.experiment][*cell].is_new());
            let rank = if claims > 0 { 1 } else { 2 };
            let apart_s = self.apart_s(unit, min_visits);
            let is_fitting =
                is_new && !is_promised && all_s <= left_s - owed_s && apart_s <= left_s;
            is_fitting.then_some((rank, all_s / claims.max(1) as f64, unit))
        };
        let prices = (0..self.units.len()).filter_map(price);
        prices.min_by(|a, b| a.partial_cmp(b).unwrap_or(Ordering::Equal)).map(|(.., unit)| unit)
    }

    /// One visit of a unit that was not begun, or else of a cell of one, the cheapest first.
    fn single_visit(&self, left_s: f64) -> Option<Batch> {
        let of_unit = |ClaimUnit { experiment, cells, .. }: &ClaimUnit| {
            let is_new = |cell: &&usize| self.cells[*experiment][**cell].is_new();
            let cells = cells.iter().filter(is_new).copied().collect();
            Batch { experiment: *experiment, cells, is_first: false, begins: None }
        };
        let units = self.units.iter().map(of_unit);
        self.cheapest(units.clone(), left_s).or_else(|| {
            let alone = |batch: Batch| {
                let of = |cell: &usize| Batch { cells: vec![*cell], ..batch.clone() };
                batch.cells.iter().map(of).collect::<Vec<_>>()
            };
            self.cheapest(units.flat_map(alone), left_s)
        })
    }

    /// A further visit to the unit with the widest interval.
    fn further(&self, now_s: f64, left_s: f64) -> Option<Batch> {
        let width = |unit: &usize| {
            let cells = self.batch(*unit, self.max_visits).cells;
            cells.iter().map(|cell| self.state(*unit, *cell).half_width).fold(0.0, f64::max)
        };
        let due = self.due(now_s, self.max_visits, |_| true).into_iter();
        let fitting = due.filter(|unit| {
            self.fewest_visits(*unit) > 0
                && self.cost_s(&self.batch(*unit, self.max_visits)) <= left_s
        });
        let widest = fitting.max_by(|a, b| width(a).total_cmp(&width(b)))?;
        Some(self.batch(widest, self.max_visits))
    }

    /// Until the next visit of a unit is due, if one fits.
    fn wait(&self, now_s: f64, left_s: f64) -> Next {
        let waits = (0..self.units.len()).filter_map(|unit| {
            let batch = self.batch(unit, self.max_visits);
            let wait_s = (self.visited_s(unit) + VISIT_S - now_s).max(0.0);
            let is_waiting = !batch.cells.is_empty() && wait_s > 0.0;
            (is_waiting && wait_s + self.cost_s(&batch) <= left_s).then_some(wait_s)
        });
        waits.min_by(f64::total_cmp).map_or(Next::End, Next::Wait)
    }

    /// What is kept for the visits that promised units still lack: what they take, or until the last of them where they lie apart.
    fn owed_s(&self, min_visits: usize) -> f64 {
        let (mut all_s, mut longest_s) = (0.0, 0.0_f64);
        for unit in (0..self.units.len()).filter(|unit| self.units[*unit].is_promised) {
            let lacking = min_visits.saturating_sub(self.fewest_visits(unit));
            all_s += self.later_s(unit, lacking);
            longest_s = longest_s.max(self.apart_s(unit, lacking));
        }
        all_s.max(longest_s)
    }

    /// From so many visits to a unit to the end of the last, as they lie apart.
    fn apart_s(&self, unit: usize, visits: usize) -> f64 {
        let between = visits.saturating_sub(1) as f64 * VISIT_S;
        between + self.later_s(unit, visits.min(1))
    }

    /// Of so many later visits to a unit.
    fn later_s(&self, unit: usize, visits: usize) -> f64 {
        let ClaimUnit { experiment, cells, .. } = &self.units[unit];
        let timed = cells.iter().filter(|cell| {
            let state = self.state(unit, **cell);
            !state.untimed && !state.is_excluded
        });
        let later = timed.map(|cell| {
            CostForecast { finish_s: 0.0, ..self.forecast(*experiment, *cell) }.visit_s()
        });
        visits as f64 * later.sum::<f64>()
    }

    /// Units with a cell that lacks so many visits and whose latest visit is long enough ago.
    fn due(&self, now_s: f64, visits: usize, of: impl Fn(&ClaimUnit) -> bool) -> Vec<usize> {
        let is_due = |unit: &usize| {
            of(&self.units[*unit])
                && !self.batch(*unit, visits).cells.is_empty()
                && now_s - self.visited_s(*unit) >= VISIT_S
        };
        (0..self.units.len()).filter(is_due).collect()
    }

    /// All cells of a unit, if one lacks so many visits: what is compared is visited together, also with a cell that was visited alone.
    fn batch(&self, unit: usize, visits: usize) -> Batch {
        let ClaimUnit { experiment, cells, .. } = &self.units[unit];
        let lacks_visits = self.fewest_visits(unit) < visits;
        let is_due = |cell: &usize| {
            let state = self.state(unit, *cell);
            state.is_new() || lacks_visits && !state.is_excluded && !state.untimed
        };
        let lacking = cells.iter().copied().filter(is_due);
        Batch { experiment: *experiment, cells: lacking.collect(), is_first: false, begins: None }
    }

    fn state(&self, unit: usize, cell: usize) -> &CellState {
        &self.cells[self.units[unit].experiment][cell]
    }

    /// Of its timed cells.
    fn fewest_visits(&self, unit: usize) -> usize {
        let states = self.units[unit].cells.iter().map(|cell| self.state(unit, *cell));
        let timed = states.filter(|state| !state.is_excluded && !state.untimed);
        timed.map(|state| state.visits).min().unwrap_or(usize::MAX)
    }

    /// The latest visit to a cell of it.
    fn visited_s(&self, unit: usize) -> f64 {
        let cells = self.units[unit].cells.iter();
        cells.map(|cell| self.state(unit, *cell).visited_s).fold(f64::NEG_INFINITY, f64::max)
    }

    /// Foreseen for a batch.
    fn cost_s(&self, Batch { experiment, cells, .. }: &Batch) -> f64 {
        cells.iter().map(|cell| self.forecast(*experiment, *cell).visit_s()).sum()
    }

    pub fn forecast(&self, experiment: usize, cell: usize) -> CostForecast {
        let state = &self.cells[experiment][cell];
        let siblings = &self.cells[experiment];
        let mean = |of: fn(&CellCosts) -> Option<f64>| {
            of(&state.costs)
                .or_else(|| mean(siblings.iter().filter_map(|cell| of(&cell.costs))))
                .or_else(|| mean(self.all().filter_map(|cell| of(&cell.costs))))
                .unwrap_or(ASSUMED_STEP_S)
        };
        let pair_s = state.costs.pair_s.unwrap_or_else(|| {
            2.0 * (state.declared_s * self.slowness(&state.pipeline)).max(SHORTEST_FRAME_S)
        });
        CostForecast {
            prepare_s: mean(|seen| seen.prepare_s),
            pair_s: if state.untimed { 0.0 } else { pair_s },
            finish_s: if state.recorded { 0.0 } else { mean(|seen| seen.finish_s) },
        }
    }

    /// Seen over declared time of frames: of the pipeline, else of all.
    fn slowness(&self, pipeline: &str) -> f64 {
        let ratios = || {
            self.all().filter_map(|cell| {
                let seen_s = cell.costs.pair_s? / 2.0;
                (cell.declared_s > 0.0)
                    .then_some((cell.pipeline.as_str(), seen_s / cell.declared_s))
            })
        };
        let own = mean(ratios().filter(|(of, _)| *of == pipeline).map(|(_, ratio)| ratio));
        own.or_else(|| mean(ratios().map(|(_, ratio)| ratio))).unwrap_or(1.0)
    }
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0), |(sum, count), value| (sum + value, count + 1));
    (count > 0).then(|| sum / f64::from(count))
}

#[cfg(test)]
mod tests;
