//! Which cells of a run are measured next, so that a page can be read early and claims are settled soon.
//!
//! A run works in passes. Each is one or more batches of cells of one experiment, and what comes next is asked after each batch:
//!
//! 1. the cell of each pipeline that is nearest to the pipeline's defaults, the cheapest pipeline first;
//! 2. units of cells that claims speak of, those first that have the most claims per second of foreseen time;
//! 3. units without claims, the cheapest first;
//! 4. the cells of an open claim up to their next look, the cheapest claim first;
//! 5. cells whose interval is wider than asked, up to their next look, the unit with the widest first.
//!
//! A batch that does not fit into the time that is left is passed over; where no unit fits, its cells are measured one by one. A unit is what
//! [`Experiment::units`](fathom_experiments::Experiment::units) gives: cells that are compared are sampled in the same rounds.
//!
//! What a cell will take is foreseen from the cell itself, where it was measured before; else its frame from its declared work, in
//! the proportion in which the seen frames of the pipeline (or of all pipelines) stand to theirs, and its preparation and the
//! reading of its figures from the mean of the experiment's cells, or of all cells.

use super::sample::{Foreseen, Goal, MAX_PAIRS, MIN_PAIRS, targets};

/// Foreseen for a step of which nothing was seen yet, seconds.
const UNSEEN_S: f64 = 0.1;
/// Shortest frame that is foreseen, seconds: submissions cost that much.
const SHORTEST_FRAME_S: f64 = 1e-4;

/// Cells of one experiment that are compared with each other.
#[derive(Clone, Debug)]
pub struct Unit {
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
pub struct Seen {
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
    pub out: bool,
    pub pairs: usize,
    /// Half the width of its interval over its median.
    pub half_width: f64,
    pub seen: Seen,
}

impl CellState {
    /// It has its first look behind it, or will have none.
    fn is_looked_at(&self) -> bool {
        self.out || self.recorded && (self.untimed || self.pairs >= MIN_PAIRS)
    }

    fn may_go_on(&self) -> bool {
        !self.out && !self.untimed && self.pairs < MAX_PAIRS
    }
}

/// What to sample next, and how far.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Batch {
    pub experiment: usize,
    pub cells: Vec<usize>,
    pub goal: Goal,
}

/// The state of a run.
#[derive(Clone, Debug, Default)]
pub struct Schedule {
    /// Of each experiment.
    pub cells: Vec<Vec<CellState>>,
    pub units: Vec<Unit>,
    /// Experiment and cell: one for each pipeline.
    pub first: Vec<(usize, usize)>,
    pub open: Vec<OpenClaim>,
    /// Of the frame time, half the width of the interval over the median.
    pub precision: f64,
}

impl Schedule {
    /// The next batch that fits into the time. A run that has measured nothing begins one whatever is foreseen, if there is any time.
    pub fn next(&self, left_s: f64) -> Option<Batch> {
        let left_s = if self.has_measured() || left_s <= 0.0 { left_s } else { f64::INFINITY };
        let fits = |(cost_s, _): &(f64, Batch)| *cost_s <= left_s;
        let passes: [&dyn Fn() -> Option<(f64, Batch)>; 6] = [
            &|| cheapest(self.first_visits().filter(fits)),
            &|| {
                self.first_looks(
                    |unit, cost_s| (unit.claims > 0).then(|| cost_s / unit.claims as f64),
                    left_s,
                )
            },
            &|| self.first_looks(|_, cost_s| Some(cost_s), left_s),
            &|| cheapest(self.alone().filter(fits)),
            &|| cheapest(self.open_claims().filter(fits)),
            &|| self.widest(left_s),
        ];
        passes.into_iter().find_map(|pass| pass()).map(|(_, batch)| batch)
    }

    /// Something was measured, now or before.
    pub fn has_measured(&self) -> bool {
        self.all().any(|cell| cell.recorded && !cell.out)
    }

    pub fn all(&self) -> impl Iterator<Item = &CellState> {
        self.cells.iter().flatten()
    }

    /// Whether someone may go on with the cell: it is not precise yet, or a claim on it is open, or its unit is not complete.
    pub fn is_open(&self, experiment: usize, cell: usize) -> bool {
        let state = &self.cells[experiment][cell];
        let is_of = |of: usize, cells: &[usize]| of == experiment && cells.contains(&cell);
        let in_claim = || self.open.iter().any(|claim| is_of(claim.experiment, &claim.cells));
        let unit = self.units.iter().find(|unit| is_of(unit.experiment, &unit.cells));
        let complete = || {
            let cells = unit.into_iter().flat_map(|unit| &unit.cells);
            cells.into_iter().all(|cell| self.cells[experiment][*cell].is_looked_at())
        };
        state.may_go_on() && (state.half_width > self.precision || in_claim() || !complete())
    }

    fn first_visits(&self) -> impl Iterator<Item = (f64, Batch)> {
        let due = self.first.iter().filter(|(experiment, cell)| {
            let state = &self.cells[*experiment][*cell];
            !state.recorded && !state.out
        });
        due.map(|(experiment, cell)| self.batch(*experiment, vec![*cell], Goal::FirstVisits))
    }

    /// The unit of the least `price` that fits.
    fn first_looks(
        &self,
        price: impl Fn(&Unit, f64) -> Option<f64>,
        left_s: f64,
    ) -> Option<(f64, Batch)> {
        let priced = self.due().filter_map(|(unit, batch)| Some((price(unit, batch.0)?, batch)));
        let fitting = priced.filter(|(_, (cost_s, _))| *cost_s <= left_s);
        Some(fitting.min_by(|a, b| a.0.total_cmp(&b.0))?.1)
    }

