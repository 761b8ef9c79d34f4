//! From what was measured to what is concluded: a function of the stored lines alone.

use std::collections::BTreeMap;

use super::exact::{self, Difference, FigureKind};
use super::instructions::{self, Change, Counted};
use super::store::StoredComparison;
use super::time::{self, CellTime, TimeGate, TimeVerdict};
use super::unpaired::{self, Unpaired};
use crate::record::comparison::{CellId, Fault, Gate, Side};

/// What is concluded of a cell, the worst first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum CellVerdict {
    /// Its time rose beyond the threshold.
    Slower,
    /// Its error rose, and its time did not fall.
    LessAccurate,
    /// Its time fell and its error rose.
    FasterButLessAccurate,
    /// More declared work, invocations or instructions, though its time did not rise.
    Costlier,
    /// It could not be measured.
    Failed,
    /// A gate that ran has no figure of it, or no gate has any, and nothing tells why.
    NotMeasured,
    /// Its time can be told neither the same nor different.
    Inconclusive,
    /// Its exact figures are the same; its times are unpaired, and nobody can tell by them.
    NotJudged,
    Faster,
    /// Fewer instructions, and a time that is not faster.
    Cheaper,
    Same,
    /// The base has no such cell.
    New,
}

impl CellVerdict {
    pub fn is_regression(self) -> bool {
        self <= Self::Costlier
    }

    pub fn text(self) -> &'static str {
        match self {
            Self::Slower => "slower",
            Self::LessAccurate => "less accurate",
            Self::FasterButLessAccurate => "faster but less accurate",
            Self::Costlier => "costlier",
            Self::Failed => "failed",
            Self::NotMeasured => "not measured",
            Self::Inconclusive => "inconclusive",
            Self::NotJudged => "not judged",
            Self::Faster => "faster",
            Self::Cheaper => "cheaper",
            Self::Same => "same",
            Self::New => "new",
        }
    }
}

/// A cell with everything that speaks of it.
#[derive(Clone, Debug, PartialEq)]
pub struct JudgedCell {
    pub cell: CellId,
    pub verdict: CellVerdict,
    pub time: Option<CellTime>,
    /// Times of runs apart from each other, told and not judged.
    pub unpaired: Option<Unpaired>,
    pub instructions: Option<Counted>,
    /// Exact figures that differ and tell on this cell.
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
    /// It was to run and gave nothing that may be believed.
    Void(String),
}

/// The end of a comparison.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// Everything was measured, and no slowdown beyond the threshold is left possible.
    NoRegression,
    Regression,
    CouldNotMeasure,
    /// The interval of a cell's time reaches above the threshold: a slowdown beyond it is neither shown nor excluded. A
    /// cell whose interval is merely too wide downwards does not count.
    Inconclusive,
}

impl Status {
    pub fn exit_code(self) -> u8 {
        match self {
            Self::NoRegression => 0,
            Self::Regression => 1,
            Self::CouldNotMeasure => 2,
            Self::Inconclusive => 3,
        }
    }

    pub fn text(self) -> &'static str {
        match self {
            Self::NoRegression => "no regression",
            Self::Regression => "regression",
            Self::CouldNotMeasure => "could not measure",
            Self::Inconclusive => "inconclusive",
        }
    }
}

/// Everything that is concluded from a comparison.
#[derive(Clone, Debug)]
pub struct Verdicts<'a> {
    pub comparison: &'a StoredComparison,
    /// In the order of the header.
    pub cells: Vec<JudgedCell>,
    /// Differences of whole configurations.
    pub configurations: Vec<Difference>,
    pub controls: Vec<CellTime>,
    pub gates: Vec<(Gate, GateState)>,
    /// Faults of a gate as a whole; each reason once.
    pub faults: Vec<Fault>,
    pub status: Status,
}

impl<'a> Verdicts<'a> {
    pub fn of(comparison: &'a StoredComparison) -> Self {
        let header = &comparison.header;
        let time = time::judge(&header.cells, &comparison.pairs, &header.settings);
        let differences = exact::judge(comparison);
        let gates = Gate::ALL.map(|gate| (gate, state(comparison, gate, &time)));
        let believed = gates.iter().all(|(gate, state)| {
            let time_void = *gate == Gate::Time && matches!(state, GateState::Void(_));
            !time_void
        });
        let sources = Sources {
            comparison,
            time: if believed { by_cell(&time) } else { BTreeMap::new() },
            gates: &gates,
            counts: instructions::judge(comparison),
            unpaired: unpaired::judge(comparison),
            differences: &differences,
        };
        let cells: Vec<JudgedCell> = header.cells.iter().map(|cell| sources.cell(cell)).collect();
        let told = |difference: &Difference| {
            let mut cells = header.cells.iter();
            cells.any(|cell| difference.concerns(cell))
        };
        let configurations: Vec<Difference> =
            differences.iter().filter(|difference| !told(difference)).cloned().collect();
        let whole = |fault: &&Fault| fault.cell.is_none() && !overcome(comparison, fault);
        let missing = exact::missing(comparison);
        let faults = unique(comparison.faults.iter().filter(whole).chain(&missing));
        let status = status(comparison, &cells, &configurations, &gates, &faults);
        Self {
            comparison,
            cells,
            configurations,
            controls: time.controls,
            gates: gates.into(),
            faults,
            status,
        }
    }

