//! The verdicts of a comparison, from its stored records alone.

use std::collections::{BTreeMap, BTreeSet};

use itertools::Itertools;
use strum::{Display, EnumIter};

use super::counts::{self, Change, CountChange};
use super::exact::{self, Difference, FigureKind};
use super::store::Comparison;
use super::time::{self, CellTime, TimeGate, TimeVerdict};
use fathom_record::comparison::{CellId, ChangedStage, ComparisonHeader, Fault, Gate, Side};

/// Verdict on a cell, the worst first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Display, EnumIter)]
#[strum(serialize_all = "lowercase")]
pub enum CellVerdict {
    /// Its time rose beyond the threshold.
    Slower,
    /// Its error rose, and its time did not fall.
    #[strum(to_string = "less accurate")]
    LessAccurate,
    /// Its time fell and its error rose.
    #[strum(to_string = "faster but less accurate")]
    FasterButLessAccurate,
    /// More declared work, invocations or instructions, though its time did not rise.
    Costlier,
    /// It could not be measured.
    Failed,
    /// A gate that ran has no figure of it, or no gate has any, and no fault says why.
    #[strum(to_string = "not measured")]
    NotMeasured,
    /// Its time is neither shown to be the same nor to differ.
    Inconclusive,
    /// Its exact figures are the same. Its times are of different adapters and are not judged.
    #[strum(to_string = "not judged")]
    NotJudged,
    Faster,
    /// Fewer instructions, and a time that is not faster.
    Cheaper,
    Same,
    /// It asks the GPU for the same work on the same inputs: no gate measured it.
    Unchanged,
    /// The base has no such cell.
    New,
}

impl CellVerdict {
    pub fn is_regression(self) -> bool {
        self <= Self::Costlier
    }
}

/// A cell with everything that concerns it.
#[derive(Clone, Debug, PartialEq)]
pub struct JudgedCell {
    pub cell: CellId,
    pub verdict: CellVerdict,
    pub time: Option<CellTime>,
    pub instructions: Option<CountChange>,
    /// How what it asks of the GPU differs, if it does and is known.
    pub changed: Option<ChangedStage>,
    /// Differences of exact figures charged to this cell.
    pub differences: Vec<Difference>,
    /// Why it could not be measured, by one gate or another; each reason once.
    pub faults: Vec<Fault>,
}

/// How a gate ended.
#[derive(Clone, Debug, PartialEq)]
pub enum GateState {
    Ran,
    /// Not asked for, or not possible here: no failure.
    Skipped(String),
    /// It was asked for and gave no usable figures.
    Void(String),
}

/// The result of a comparison; the number is the exit status.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Display)]
#[repr(u8)]
pub enum Status {
    /// Everything was measured, and no slowdown beyond the threshold is left possible.
    #[strum(to_string = "no regression")]
    NoRegression = 0,
    #[strum(to_string = "regression")]
    Regression = 1,
    #[strum(to_string = "could not measure")]
    CouldNotMeasure = 2,
    /// The interval of a cell's time reaches above the threshold: a slowdown beyond it is neither shown nor excluded. A
    /// cell whose interval is merely too wide downwards does not count.
    #[strum(to_string = "inconclusive")]
    Inconclusive = 3,
    /// Exact figures are no worse. Times were measured and decide nothing: the sides share no pairs, or ran on different adapters.
    #[strum(to_string = "times not judged")]
    TimesNotJudged = 4,
}

/// All verdicts of a comparison.
#[derive(Clone, Debug)]
pub struct Verdicts<'a> {
    pub comparison: &'a Comparison,
    /// In the order of the header.
    pub cells: Vec<JudgedCell>,
    /// Differences of whole configurations.
    pub configurations: Vec<Difference>,
    pub control: Option<CellTime>,
    pub gates: Vec<(Gate, GateState)>,
    /// Faults of a gate as a whole; each reason once.
    pub faults: Vec<Fault>,
    pub status: Status,
}

impl<'a> Verdicts<'a> {
    pub fn judge(comparison: &'a Comparison) -> Self {
        let header = &comparison.header;
        let mut time = time::judge(comparison);
        let gates = Gate::ALL.map(|gate| (gate, state(comparison, gate, &time)));
        if let [.., (Gate::Time, GateState::Void(_))] = &gates {
            time.cells.clear();
        }
        let times: BTreeMap<&CellId, &CellTime> =
            time.cells.iter().map(|cell| (&cell.cell, cell)).collect();
        let counts = counts::judge(comparison);
        let differences = exact::judge(comparison);
        let is_left = |fault: &&Fault| !overcome(comparison, fault);
        let judged = |cell: &CellId| {
            let own = |fault: &&Fault| fault.cell.as_ref() == Some(cell) && !fault.control;
            let mut judged = JudgedCell {
                cell: cell.clone(),
                verdict: CellVerdict::NotMeasured,
                time: times.get(cell).copied().cloned(),
                instructions: counts.get(cell).cloned(),
                changed: comparison.changed.iter().find(|of| of.cell == *cell).cloned(),
                differences: differences.iter().filter(|d| d.concerns(cell)).cloned().collect(),
                faults: unique(comparison.faults.iter().filter(own).filter(is_left)),
            };
            let is_unchanged = comparison.is_unchanged(cell);
            let is_measured = judged.is_measured(comparison, &gates);
            judged.verdict = verdict(&judged, is_unchanged, is_measured);
            judged
        };
        let cells = header.cells.iter().map(judged).collect();
        let of_no_cell = |other: &Difference| !header.cells.iter().any(|cell| other.concerns(cell));
        let whole = comparison.faults.iter().filter(|fault| fault.cell.is_none()).filter(is_left);
        let mut verdicts = Self {
            comparison,
            cells,
            configurations: differences.iter().filter(|other| of_no_cell(other)).cloned().collect(),
            control: time.control,
            gates: gates.into(),
            faults: unique(whole.chain(&exact::missing(comparison))),
            status: Status::NoRegression,
        };
        verdicts.status = verdicts.status();
        verdicts
    }