    /// Units that lack a first look, with what they lack.
    fn due(&self) -> impl Iterator<Item = (&Unit, (f64, Batch))> {
        let due = self.units.iter().filter(|unit| {
            unit.cells.iter().any(|cell| !self.cells[unit.experiment][*cell].is_looked_at())
        });
        due.map(|unit| {
            let is_due = |cell: &usize| {
                let state = &self.cells[unit.experiment][*cell];
                !state.is_looked_at() || state.may_go_on()
            };
            let cells = unit.cells.iter().copied().filter(is_due).collect();
            (unit, self.batch(unit.experiment, cells, Goal::FirstLook))
        })
    }

    /// Cells without a record, each by itself, of units that do not fit into the time that is left. No claim compares them yet, but
    /// what they take may show that the others do fit.
    fn alone(&self) -> impl Iterator<Item = (f64, Batch)> {
        let cells =
            self.due().flat_map(|(unit, _)| unit.cells.iter().map(|cell| (unit.experiment, *cell)));
        let without_record = cells.filter(|(experiment, cell)| {
            let state = &self.cells[*experiment][*cell];
            !state.recorded && !state.out
        });
        without_record
            .map(|(experiment, cell)| self.batch(experiment, vec![cell], Goal::FirstVisits))
    }

    fn open_claims(&self) -> impl Iterator<Item = (f64, Batch)> {
        self.open.iter().filter_map(|claim| self.deeper(claim.experiment, &claim.cells))
    }

    fn widest(&self, left_s: f64) -> Option<(f64, Batch)> {
        let wide = self.units.iter().filter_map(|unit| {
            let width = |cell: &usize| self.cells[unit.experiment][*cell].half_width;
            let wide = unit.cells.iter().copied().filter(|cell| width(cell) > self.precision);
            let wide: Vec<usize> = wide.collect();
            let batch = self.deeper(unit.experiment, &wide)?;
            Some((batch.1.cells.iter().map(width).fold(0.0, f64::max), batch))
        });
        let fitting = wide.filter(|(_, (cost_s, _))| *cost_s <= left_s);
        Some(fitting.max_by(|a, b| a.0.total_cmp(&b.0))?.1)
    }

    /// Those of the cells that may go on to their next look.
    fn deeper(&self, experiment: usize, cells: &[usize]) -> Option<(f64, Batch)> {
        let may = |cell: &usize| {
            let state = &self.cells[experiment][*cell];
            state.recorded && state.may_go_on()
        };
        let cells: Vec<usize> = cells.iter().copied().filter(may).collect();
        (!cells.is_empty()).then(|| self.batch(experiment, cells, Goal::NextLook))
    }

    /// With its foreseen time.
    fn batch(&self, experiment: usize, cells: Vec<usize>, goal: Goal) -> (f64, Batch) {
        let pairs = |cell: &usize| self.cells[experiment][*cell].pairs;
        let pairs: Vec<usize> = cells.iter().map(pairs).collect();
        let targets = targets(goal, &pairs);
        let cost = |(cell, (target, pairs)): (&usize, (usize, usize))| {
            let foreseen = self.foreseen(experiment, *cell);
            match goal {
                Goal::FirstVisits => foreseen.first_visits_s(),
                _ => foreseen.visit_s(target - pairs),
            }
        };
        let cost_s = cells.iter().zip(targets.into_iter().zip(pairs)).map(cost).sum();
        (cost_s, Batch { experiment, cells, goal })
    }

    /// What the next steps of a cell will take.
    pub fn foreseen(&self, experiment: usize, cell: usize) -> Foreseen {
        let state = &self.cells[experiment][cell];
        let siblings = &self.cells[experiment];
        let mean = |of: fn(&Seen) -> Option<f64>| {
            of(&state.seen)
                .or_else(|| mean(siblings.iter().filter_map(|cell| of(&cell.seen))))
                .or_else(|| mean(self.all().filter_map(|cell| of(&cell.seen))))
                .unwrap_or(UNSEEN_S)
        };
        let known = state.seen.finish_s.is_some();
        let pair_s = state.seen.pair_s.unwrap_or_else(|| {
            2.0 * (state.declared_s * self.slowness(&state.pipeline)).max(SHORTEST_FRAME_S)
        });
        Foreseen {
            prepare_s: mean(|seen| seen.prepare_s),
            pair_s: if state.untimed { 0.0 } else { pair_s },
            finish_s: if known { 0.0 } else { mean(|seen| seen.finish_s) },
        }
    }

    /// Seen over declared time of frames: of the pipeline, else of all.
    fn slowness(&self, pipeline: &str) -> f64 {
        let ratios = || {
            self.all().filter_map(|cell| {
                let seen_s = cell.seen.pair_s? / 2.0;
                (cell.declared_s > 0.0)
                    .then_some((cell.pipeline.as_str(), seen_s / cell.declared_s))
            })
        };
        let own = mean(ratios().filter(|(of, _)| *of == pipeline).map(|(_, ratio)| ratio));
        own.or_else(|| mean(ratios().map(|(_, ratio)| ratio))).unwrap_or(1.0)
    }
}

fn cheapest(batches: impl Iterator<Item = (f64, Batch)>) -> Option<(f64, Batch)> {
    batches.min_by(|a, b| a.0.total_cmp(&b.0))
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0), |(sum, count), value| (sum + value, count + 1));
    (count > 0).then(|| sum / f64::from(count))
}

#[cfg(test)]
mod tests;