    /// Cells whose verdict is a regression, the gravest first: by verdict, then by how much.
    pub fn regressions(&self) -> Vec<&JudgedCell> {
        let mut found: Vec<&JudgedCell> =
            self.cells.iter().filter(|cell| cell.verdict.is_regression()).collect();
        found.sort_by(|a, b| {
            let by_verdict = a.verdict.cmp(&b.verdict);
            by_verdict.then(b.weight().total_cmp(&a.weight()))
        });
        found
    }

    pub fn count(&self, verdict: CellVerdict) -> usize {
        let of = |cell: &&JudgedCell| cell.verdict == verdict;
        self.cells.iter().filter(of).count()
    }
}

impl JudgedCell {
    /// Inconclusive, and possibly slower beyond the threshold.
    pub fn may_be_slower(&self, threshold: f64) -> bool {
        let interval = self.time.as_ref().and_then(|time| time.interval);
        let excluded = interval.is_some_and(|(_, high)| high <= threshold);
        self.verdict == CellVerdict::Inconclusive && !excluded
    }

    /// By how much the cell changed for the worse: time before instructions.
    fn weight(&self) -> f64 {
        let instructions = self.instructions.as_ref().map(|counted| counted.ratio - 1.0);
        match (&self.time, self.verdict) {
            (Some(time), CellVerdict::Slower) => time.change,
            _ => instructions.unwrap_or(0.0),
        }
    }
}

/// What speaks of cells.
struct Sources<'a> {
    comparison: &'a StoredComparison,
    gates: &'a [(Gate, GateState)],
    time: BTreeMap<CellId, CellTime>,
    counts: BTreeMap<CellId, Counted>,
    unpaired: BTreeMap<CellId, Unpaired>,
    differences: &'a [Difference],
}

impl Sources<'_> {
    fn cell(&self, cell: &CellId) -> JudgedCell {
        let differences: Vec<Difference> = self
            .differences
            .iter()
            .filter(|difference| difference.concerns(cell))
            .cloned()
            .collect();
        let own = |fault: &&Fault| {
            fault.cell.as_ref() == Some(cell) && !fault.control && !overcome(self.comparison, fault)
        };
        let faults = unique(self.comparison.faults.iter().filter(own));
        let mut all = JudgedCell {
            verdict: CellVerdict::NotMeasured,
            cell: cell.clone(),
            time: self.time.get(cell).cloned(),
            unpaired: self.unpaired.get(cell).cloned(),
            instructions: self.counts.get(cell).cloned(),
            differences,
            faults,
        };
        all.verdict = verdict(&all, self.measured(&all));
        all
    }

    /// Each gate that ran has both sides' figures of the cell, and one did run.
    fn measured(&self, cell: &JudgedCell) -> bool {
        let mut ran = self.gates.iter().filter(|(_, state)| *state == GateState::Ran);
        let has = |gate: Gate| match gate {
            Gate::Exact => self.comparison.has_exact(&cell.cell),
            Gate::Instructions => cell.instructions.is_some(),
            Gate::Time => cell.time.is_some() || cell.unpaired.is_some(),
        };
        ran.clone().next().is_some() && ran.all(|(gate, _)| has(*gate))
    }
}

fn by_cell(time: &TimeGate) -> BTreeMap<CellId, CellTime> {
    let cells = time.cells.iter();
    cells.map(|cell| (cell.cell.clone(), cell.clone())).collect()
}

/// One verdict from all gates. A time that is told faster outweighs instructions, which cost nothing by themselves.
fn verdict(cell: &JudgedCell, measured: bool) -> CellVerdict {
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
    } else if !measured {
        CellVerdict::NotMeasured
    } else {
        match (time, change) {
            (Some(TimeVerdict::Faster), _) => CellVerdict::Faster,
            (Some(TimeVerdict::Inconclusive), _) => CellVerdict::Inconclusive,
            (_, Some(Change::Fewer)) => CellVerdict::Cheaper,
            (None, None) if cell.unpaired.is_some() => CellVerdict::NotJudged,
            _ => CellVerdict::Same,
        }
    }
}

