//! Which cells of a run are measured next, so that a page can be read early and claims are settled soon.
//!
//! A run begins cells in the order of one list, as far as they fit into the time that is left:
//!
//! 1. the cell of each pipeline that is nearest to the pipeline's defaults, the cheapest pipeline first, and all sizes of a sweep together;
//! 2. units of cells that claims speak of, those first that have the most claims per second of foreseen time;
//! 3. units without claims, the cheapest first;
//! 4. single cells of units that are too long for the time that is left, the cheapest first.
//!
//! When nothing more can be begun, it deepens: the cells of the cheapest open claim up to their next look, else those of the unit with the
//! widest interval. After each batch the run asks anew. A unit is what
//! [`Experiment::units`](fathom_experiments::Experiment::units) gives: cells that are compared are sampled in the same rounds.
//!
//! What a cell will take is foreseen from the cell itself, where it was measured before; else its frame from its declared work, in
//! the proportion in which the seen frames of the pipeline (or of all pipelines) stand to theirs, and its preparation and the
//! reading of its figures from the mean of the experiment's cells, or of all cells.

use super::sample::{CostForecast, Goal, MAX_PAIRS, MIN_PAIRS, targets};

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
}

/// An open claim: cells whose further samples could settle it.
#[derive(Clone, Debug)]
pub struct OpenClaim {
    pub experiment: usize,
    pub cells: Vec<usize>,
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
    pub pairs: usize,
    /// Half the width of its interval over its median.
    pub half_width: f64,
    pub costs: CellCosts,
}

impl CellState {
    /// It has its first look behind it, or will have none.
    fn is_looked_at(&self) -> bool {
        self.is_excluded || self.recorded && (self.untimed || self.pairs >= MIN_PAIRS)
    }

    fn may_go_on(&self) -> bool {
        !self.is_excluded && !self.untimed && self.pairs < MAX_PAIRS
    }
}

/// What to sample next, and how far.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Batch {
    pub experiment: usize,
    pub cells: Vec<usize>,
    pub goal: Goal,
}

/// A batch that may come next: that of the least rank first, and among those that of the least price.
struct BatchChoice {
    rank: u8,
    price: f64,
    /// Foreseen, seconds.
    cost_s: f64,
    batch: Batch,
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
    pub open: Vec<OpenClaim>,
    /// Of the frame time, half the width of the interval over the median.
    pub precision: f64,
}

impl Schedule {
    /// The next batch that fits into the time. A run that has measured nothing begins one whatever is foreseen, if there is any time.
    pub fn next(&self, left_s: f64) -> Option<Batch> {
        let left_s = if self.has_measured() || left_s <= 0.0 { left_s } else { f64::INFINITY };
        let best = |mut choices: Vec<BatchChoice>| {
            choices.retain(|choice| choice.cost_s <= left_s);
            let order = |a: &BatchChoice, b: &BatchChoice| {
                a.rank.cmp(&b.rank).then_with(|| a.price.total_cmp(&b.price))
            };
            choices.into_iter().min_by(order).map(|choice| choice.batch)
        };
        best(self.to_begin()).or_else(|| best(self.to_deepen()))
    }

    /// Something was measured, now or before.
    pub fn has_measured(&self) -> bool {
        self.all().any(|cell| cell.recorded && !cell.is_excluded)
    }

    pub fn all(&self) -> impl Iterator<Item = &CellState> {
        self.cells.iter().flatten()
    }

    /// What lacks its first look.
    fn to_begin(&self) -> Vec<BatchChoice> {
        let is_new = |experiment: usize, cell: usize| {
            let state = &self.cells[experiment][cell];
            !state.recorded && !state.is_excluded
        };
        let alone = |rank, experiment, cell| {
            let batch = Batch { experiment, cells: vec![cell], goal: Goal::FirstVisits };
            is_new(experiment, cell).then(|| self.choice(rank, batch))
        };
        let first = self.first.iter().filter_map(|(experiment, cell)| alone(0, *experiment, *cell));
        let together = self.sweeps.iter().filter_map(|(experiment, cells)| {
            let cells = cells.iter().copied().filter(|cell| is_new(*experiment, *cell)).collect();
            let batch = Batch { experiment: *experiment, cells, goal: Goal::FirstVisits };
            (!batch.cells.is_empty()).then(|| self.choice(0, batch))
        });
        let mut choices: Vec<BatchChoice> = first.chain(together).collect();
        for ClaimUnit { experiment, cells, claims } in &self.units {
            let state = |cell: &usize| &self.cells[*experiment][*cell];
            if cells.iter().all(|cell| state(cell).is_looked_at()) {
                continue;
            }
            let is_due = |cell: &usize| !state(cell).is_looked_at() || state(cell).may_go_on();
            let due = cells.iter().copied().filter(is_due).collect();
            let batch = Batch { experiment: *experiment, cells: due, goal: Goal::FirstLook };
            let unit = self.choice(if *claims > 0 { 1 } else { 2 }, batch);
            let price = unit.cost_s / (*claims).max(1) as f64;
            choices.push(BatchChoice { price, ..unit });
            // No claim compares them yet, but what they take may show that the others do fit.
            choices.extend(cells.iter().filter_map(|cell| alone(3, *experiment, *cell)));
        }
        choices
    }

    /// Cells that may go on to their next look: of open claims, and of units those whose interval is wider than asked.
    fn to_deepen(&self) -> Vec<BatchChoice> {
        let deeper = |rank, experiment: usize, cells: &[usize], min_width: f64| {
            let may = |cell: &usize| {
                let state = &self.cells[experiment][*cell];
                state.recorded && state.may_go_on() && state.half_width > min_width
            };
            let cells: Vec<usize> = cells.iter().copied().filter(may).collect();
            let batch = Batch { experiment, cells, goal: Goal::NextLook };
            (!batch.cells.is_empty()).then(|| self.choice(rank, batch))
        };
        let claims = self
            .open
            .iter()
            .filter_map(|claim| deeper(0, claim.experiment, &claim.cells, f64::NEG_INFINITY));
        let units = self.units.iter().filter_map(|unit| {
            let wide = deeper(1, unit.experiment, &unit.cells, self.precision)?;
            let width = |cell: &usize| self.cells[unit.experiment][*cell].half_width;
            let widest = wide.batch.cells.iter().map(width).fold(0.0, f64::max);
            Some(BatchChoice { price: -widest, ..wide })
        });
        claims.chain(units).collect()
    }

    /// At the price of its foreseen time.
    fn choice(&self, rank: u8, batch: Batch) -> BatchChoice {
        let pairs = |cell: &usize| self.cells[batch.experiment][*cell].pairs;
        let pairs: Vec<usize> = batch.cells.iter().map(pairs).collect();
        let targets = targets(batch.goal, &pairs);
        let cost = |(cell, (target, pairs)): (&usize, (usize, usize))| {
            let foreseen = self.forecast(batch.experiment, *cell);
            match batch.goal {
                Goal::FirstVisits => foreseen.first_visits_s(),
                _ => foreseen.visit_s(target - pairs),
            }
        };
        let cost_s = batch.cells.iter().zip(targets.into_iter().zip(pairs)).map(cost).sum();
        BatchChoice { rank, price: cost_s, cost_s, batch }
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
