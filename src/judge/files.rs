//! Comparison of two files of records: what they hold of the same cells.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use itertools::Itertools;

use crate::adapters::AdapterRelation;
use crate::changes::cells::redefinition;
use crate::store::Comparison;
use fathom_base::private;
use fathom_record as record;
use fathom_record::comparison::{
    CellId, ComparisonEnd, ConfigurationFigures, ExactFigures, Fault, Gate, Side, Skip,
};
use fathom_record::{
    Adapter, Cell, Measured, OVER_BUDGET, Outcome, Record, RecordError, RecordFile, Run,
};

/// A file of a run's records, as it was read.
pub struct RunFile {
    pub path: PathBuf,
    pub reading: RecordFile,
}

impl RunFile {
    pub fn read(path: &Path) -> Result<Self, RecordError> {
        // The user names this file itself, if only by a link.
        let target = path.canonicalize();
        let reading = record::read(target.as_deref().unwrap_or(path))?;
        Ok(Self { path: path.to_owned(), reading })
    }
}

struct LastRun<'a> {
    run: &'a Run,
    /// By settings key: the same pipeline, scene and parameters.
    cells: BTreeMap<String, &'a Cell>,
    notes: Vec<String>,
}

/// What two files hold of the same cells, as the exact gate judges it.
pub struct SameCells {
    pub comparison: Comparison,
    /// Why the times may not even stand beside each other.
    pub untimed: Option<String>,
}

impl SameCells {
    /// By these gates: where times are asked for, they are said not to be judged.
    pub fn compare([base, head]: [&RunFile; 2], gates: &[Gate]) -> anyhow::Result<Self> {
        let [base, head] = [sorted(base)?, sorted(head)?];
        let untimed = check_comparable(base.run, head.run).err();
        let mut contents = Contents { same_driver: untimed.is_none(), ..Contents::default() };
        let (mut ids, mut unknown) = (BTreeMap::new(), 0);
        for (key, cell) in &base.cells {
            let of_head = head.cells.get(key).copied();
            if let Some(of_head) = of_head.filter(|h| cell.has_same_sources(h) != Some(false)) {
                unknown += usize::from(cell.sources.is_empty() != of_head.sources.is_empty());
                contents.add(&numbered(name(cell), &mut ids), [cell, of_head]);
            }
        }
        if contents.comparison.configurations.is_empty() {
            bail!("the files have no measured cell in common: {}", why_none(&base, &head));
        }
        let mut comparison = contents.comparison;
        let header = &mut comparison.header;
        (header.adapter, header.settings.gates) = (head.run.adapter.clone(), vec![Gate::Exact]);
        header.notes = [base.notes, head.notes].concat();
        header.notes.extend((unknown > 0).then(|| {
            format!("one file does not tell what the scenes of {unknown} cells were made of: whether they are the same is not known")
        }));
        let reason = untimed.as_deref().unwrap_or("two runs share no pairs").to_owned();
        let skip = Skip { gate: Gate::Time, reason };
        header.skipped.extend(gates.contains(&skip.gate).then_some(skip));
        comparison.end = Some(ComparisonEnd { wall_s: 0.0, interrupted: false });
        Ok(Self { comparison, untimed })
    }
}

/// How many each file holds, and what differs in the first that have one name.
fn why_none(base: &LastRun<'_>, head: &LastRun<'_>) -> String {
    let [of_base, of_head] =
        [base, head].map(|of| of.cells.values().copied().filter(|c| c.measured().is_some()));
    let counts = format!(
        "{} measured in the base, {} in the head",
        of_base.clone().count(),
        of_head.clone().count()
    );
    let same_name =
        of_base.cartesian_product(of_head).find(|(base, head)| name(base) == name(head));
    same_name.map_or(counts.clone(), |(base, head)| {
        format!("{counts}; they differ, such as {} in {}", name(head), redefinition(base, head))
    })
}

fn name(cell: &Cell) -> String {
    format!("{}:{}", cell.experiment, cell.cell)
}

/// The name, with a number if it was met before: cells may differ in parameters that are no axes.
fn numbered(name: String, met: &mut BTreeMap<String, u32>) -> String {
    let count = met.entry(name.clone()).or_default();
    *count += 1;
    match *count {
        1 => name,
        n => format!("{name} ({n})"),
    }
}

fn sorted(file: &RunFile) -> anyhow::Result<LastRun<'_>> {
    let RunFile { path, reading } = file;
    let name = private::path(path);
    let mut notes: Vec<String> = reading.damaged.notice(Path::new(&name)).into_iter().collect();
    let mut last: Option<&Run> = None;
    let mut cells = BTreeMap::new();
    for record in &reading.records {
        match record {
            Record::Run(run) => {
                if let Some(Err(reason)) = last.map(|last| comparable(last, run)) {
                    cells.clear();
                    notes.push(format!("{name}: only its last run counts: {reason}"));
                }
                last = Some(run);
            }
            Record::Cell(cell) => {
                // What a kill left of a cell is no figure to compare.
                if cell.measured().is_none_or(Measured::is_finished) {
                    cells.insert(cell.settings_key(), cell.as_ref());
                }
            }
            Record::Experiment(_) | Record::Begun(_) | Record::End(_) | Record::Comparison(_) => {}
        }
    }
    let run = last.with_context(|| format!("{} holds no run", path.display()))?;
    Ok(LastRun { run, cells, notes })
}

/// Why the times of two runs may not stand beside each other. Two versions of one driver may: what that changes is of interest.
fn check_comparable(base: &Run, head: &Run) -> Result<(), String> {
    if AdapterRelation::between(&base.adapter, &head.adapter).is_judged() {
        return same_shaders(base, head);
    }
    comparable(base, head)
}

/// Why cells of two runs in one file may not be mixed.
fn comparable(base: &Run, head: &Run) -> Result<(), String> {
    let named = |adapter: &Adapter| {
        format!("{} ({} {})", adapter.title(), adapter.driver, adapter.driver_info)
    };
    let (a, b) = (named(&base.adapter), named(&head.adapter));
    if a != b || base.adapter.backend != head.adapter.backend {
        return Err(format!("times of different adapters or drivers: {a} and {b}"));
    }
    same_shaders(base, head)
}

fn same_shaders(base: &Run, head: &Run) -> Result<(), String> {
    let (a, b) = (base.shader_checks, head.shader_checks);
    if a == b { Ok(()) } else { Err(format!("shaders {a} and {b}")) }
}

/// What the cells of two files amount to.
#[derive(Default)]
struct Contents {
    /// Counters may stand beside each other: they belong to a driver, like times.
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