    fn status(&self) -> Status {
        let settings = &self.comparison.header.settings;
        let any = |verdict| self.cells.iter().any(|cell| cell.verdict == verdict);
        let incomplete = !self.comparison.is_complete() || any(CellVerdict::NotMeasured);
        let regression = self.cells.iter().any(|cell| cell.verdict.is_regression())
            || self.configurations.iter().any(|difference| difference.worse);
        let unjudged = any(CellVerdict::NotJudged)
            || self.comparison.header.skipped.iter().any(|skip| skip.gate == Gate::Time);
        let void = self.gates.iter().any(|(_, state)| matches!(state, GateState::Void(_)));
        let nothing = self.cells.iter().all(|cell| cell.verdict == CellVerdict::New);
        let failed = any(CellVerdict::Failed) || self.faults.iter().any(|fault| !fault.absent);
        if regression {
            Status::Regression
        } else if void || nothing || incomplete || failed {
            Status::CouldNotMeasure
        } else if self.cells.iter().any(|cell| cell.may_be_slower(settings.threshold)) {
            Status::Inconclusive
        } else if unjudged {
            Status::TimesNotJudged
        } else {
            Status::NoRegression
        }
    }

    /// Cells of the base's own list that the head's lacks, and those that the base's list or the base lacks.
    pub fn cells_of_one_side(&self) -> [Vec<&CellId>; 2] {
        let ComparisonHeader { cells, base_cells, .. } = &self.comparison.header;
        let removed = base_cells.iter().filter(|cell| !cells.contains(cell));
        let is_new = |judged: &&JudgedCell| {
            let is_added = !base_cells.is_empty() && !base_cells.contains(&judged.cell);
            is_added || judged.verdict == CellVerdict::New
        };
        let new = self.cells.iter().filter(is_new).map(|judged| &judged.cell);
        [removed.collect(), new.collect()]
    }

    /// Cells whose verdict is a regression, the gravest first: by verdict, then by how much.
    pub fn regressions(&self) -> Vec<&JudgedCell> {
        let regressions = self.cells.iter().filter(|cell| cell.verdict.is_regression());
        let graver = |a: &&JudgedCell, b: &&JudgedCell| {
            a.verdict.cmp(&b.verdict).then(b.weight().total_cmp(&a.weight()))
        };
        regressions.sorted_by(graver).collect()
    }

    /// How many cells have each verdict, the worst verdict first; those that none has are left out.
    pub fn count_verdicts(&self) -> Vec<(CellVerdict, usize)> {
        self.cells.iter().counts_by(|cell| cell.verdict).into_iter().sorted().collect()
    }
}

impl JudgedCell {
    /// Inconclusive, and possibly slower beyond the threshold.
    pub fn may_be_slower(&self, threshold: f64) -> bool {
        let interval = self.time.as_ref().and_then(|time| time.change.interval);
        let excluded = interval.is_some_and(|interval| interval.high <= threshold);
        self.verdict == CellVerdict::Inconclusive && !excluded
    }

    /// Each gate that ran has both sides' figures of the cell, and one did run.
    fn is_measured(&self, comparison: &Comparison, gates: &[(Gate, GateState)]) -> bool {
        let mut ran = gates.iter().filter(|(_, state)| *state == GateState::Ran).peekable();
        let software = comparison.header.adapter.software;
        let has = |gate: Gate| match gate {
            gate if !self.cell.subject().is_measured_by(gate, software) => true,
            Gate::Exact => comparison.has_exact(&self.cell),
            Gate::Instructions => self.instructions.is_some(),
            Gate::Time => self.time.is_some(),
        };
        ran.peek().is_some() && ran.all(|(gate, _)| has(*gate))
    }

    /// By how much the cell changed for the worse: time before instructions.
    fn weight(&self) -> f64 {
        let instructions = self.instructions.as_ref().map(|counted| counted.ratio - 1.0);
        match (&self.time, self.verdict) {
            (Some(time), CellVerdict::Slower) => time.change.median,
            _ => instructions.unwrap_or(0.0),
        }
    }
}

