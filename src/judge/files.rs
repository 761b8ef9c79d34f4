//! Comparison of the records of two runs: which cells both have, and the exact figures of these.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use itertools::Itertools;

use crate::adapters::AdapterRelation;
use crate::matched_cells::{MatchedCells, RunCells, redefinition};
use crate::store::Comparison;
use fathom_base::private;
use fathom_record as record;
use fathom_record::comparison::{
    CellId, ComparisonEnd, ConfigurationFigures, ExactFigures, Fault, Gate, Side, Skip,
};
use fathom_record::output::RECORDS;
use fathom_record::protocol::with_driver;
use fathom_record::{Cell, Measured, OVER_BUDGET, Outcome, Record, RecordError, RecordFile, Run};

/// The file of a run's records, as it was read.
pub struct RunFile {
    pub path: PathBuf,
    pub reading: RecordFile,
}

impl RunFile {
    /// Of a file or of the folder that holds it.
    pub fn read(path: &Path) -> Result<Self, RecordError> {
        // The user names this file or folder itself, if only by a link.
        let target = path.canonicalize().unwrap_or_else(|_| path.to_owned());
        let file = |path: &Path| if target.is_dir() { path.join(RECORDS) } else { path.to_owned() };
        Ok(Self { path: file(path), reading: record::read(&file(&target))? })
    }
}

struct LastRun<'a> {
    run: &'a Run,
    cells: RunCells<'a>,
    notes: Vec<String>,
}

/// What two runs have of the same cells, as the exact gate judges it.
pub struct SameCells<'a> {
    pub comparison: Comparison,
    pub cells: MatchedCells<'a>,
    /// Why the times of the two runs must not be compared.
    pub untimed: Option<String>,
}

impl<'a> SameCells<'a> {
    /// By these gates: where times are asked for, they are said not to be judged.
    pub fn compare([base, head]: [&'a RunFile; 2], gates: &[Gate]) -> anyhow::Result<Self> {
        let [base, head] = [last_run(base)?, last_run(head)?];
        // Two versions of one driver are compared: what a new version changes is of interest.
        let untimed = check_comparable(base.run, head.run, AdapterRelation::is_judged).err();
        let cells = MatchedCells::match_runs(base.cells.clone(), head.cells.clone());
        let mut contents = Contents { same_driver: untimed.is_none(), ..Contents::default() };
        cells.pairs.iter().for_each(|pair| contents.add(&name(pair[0]), *pair));
        if contents.comparison.configurations.is_empty() {
            bail!("the files have no measured cell in common: {}", why_none(&base, &head, &cells));
        }
        let mut comparison = contents.comparison;
        let header = &mut comparison.header;
        (header.adapter, header.settings.gates) = (head.run.adapter.clone(), vec![Gate::Exact]);
        header.notes = [base.notes, head.notes].concat();
        let is_unknown =
            |[base, head]: &&[&Cell; 2]| base.sources.is_empty() != head.sources.is_empty();
        let unknown = cells.pairs.iter().filter(is_unknown).count();
        header.notes.extend((unknown > 0).then(|| {
            format!("one file does not tell what the scenes of {unknown} cells were made of: whether they are the same is not known")
        }));
        let reason = untimed.as_deref().unwrap_or("two runs share no pairs").to_owned();
        let skip = Skip { gate: Gate::Time, reason };
        header.skipped.extend(gates.contains(&skip.gate).then_some(skip));
        comparison.end = Some(ComparisonEnd { wall_s: 0.0, interrupted: false });
        Ok(Self { comparison, cells, untimed })
    }
}

/// How many cells each file measured, and what differs in one that both have under one name.
fn why_none(base: &LastRun<'_>, head: &LastRun<'_>, cells: &MatchedCells<'_>) -> String {
    let measured = |of: &LastRun<'_>| of.cells.values().filter(|c| c.measured().is_some()).count();
    let counts = format!("{} measured in the base, {} in the head", measured(base), measured(head));
    let is_measured = |cells: &&[&Cell; 2]| cells.iter().all(|cell| cell.measured().is_some());
    let same_name = cells.redefined.iter().find(is_measured);
    same_name.map_or(counts.clone(), |cells| {
        format!("{counts}; they differ, such as {} in {}", name(cells[0]), redefinition(*cells))
    })
}

fn name(cell: &Cell) -> String {
    format!("{}:{}", cell.experiment, cell.cell)
}

/// The run of a file, and its cells: of several runs the last, with what goes together with it.
fn last_run(file: &RunFile) -> anyhow::Result<LastRun<'_>> {
    let RunFile { path, reading } = file;
    let name = private::path(path);
    let mut notes: Vec<String> = reading.damaged.notice(Path::new(&name)).into_iter().collect();
    let mut last: Option<&Run> = None;
    let mut cells = RunCells::new();
    for record in &reading.records {
        match record {
            Record::Run(run) => {
                let is_same = |relation| relation == AdapterRelation::Same;
                if let Some(Err(reason)) = last.map(|last| check_comparable(last, run, is_same)) {
                    cells.clear();
                    notes.push(format!("{name}: only its last run counts: {reason}"));
                }
                last = Some(run);
            }
            Record::Cell(cell) => {
                // What a kill left of a cell is no figure to compare.
                if cell.measured().is_none_or(Measured::is_finished) {
                    cells.insert((&cell.experiment, &cell.cell), cell.as_ref());
                }
            }
            Record::Experiment(_) | Record::Begun(_) | Record::End(_) | Record::Comparison(_) => {}
        }
    }
    let run = last.with_context(|| format!("{} holds no run", path.display()))?;
    Ok(LastRun { run, cells, notes })
}

