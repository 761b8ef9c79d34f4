//! Two files of records as the sides of a comparison: what they hold of the same cells.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use thiserror::Error;

use super::flow::digest;
use crate::record::comparison::{
    CellId, Compared, ComparedBuild, ComparisonHeader, ConfigurationFigures, ExactFigures, Fault,
    Gate, GateSettings, Side, Skip, UnpairedSamples,
};
use crate::record::{self, Cell, Measured, Outcome, Record, RecordError, Run};

/// Cells that a note names before it breaks off.
const MOST_NAMED: usize = 5;

#[derive(Debug, Error)]
pub enum FilesError {
    #[error(transparent)]
    Lines(#[from] RecordError),
    #[error("{} holds no run", path.display())]
    NoRun { path: PathBuf },
    #[error("the files have no measured cell in common: {} of the base, {} of the head", .base, .head)]
    NothingInCommon { base: usize, head: usize },
}

/// One file.
struct Read {
    run: Run,
    build: ComparedBuild,
    /// By resume key: the same pipeline, scene and parameters.
    cells: BTreeMap<String, Cell>,
    notes: Vec<String>,
}

/// The lines that two files amount to.
pub fn lines(
    base: &Path,
    head: &Path,
    settings: &GateSettings,
) -> Result<Vec<Compared>, FilesError> {
    let sides = [read(base)?, read(head)?];
    let common: Vec<&String> =
        sides[0].cells.keys().filter(|key| sides[1].cells.contains_key(*key)).collect();
    if common.is_empty() {
        return Err(FilesError::NothingInCommon {
            base: sides[0].cells.len(),
            head: sides[1].cells.len(),
        });
    }
    let timed = comparable(&sides[0].run, &sides[1].run);
    let mut contents = Contents {
        same_driver: timed.is_ok(),
        notes: sides.iter().flat_map(|side| side.notes.clone()).collect(),
        ..Contents::default()
    };
    let mut ids = BTreeMap::new();
    for key in common {
        let cells = sides.each_ref().map(|side| &side.cells[key]);
        contents.add(&numbered(name(cells[0]), &mut ids), cells);
    }
    contents.notes.extend(only_in(Side::Base, &sides));
    contents.notes.extend(only_in(Side::Head, &sides));
    let header = header(&sides, settings, contents.cells, contents.notes, timed);
    contents.lines.insert(0, Compared::Header(Box::new(header)));
    Ok(contents.lines)
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

/// Which cells the other side's file lacks.
fn only_in(side: Side, sides: &[Read; 2]) -> Option<String> {
    let [own, other] = match side {
        Side::Base => [&sides[0], &sides[1]],
        Side::Head => [&sides[1], &sides[0]],
    };
    let cells = own.cells.iter();
    let mut names: Vec<String> = cells
        .filter(|(key, _)| !other.cells.contains_key(*key))
        .map(|(_, cell)| name(cell))
        .collect();
    let count = names.len();
    names.truncate(MOST_NAMED);
    if count > MOST_NAMED {
        names.push("…".to_owned());
    }
    (count > 0).then(|| {
        format!(
            "only in the {}, and not compared: {count} of its cells: {}",
            side,
            names.join("; ")
        )
    })
}

fn read(path: &Path) -> Result<Read, FilesError> {
    let reading = record::read(path)?;
    let told = |what: &dyn std::fmt::Display| format!("{}: {what}", path.display());
    let mut notes: Vec<String> = reading.damaged.iter().map(|damage| told(damage)).collect();
    let mut last: Option<Run> = None;
    let mut cells = BTreeMap::new();
    for record in reading.records {
        match record {
            Record::Run(run) => {
                let reason = last.as_ref().and_then(|last| comparable(last, &run).err());
                if let Some(reason) = reason {
                    cells.clear();
                    notes.push(told(&format!("only its last run counts: {reason}")));
                }
                last = Some(*run);
            }
            Record::Cell(cell) => {
                cells.insert(cell.resume_key(), *cell);
            }
            Record::Experiment(_) | Record::End(_) | Record::Comparison(_) => {}
        }
    }
    let run = last.ok_or_else(|| FilesError::NoRun { path: path.to_owned() })?;
    Ok(Read {
        build: ComparedBuild {
            label: path.display().to_string(),
            version: run.fathom_version.clone(),
            protocol: None,
            digest: digest(path).unwrap_or_default(),
        },
        run,
        cells,
        notes,
    })
}

/// Why the times of two runs may not stand beside each other.
fn comparable(base: &Run, head: &Run) -> Result<(), String> {
    let told = |run: &Run| {
        let adapter = &run.adapter;
        format!("{} ({} {})", adapter.name, adapter.driver, adapter.driver_info)
    };
    if told(base) != told(head) || base.adapter.backend != head.adapter.backend {
        return Err(format!(
            "times of different adapters or drivers: {} and {}",
            told(base),
            told(head)
        ));
    }
    if base.shader_checks != head.shader_checks {
        return Err(format!(
            "shaders {} and {}",
            base.shader_checks.name(),
            head.shader_checks.name()
        ));
    }
    Ok(())
}

/// What the cells of two files amount to.
#[derive(Default)]
struct Contents {
    /// Times and counters may stand beside each other.
    same_driver: bool,
    lines: Vec<Compared>,
    cells: Vec<CellId>,
    notes: Vec<String>,
}

impl Contents {
    /// One cell of both files, whose stages become gate cells.
    fn add(&mut self, configuration: &str, sides: [&Cell; 2]) {
        let outcomes = sides.map(|cell| &cell.outcome);
        let [base, head] = outcomes.map(measured);
        for side in [base, head].into_iter().flatten() {
            for stage in &side.stages {
                let cell = CellId::new(configuration, &stage.stage);
                if !self.cells.contains(&cell) {
                    self.cells.push(cell);
                }
            }
        }
        if let [Outcome::Skipped { reason } | Outcome::Failed { reason }, _] = outcomes
            && head.is_none()
        {
            let note = format!("{configuration}: measured on neither side: {reason}");
            return self.notes.push(note);
        }
        let of = |side| match side {
            Side::Base => (outcomes[0], head),
            Side::Head => (outcomes[1], base),
        };
        for side in Side::BOTH {
            let (own, other) = of(side);
            if let Some(own) = measured(own) {
                self.figures(side, configuration, own);
            }
            for stage in other.iter().flat_map(|other| &other.stages) {
                let cell = CellId::new(configuration, &stage.stage);
                self.lines.extend(lacking(side, cell, own));
            }
        }
    }

    /// Counters belong to a driver, like times.
    fn figures(&mut self, side: Side, configuration: &str, measured: &Measured) {
        self.lines.push(Compared::Configuration(ConfigurationFigures {
            side,
            configuration: configuration.to_owned(),
            allocated_bytes: measured.allocated_bytes,
            errors: measured.errors.iter().map(|e| (e.name.clone(), e.value)).collect(),
            judged: measured.errors.clone(),
            quantities: measured.quantities.clone(),
            notes: Vec::new(),
        }));
        for stage in &measured.stages {
            let cell = CellId::new(configuration, &stage.stage);
            let counters = self.same_driver.then(|| stage.counters.clone());
            self.lines.push(Compared::Exact(ExactFigures {
                side,
                cell: cell.clone(),
                work: stage.work,
                counters: counters.unwrap_or_default(),
            }));
            if self.same_driver {
                self.lines.push(Compared::Samples(UnpairedSamples {
                    side,
                    cell,
                    ns: stage.samples_ns.clone(),
                    resolution_ns: stage.resolution_ns(),
                }));
            }
        }
    }
}

fn measured(outcome: &Outcome) -> Option<&Measured> {
    match outcome {
        Outcome::Measured(measured) => Some(measured),
        Outcome::Skipped { .. } | Outcome::Failed { .. } => None,
    }
}

/// The fault of a side that lacks a cell which the other has. What the base skipped or never had is new in the head.
fn lacking(side: Side, cell: CellId, own: &Outcome) -> Option<Compared> {
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
    };
    let fault = Fault::new(Gate::Exact, Some(side), Some(cell), reason);
    Some(Compared::Fault(Fault { absent: side == Side::Base && !failed, ..fault }))
}

fn header(
    sides: &[Read; 2],
    settings: &GateSettings,
    cells: Vec<CellId>,
    notes: Vec<String>,
    timed: Result<(), String>,
) -> ComparisonHeader {
    let [base, head] = sides;
    let skip = |gate, reason: &str| Skip { gate, reason: reason.to_owned() };
    let mut skipped = vec![skip(Gate::Instructions, "files of records hold no instruction counts")];
    let mut gates = vec![Gate::Exact];
    match timed {
        Ok(()) => gates.push(Gate::Time),
        Err(reason) => skipped.push(skip(Gate::Time, &reason)),
    }
    ComparisonHeader {
        base: base.build.clone(),
        head: head.build.clone(),
        adapter: head.run.adapter.clone(),
        settings: GateSettings { gates, unpaired: true, launches: 0, pairs: 0, ..settings.clone() },
        cells,
        skipped,
        notes,
        ..ComparisonHeader::default()
    }
}

#[cfg(test)]
mod tests;