/// One verdict from all gates. A time that is faster outweighs instructions, which cost nothing by themselves.
fn verdict(cell: &JudgedCell, unchanged: bool, measured: bool) -> CellVerdict {
    let time = cell.time.as_ref().map(|time| time.verdict);
    let change = cell.instructions.as_ref().map(|counted| counted.change);
    let worse = |kinds: &[FigureKind]| {
        let mut differences = cell.differences.iter();
        differences.any(|difference| difference.worse && kinds.contains(&difference.kind))
    };
    let less_accurate = worse(&[FigureKind::Error]);
    let more_instructions = change == Some(Change::More) && time != Some(TimeVerdict::Faster);
    if time == Some(TimeVerdict::Slower) {
        CellVerdict::Slower
    } else if less_accurate && time == Some(TimeVerdict::Faster) {
        CellVerdict::FasterButLessAccurate
    } else if less_accurate {
        CellVerdict::LessAccurate
    } else if worse(&[FigureKind::Work, FigureKind::Counter]) || more_instructions {
        CellVerdict::Costlier
    } else if cell.faults.iter().any(|fault| fault.absent) {
        CellVerdict::New
    } else if !cell.faults.is_empty() {
        CellVerdict::Failed
    } else if unchanged {
        CellVerdict::Unchanged
    } else if !measured {
        CellVerdict::NotMeasured
    } else {
        match (time, change) {
            (Some(TimeVerdict::Faster), _) => CellVerdict::Faster,
            (Some(TimeVerdict::Inconclusive), _) => CellVerdict::Inconclusive,
            (Some(TimeVerdict::NotJudged), _) | (_, Some(Change::NotJudged)) => {
                CellVerdict::NotJudged
            }
            (_, Some(Change::Fewer)) => CellVerdict::Cheaper,
            _ => CellVerdict::Same,
        }
    }
}

fn state(comparison: &Comparison, gate: Gate, time: &TimeGate) -> GateState {
    let settings = &comparison.header.settings;
    if !settings.gates.contains(&gate) {
        let skip = comparison.header.skipped.iter().find(|skip| skip.gate == gate);
        let reason = skip.map_or("not asked for", |skip| &skip.reason);
        return GateState::Skipped(reason.to_owned());
    }
    let measured = match gate {
        Gate::Exact => !comparison.exact.is_empty(),
        Gate::Instructions => !comparison.instructions.is_empty(),
        Gate::Time => !comparison.pairs.is_empty(),
    };
    let software = comparison.header.adapter.software;
    let mut own = comparison.header.cells.iter();
    let is_left = |cell: &CellId| {
        cell.subject().is_measured_by(gate, software) && !comparison.is_unchanged(cell)
    };
    if !measured && !comparison.unchanged.is_empty() && !own.any(is_left) {
        return GateState::Skipped("its cells ask the GPU for the same".to_owned());
    }
    if !measured {
        let fault = comparison.faults.iter().find(|fault| fault.gate == gate);
        let reason = fault.map_or("nothing was measured", |fault| &fault.reason);
        return GateState::Void(reason.to_owned());
    }
    let void = || time.void_reason().or_else(|| uncontrolled(comparison, time));
    (gate == Gate::Time).then(void).flatten().map_or(GateState::Ran, GateState::Void)
}

/// Why the pairs of the time gate have no control that covers them, if so.
fn uncontrolled(comparison: &Comparison, time: &TimeGate) -> Option<String> {
    let mut faults = comparison.faults.iter();
    if let Some(lost) = faults.find(|fault| fault.control && !overcome(comparison, fault)) {
        return Some(format!("the control was lost: {}", lost.reason));
    }
    time.control.is_none().then(|| "the control was not measured".to_owned())
}

/// What failed was measured after all: by another launch, or when the comparison was resumed.
fn overcome(comparison: &Comparison, fault: &Fault) -> bool {
    let cell = |own: &CellId| fault.cell.as_ref() == Some(own);
    let is_of = |side: Side, own: &CellId| fault.side == Some(side) && cell(own);
    match fault.gate {
        // What concerns no cell are the checks of all stages.
        Gate::Exact if fault.cell.is_none() => {
            Side::BOTH.into_iter().all(|own| comparison.checks.iter().any(|line| line.side == own))
        }
        Gate::Exact => comparison.exact.iter().any(|line| is_of(line.side, &line.cell)),
        Gate::Instructions => {
            comparison.instructions.iter().any(|line| is_of(line.side, &line.cell))
        }
        // The gate went on, and is given up after the last fault that it does not survive.
        Gate::Time if fault.cell.is_none() => {
            comparison.launches.iter().any(|launch| Some(launch.launch) > fault.launch)
        }
        // A cell or control that failed is left out of all later launches, unless it is tried again.
        Gate::Time => comparison.pairs.iter().any(|pair| {
            cell(&pair.cell) && pair.control == fault.control && Some(pair.launch) > fault.launch
        }),
    }
}

/// Faults with each reason once: a resumed comparison may meet the same one again.
fn unique<'a>(faults: impl Iterator<Item = &'a Fault>) -> Vec<Fault> {
    let mut met = BTreeSet::new();
    faults.filter(|fault| met.insert((fault.gate, fault.side, &fault.reason))).cloned().collect()
}