fn state(comparison: &StoredComparison, gate: Gate, time: &TimeGate) -> GateState {
    let settings = &comparison.header.settings;
    if !settings.gates.contains(&gate) {
        let skipped = comparison.header.skipped.iter();
        let reason =
            skipped.filter(|skip| skip.gate == gate).map(|skip| skip.reason.clone()).next();
        return GateState::Skipped(reason.unwrap_or_else(|| "not asked for".to_owned()));
    }
    let measured = match gate {
        Gate::Exact => !comparison.exact.is_empty(),
        Gate::Instructions => !comparison.instructions.is_empty(),
        Gate::Time => !comparison.pairs.is_empty() || !comparison.samples.is_empty(),
    };
    if !measured {
        let mut faults = comparison.faults.iter().filter(|fault| fault.gate == gate);
        let reason = faults.next().map(|fault| fault.reason.clone());
        return GateState::Void(reason.unwrap_or_else(|| "nothing was measured".to_owned()));
    }
    let void = || time.void(settings.alpha).or_else(|| uncontrolled(comparison, time));
    match gate {
        Gate::Time => void().map_or(GateState::Ran, GateState::Void),
        Gate::Exact | Gate::Instructions => GateState::Ran,
    }
}

/// Why nothing vouches for the pairs of the time gate, if so: it always has a control, but that was lost.
fn uncontrolled(comparison: &StoredComparison, time: &TimeGate) -> Option<String> {
    if comparison.header.settings.unpaired {
        return None;
    }
    let second = comparison.launches_of(true) > 0;
    let measurements = 1 + usize::from(second);
    let mut faults = comparison.faults.iter();
    let lost = faults.find(|fault| fault.control && !overcome(comparison, fault));
    match lost {
        Some(fault) => Some(format!("the control was lost: {}", fault.reason)),
        None if time.controls.len() < measurements => {
            Some("the control was not measured".to_owned())
        }
        None => None,
    }
}

fn status(
    comparison: &StoredComparison,
    cells: &[JudgedCell],
    configurations: &[Difference],
    gates: &[(Gate, GateState)],
    faults: &[Fault],
) -> Status {
    let settings = &comparison.header.settings;
    let any = |verdict| cells.iter().any(|cell| cell.verdict == verdict);
    let incomplete =
        !settings.unpaired && (!comparison.came_to_its_end() || any(CellVerdict::NotMeasured));
    let regression = cells.iter().any(|cell| cell.verdict.is_regression())
        || configurations.iter().any(|difference| difference.worse);
    let void = gates.iter().any(|(_, state)| matches!(state, GateState::Void(_)));
    let nothing = cells.iter().all(|cell| cell.verdict == CellVerdict::New);
    if regression {
        Status::Regression
    } else if void
        || nothing
        || incomplete
        || any(CellVerdict::Failed)
        || faults.iter().any(|fault| !fault.absent)
    {
        Status::CouldNotMeasure
    } else if cells.iter().any(|cell| cell.may_be_slower(settings.threshold)) {
        Status::Inconclusive
    } else {
        Status::NoRegression
    }
}

/// What failed was measured after all: by another launch, or when the comparison was resumed.
fn overcome(comparison: &StoredComparison, fault: &Fault) -> bool {
    let cell = |own: &CellId| fault.cell.as_ref() == Some(own);
    let side = |own| fault.side == Some(own);
    match fault.gate {
        // What concerns no cell are the checks of all stages.
        Gate::Exact if fault.cell.is_none() => Side::BOTH.into_iter().all(|own| {
            let mut lines = comparison.checks.iter();
            lines.any(|line| line.side == own)
        }),
        Gate::Exact => {
            let mut lines = comparison.exact.iter();
            lines.any(|line| cell(&line.cell) && side(line.side))
        }
        Gate::Instructions => {
            let mut lines = comparison.instructions.iter();
            lines.any(|line| cell(&line.cell) && side(line.side))
        }
        Gate::Time if fault.cell.is_none() => {
            let wanted = comparison.header.settings.launches as usize;
            let whole = |second| comparison.launches_of(second) >= wanted;
            whole(false) && (whole(true) || time::open(comparison).is_empty())
        }
        // A cell or control that failed is left out of all later launches, unless it is tried again.
        Gate::Time => {
            let mut pairs = comparison.pairs.iter();
            pairs.any(|pair| {
                cell(&pair.cell)
                    && pair.control == fault.control
                    && Some(pair.launch) > fault.launch
            })
        }
    }
}

/// Faults with each reason once: a resumed comparison may meet the same one again.
fn unique<'a>(faults: impl Iterator<Item = &'a Fault>) -> Vec<Fault> {
    let mut kept: Vec<Fault> = Vec::new();
    for fault in faults {
        let known = kept.iter().any(|other| {
            (other.gate, other.side, &other.reason) == (fault.gate, fault.side, &fault.reason)
        });
        if !known {
            kept.push(fault.clone());
        }
    }
    kept
}
