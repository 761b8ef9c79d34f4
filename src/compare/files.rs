//! Two files of records as the sides of a comparison: what they hold of the same cells.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use thiserror::Error;

use super::cells::CellId;
use super::flow::digest;
use super::store::{
    Build, Comparison, ConfigurationFigures, ExactFigures, Fault, Gate, Header, Line, SCHEMA,
    Samples, Settings, Side, Skip,
};
use crate::record::{self, Cell, Lines, Measured, Outcome, Record, RecordError, Run};

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
    build: Build,
    /// By resume key: the same pipeline, scene and parameters.
    cells: BTreeMap<String, Cell>,
    damaged: Vec<String>,
}

/// The lines that two files amount to.
pub fn lines(base: &Path, head: &Path, settings: &Settings) -> Result<Vec<Line>, FilesError> {
    let sides = [read(base)?, read(head)?];
    let common: Vec<&String> = sides[0]
        .cells
        .keys()
        .filter(|key| sides[1].cells.contains_key(*key))
        .collect();
    if common.is_empty() {
        return Err(FilesError::NothingInCommon {
            base: sides[0].cells.len(),
            head: sides[1].cells.len(),
        });
    }
    let timed = comparable(&sides[0].run, &sides[1].run);
    let mut lines = Vec::new();
    let mut cells = Vec::new();
    for key in common {
        let [base, head] = [&sides[0].cells[key], &sides[1].cells[key]];
        let configuration = format!("{}:{}", base.experiment, base.cell);
        for (side, cell) in [(Side::Base, base), (Side::Head, head)] {
            match &cell.outcome {
                Outcome::Measured(measured) => lines.extend(figures(
                    side,
                    &configuration,
                    measured,
                    timed.is_ok(),
                    &mut cells,
                )),
                Outcome::Skipped { reason } | Outcome::Failed { reason } => {
                    lines.push(Line::Fault(unmeasured(side, &configuration, reason)));
                }
            }
        }
    }
    let header = header(&sides, settings, cells, timed);
    lines.insert(0, Line::Header(Box::new(header)));
    Ok(lines)
}

fn read(path: &Path) -> Result<Read, FilesError> {
    let reading = record::read(path)?;
    let mut runs = Vec::new();
    let mut cells = BTreeMap::new();
    for record in reading.records {
        match record {
            Record::Run(run) => runs.push(*run),
            Record::Cell(cell) => {
                cells.insert(cell.resume_key(), *cell);
            }
            Record::Experiment(_) | Record::End(_) => {}
        }
    }
    let run = runs.pop().ok_or_else(|| FilesError::NoRun {
        path: path.to_owned(),
    })?;
    let told = |damage: &record::Damage| format!("{}: {damage}", path.display());
    Ok(Read {
        build: Build {
            label: path.display().to_string(),
            version: run.fathom_version.clone(),
            protocol: None,
            digest: digest(path).unwrap_or_default(),
        },
        run,
        cells,
        damaged: reading.damaged.iter().map(told).collect(),
    })
}

/// Why the times of two runs may not stand beside each other.
fn comparable(base: &Run, head: &Run) -> Result<(), String> {
    let told = |run: &Run| {
        let adapter = &run.adapter;
        format!(
            "{} ({} {})",
            adapter.name, adapter.driver, adapter.driver_info
        )
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
            base.shader_checks, head.shader_checks
        ));
    }
    Ok(())
}

/// The lines of one measured cell, whose stages become gate cells. Counters belong to a driver, like times.
fn figures(
    side: Side,
    configuration: &str,
    measured: &Measured,
    same_driver: bool,
    cells: &mut Vec<CellId>,
) -> Vec<Line> {
    let mut lines = vec![Line::Configuration(ConfigurationFigures {
        side,
        configuration: configuration.to_owned(),
        allocated_bytes: measured.allocated_bytes,
        errors: BTreeMap::new(),
        quantities: measured.quantities.clone(),
        notes: Vec::new(),
    })];
    for stage in &measured.stages {
        let cell = CellId::new(configuration, &stage.stage);
        if !cells.contains(&cell) {
            cells.push(cell.clone());
        }
        lines.push(Line::Exact(ExactFigures {
            side,
            cell: cell.clone(),
            work: stage.work,
            counters: match same_driver {
                true => stage.counters.clone(),
                false => BTreeMap::new(),
            },
        }));
        if same_driver {
            lines.push(Line::Samples(Samples {
                side,
                cell,
                ns: stage.samples_ns.clone(),
            }));
        }
    }
    lines
}

fn unmeasured(side: Side, configuration: &str, reason: &str) -> Fault {
    Fault {
        gate: Gate::Exact,
        side: Some(side),
        cell: Some(CellId::new(configuration, "frame")),
        launch: None,
        control: false,
        absent: true,
        reason: reason.to_owned(),
    }
}

fn header(
    sides: &[Read; 2],
    settings: &Settings,
    cells: Vec<CellId>,
    timed: Result<(), String>,
) -> Header {
    let [base, head] = sides;
    let skip = |gate, reason: &str| Skip {
        gate,
        reason: reason.to_owned(),
    };
    let mut skipped = vec![skip(
        Gate::Instructions,
        "files of records hold no instruction counts",
    )];
    let mut gates = vec![Gate::Exact];
    match timed {
        Ok(()) => gates.push(Gate::Time),
        Err(reason) => skipped.push(skip(Gate::Time, &reason)),
    }
    Header {
        schema: SCHEMA,
        fathom_version: env!("CARGO_PKG_VERSION").to_owned(),
        base: base.build.clone(),
        head: head.build.clone(),
        adapter: head.run.adapter.clone(),
        settings: Settings {
            gates,
            unpaired: true,
            launches: 0,
            pairs: 0,
            ..settings.clone()
        },
        cells,
        skipped,
        notes: base.damaged.iter().chain(&head.damaged).cloned().collect(),
    }
}

/// The comparison that two files amount to.
pub fn comparison(base: &Path, head: &Path, settings: &Settings) -> Result<Comparison, FilesError> {
    let lines = lines(base, head, settings)?;
    let read = Lines {
        lines,
        damaged: Vec::new(),
    };
    Comparison::from_lines(read).ok_or_else(|| FilesError::NoRun {
        path: base.to_owned(),
    })
}