/// Why the figures of two runs must not be compared whose adapters `is_comparable` judges.
fn check_comparable(
    base: &Run,
    head: &Run,
    is_comparable: impl Fn(AdapterRelation) -> bool,
) -> Result<(), String> {
    if !is_comparable(AdapterRelation::between(&base.adapter, &head.adapter)) {
        let adapters = [base, head].map(|run| with_driver(&run.adapter));
        return Err(format!("times of different adapters or drivers: {}", adapters.join(" and ")));
    }
    let (a, b) = (base.shader_checks, head.shader_checks);
    if a == b { Ok(()) } else { Err(format!("shaders {a} and {b}")) }
}

/// The exact figures of the cells that both files have.
#[derive(Default)]
struct Contents {
    /// Counters are comparable only within one driver, as times are.
    same_driver: bool,
    comparison: Comparison,
}

impl Contents {
    /// One cell of both files, whose stages become gate cells.
    fn add(&mut self, configuration: &str, [base, head]: [&Cell; 2]) {
        let cells_of = |side: &Cell| -> Vec<CellId> {
            let stages = side.measured().into_iter().flat_map(|measured| &measured.stages);
            stages.map(|stage| CellId::new(configuration, &stage.stage)).collect()
        };
        let all = cells_of(base).into_iter().chain(cells_of(head)).unique();
        self.comparison.header.cells.extend(all);
        for (side, own, other) in [(Side::Base, base, head), (Side::Head, head, base)] {
            if let Some(own) = own.measured() {
                self.figures(side, configuration, own);
            }
            let lacking = |cell| lacking(side, cell, &own.outcome);
            self.comparison.faults.extend(cells_of(other).into_iter().filter_map(lacking));
        }
    }

    fn figures(&mut self, side: Side, configuration: &str, measured: &Measured) {
        self.comparison.configurations.push(ConfigurationFigures {
            side,
            configuration: configuration.to_owned(),
            allocated_bytes: measured.allocated_bytes,
            errors: measured.errors.iter().map(|e| (e.name.to_string(), e.value)).collect(),
            judged: measured.errors.clone(),
            quantities: measured.quantities.clone(),
            notes: Vec::new(),
        });
        self.comparison.exact.extend(measured.stages.iter().map(|stage| {
            let counters = self.same_driver.then(|| stage.counters.clone());
            ExactFigures {
                side,
                cell: CellId::new(configuration, &stage.stage),
                work: stage.work,
                counters: counters.unwrap_or_default(),
            }
        }));
    }
}

/// The fault of a side that lacks a cell which the other has. What the base skipped or never had is new in the head.
fn lacking(side: Side, cell: CellId, own: &Outcome) -> Option<Fault> {
    let (reason, failed) = match own {
        Outcome::Measured(measured) => {
            let mut stages = measured.stages.iter();
            if stages.any(|stage| stage.stage == cell.stage()) {
                return None;
            }
            ("it has no such stage", false)
        }
        Outcome::Skipped { reason } => (reason.as_str(), false),
        Outcome::Failed { reason } => (reason.as_str(), true),
        Outcome::OverBudget => (OVER_BUDGET, false),
    };
    let fault = Fault::new(Gate::Exact, Some(side), Some(cell), reason);
    Some(Fault { absent: side == Side::Base && !failed, ..fault })
}

#[cfg(test)]
mod tests;
