//! A run as a history takes it: the bytes of its records, and the figures of each cell.

use std::io::{ErrorKind, Read};
use std::path::{Path, PathBuf};

use indexmap::IndexMap;
use itertools::Itertools;
use sha2::{Digest, Sha256};

use super::HistoryError;
use crate::folder;
use crate::record::{self, Cell, Clock, Estimate, Measured, Reading, Record, Run, ShaderChecks};

/// Name of the figure that is a frame's time without per-stage timing.
pub const FRAME: &str = "frame";
/// Unit of times in records.
pub const NANOSECONDS: &str = "ns";
/// Hexadecimal digits of a cell's configuration.
const CONFIGURATION_DIGITS: usize = 16;
/// Largest file of records that a history takes, bytes: a row of SQLite holds at most 1 GB.
const MAX_RECORDS: u64 = 900 << 20;

/// What makes figures of different runs comparable, but for machine and branch.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct FigureKey {
    pub adapter: String,
    /// Name, version and interface.
    pub driver: String,
    /// With the shader checks where they are off.
    pub profile: String,
    /// `EXPERIMENT CELL`.
    pub cell: String,
    /// Digest of pipeline, scene, stand-ins and all parameters: the same cell with another parameter is another one.
    pub configuration: String,
    /// A stage, `frame`, or the name of an error.
    pub figure: String,
    pub unit: String,
    /// That timed a stage; empty for other figures.
    pub clock: String,
}

/// A run that was read and found sound.
#[derive(Clone, Debug)]
pub struct NewRun {
    /// SHA-256 of the records, hexadecimal.
    pub digest: String,
    /// The lines of its records as they lie in the folder.
    pub records: Vec<u8>,
    /// RFC 3339, UTC: of the first header.
    pub started_at: String,
    pub adapter: String,
    pub driver: String,
    /// Machines of its sittings, each once; none for records that do not name it.
    pub hosts: Vec<Option<String>>,
    /// Measured cells.
    pub cells: usize,
    /// Each once. Of a cell that was measured again, the latest.
    pub figures: Vec<NewFigure>,
}

#[derive(Clone, Debug)]
pub struct NewFigure {
    pub key: FigureKey,
    /// The machine that measured it, where the records name it.
    pub host: Option<String>,
    pub value: Estimate,
}

impl NewRun {
    /// Reads the folder of a run.
    ///
    /// # Errors
    /// Where the records cannot be read, a line is damaged, or they are a comparison's.
    pub fn read(folder: &Path, name: &str) -> Result<NewRun, HistoryError> {
        let path = record::stored(&folder.join(name));
        let mut records = Vec::new();
        let read =
            folder::unpacked(&path, MAX_RECORDS).and_then(|mut f| f.read_to_end(&mut records));
        read.map_err(|source| match source.kind() {
            ErrorKind::NotFound => {
                HistoryError::NoRun { folder: folder.to_owned(), name: name.to_owned() }
            }
            _ => HistoryError::Read { path: path.clone(), source },
        })?;
        let reading = record::read_good(&path)?;
        let header = check(&path, &reading)?;
        let figures = figures(&reading.records);
        let measured =
            |record: &&Record| matches!(record, Record::Cell(cell) if cell.measured().is_some());
        Ok(NewRun {
            digest: hex::encode(Sha256::digest(&records)),
            started_at: header.started_at.clone(),
            adapter: header.adapter.name.clone(),
            driver: driver(header),
            hosts: hosts(&reading.records),
            cells: reading.records.iter().filter(measured).count(),
            figures,
            records,
        })
    }
}

/// The first header of sound records of a run.
fn check<'a>(path: &Path, reading: &'a Reading) -> Result<&'a Run, HistoryError> {
    let path = || -> PathBuf { path.to_owned() };
    if let Some(damage) = reading.damaged.first() {
        let (count, first) = (reading.damaged.len(), damage.clone());
        return Err(HistoryError::Damaged { path: path(), first, count });
    }
    if reading.records.iter().any(|record| matches!(record, Record::Comparison(_))) {
        return Err(HistoryError::Comparison { path: path() });
    }
    match reading.records.first() {
        Some(Record::Run(run)) => Ok(run),
        _ => Err(HistoryError::NoHeader { path: path() }),
    }
}

fn driver(run: &Run) -> String {
    let adapter = &run.adapter;
    format!("{} {}, {}", adapter.driver, adapter.driver_info, adapter.backend)
}

fn hosts(records: &[Record]) -> Vec<Option<String>> {
    let host = |record: &Record| match record {
        Record::Run(run) => Some(run.conditions.host.clone()),
        _ => None,
    };
    records.iter().filter_map(host).unique().collect()
}

fn figures(records: &[Record]) -> Vec<NewFigure> {
    let mut found = IndexMap::new();
    let mut header: Option<&Run> = None;
    for record in records {
        match record {
            Record::Run(run) => header = Some(run),
            Record::Cell(cell) => {
                let (Some(run), Some(measured)) = (header, cell.measured()) else { continue };
                let figures = of_cell(run, cell, measured);
                let host = &run.conditions.host;
                let of_host = |(key, value)| (key, (host.clone(), value));
                found.extend(figures.into_iter().map(of_host));
            }
            Record::Experiment(_) | Record::End(_) | Record::Comparison(_) => {}
        }
    }
    found.into_iter().map(|(key, (host, value))| NewFigure { key, host, value }).collect()
}

/// Frame, stages whose times are above the clock's resolution, and errors that are numbers.
fn of_cell(run: &Run, cell: &Cell, measured: &Measured) -> Vec<(FigureKey, Estimate)> {
    let profile = match run.shader_checks {
        ShaderChecks::Checked => run.profile.name().to_owned(),
        ShaderChecks::Unchecked => format!("{}, unchecked", run.profile.name()),
    };
    let configuration = hex::encode(Sha256::digest(cell.resume_key()));
    let key = |figure: &str, unit: &str, clock: Option<Clock>| FigureKey {
        adapter: run.adapter.name.clone(),
        driver: driver(run),
        profile: profile.clone(),
        cell: format!("{} {}", cell.experiment, cell.cell).trim_end().to_owned(),
        configuration: configuration[..CONFIGURATION_DIGITS].to_owned(),
        figure: figure.to_owned(),
        unit: unit.to_owned(),
        clock: clock.map_or_else(String::new, |clock| clock.name().to_owned()),
    };
    let frame =
        measured.is_timed().then(|| (key(FRAME, NANOSECONDS, None), measured.frame.untimed));
    let stages = measured
        .stages
        .iter()
        .filter(|stage| stage.time.n > 0 && stage.is_resolved() && stage.clock != Clock::Host);
    let stages = stages.map(|s| (key(&s.stage, NANOSECONDS, Some(s.clock)), s.time));
    let errors = measured.errors.iter().filter(|error| error.value.is_finite()).map(|error| {
        let value = Estimate { median: error.value, interval: None, n: 1 };
        (key(&error.name, &error.unit, None), value)
    });
    frame.into_iter().chain(stages).chain(errors).collect()
}
