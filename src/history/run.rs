//! A run as a history takes it: the figures of each cell.

use std::collections::BTreeSet;
use std::io::ErrorKind;
use std::path::Path;

use anyhow::{Context, anyhow, bail};
use indexmap::{IndexMap, IndexSet};
use sha2::{Digest, Sha256};

use fathom_base::{input, text};
use fathom_record as record;
use fathom_record::{
    Build, Cell, Clock, Damaged, Estimate, Measured, Record, RecordError, Run, ShaderChecks,
};

/// The figures of a cell share its names.
pub type Name = std::sync::Arc<str>;

/// Name of the figure that is a frame's time without per-stage timing.
pub const FRAME: &str = "frame";
/// In place of a cell: what the figures of the adapter's limits are of.
const LIMITS: &str = "limits of the adapter";
/// Unit of times in records.
pub const NANOSECONDS: &str = "ns";
/// Hexadecimal digits of a cell's configuration.
const CONFIGURATION_DIGITS: usize = 16;
/// Largest file of records that is read, bytes.
const MAX_RECORDS: u64 = 2 << 30;

/// Digits of a commit or a run that people read.
const SHORT: usize = 10;

pub(super) fn shorten(name: &str) -> String {
    text::line(name).chars().take(SHORT).collect()
}

/// What makes figures of different runs comparable, but for machine and branch.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct FigureKey {
    pub adapter: Name,
    /// Name, version and interface.
    pub driver: Name,
    /// With the shader checks where they are off.
    pub profile: Name,
    /// `EXPERIMENT CELL`.
    pub cell: Name,
    /// Digest of pipeline, scene, stand-ins and all parameters: the same cell with another parameter is another one.
    pub configuration: Name,
    /// A stage, `frame`, or the name of an error.
    pub figure: Name,
    pub unit: Name,
    /// That timed a stage; empty for other figures.
    pub clock: Name,
}

/// A run that was read and found sound.
#[derive(Clone, Debug)]
pub struct NewRun {
    /// SHA-256 of the records, hexadecimal.
    pub digest: String,
    /// RFC 3339, UTC: of the first header.
    pub started_at: String,
    pub adapter: String,
    pub driver: String,
    /// Names no commit where the records do not.
    pub build: Build,
    /// Machines of its sessions, each once; none for records that do not name it.
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
    pub host: Option<Name>,
    pub value: Estimate,
}

impl NewRun {
    /// Reads the folder of a run.
    ///
    /// # Errors
    /// Where the records cannot be read, a line is damaged, or they are a comparison's.
    pub fn read(folder: &Path, name: &str) -> anyhow::Result<NewRun> {
        let path = record::stored(&folder.join(name));
        let unread = |source| anyhow!("cannot read {}: {source}", path.display());
        let read = record::read_good(&path).map_err(|error| match &error {
            RecordError::Io { source, .. } if source.kind() == ErrorKind::NotFound => {
                anyhow!("{} holds no run: there is no {name} in it", folder.display())
            }
            _ => error.into(),
        })?;
        let first = read.records.first().and_then(Record::try_as_run_ref).cloned();
        let mut contents = RunContents::default();
        read.records.into_iter().for_each(|record| contents.take(record));
        contents.check(&path, &read.damaged)?;
        let header = first.with_context(|| {
            let path = path.display();
            format!("{path} does not begin with a run's header, so it was not stored")
        })?;
        let file = input::unpacked(&path, MAX_RECORDS);
        let of_figure = |(key, (host, value))| NewFigure { key, host, value };
        Ok(NewRun {
            digest: file.and_then(input::sha256).map_err(unread)?,
            started_at: header.started_at.clone(),
            adapter: header.adapter.title(),
            driver: driver(&header),
            build: header.build.clone().unwrap_or_default(),
            hosts: contents.hosts.into_iter().collect(),
            cells: contents.cells.len(),
            figures: contents.figures.into_iter().map(of_figure).collect(),
        })
    }
}

#[derive(Default)]
struct RunContents {
    /// The latest.
    header: Option<Run>,
    is_comparison: bool,
    builds: IndexSet<Option<Build>>,
    hosts: IndexSet<Option<String>>,
    /// Resume keys of those that were measured.
    cells: BTreeSet<String>,
    /// With the machine that measured them.
    figures: IndexMap<FigureKey, (Option<Name>, Estimate)>,
}

impl RunContents {
    fn take(&mut self, record: Record) {
        match record {
            Record::Run(run) => {
                self.builds.insert(run.build.clone());
                self.hosts.insert(run.conditions.host.clone());
                let host = run.conditions.host.as_deref().map(Name::from);
                let limits = limits(&run).into_iter();
                self.figures.extend(limits.map(|(key, value)| (key, (host.clone(), value))));
                self.header = Some(*run);
            }
            Record::Cell(cell) => {
                let finished = cell.measured().filter(|measured| measured.is_finished());
                let Some(measured) = finished else { return };
                self.cells.insert(cell.resume_key());
                if let Some(run) = &self.header {
                    let host = run.conditions.host.as_deref().map(Name::from);
                    let figures = cell_figures(run, &cell, measured).into_iter();
                    self.figures.extend(figures.map(|(key, value)| (key, (host.clone(), value))));
                }
            }
            Record::Comparison(_) => self.is_comparison = true,
            Record::Experiment(_) | Record::Begun(_) | Record::End(_) => {}
        }
    }

    /// Whether they are sound, and of one run.
    fn check(&self, path: &Path, damaged: &Damaged) -> anyhow::Result<()> {
        let path = path.display();
        if !damaged.is_empty() {
            bail!("{path} is damaged, so it was not stored: {damaged}");
        }
        if self.is_comparison {
            bail!("{path} holds a comparison, and a history stores runs only");
        }
        if self.builds.len() > 1 {
            bail!("{path} was measured by several builds: measure it again, in another folder");
        }
        Ok(())
    }
}

fn driver(run: &Run) -> String {
    let adapter = &run.adapter;
    format!("{} {}, {}", adapter.driver, adapter.driver_info, adapter.backend)
}

impl FigureKey {
    pub fn from_names(names: [Name; 8]) -> Self {
        let [adapter, driver, profile, cell, configuration, figure, unit, clock] = names;
        Self { adapter, driver, profile, cell, configuration, figure, unit, clock }
    }

    /// `CELL FIGURE`.
    pub fn name(&self) -> String {
        format!("{} {}", self.cell, self.figure)
    }

    /// A limit of the adapter, by a kernel that no commit changes.
    pub fn is_limit(&self) -> bool {
        &*self.cell == LIMITS
    }

    /// In the order of the columns that store them.
    pub fn names(&self) -> [&str; 8] {
        let Self { adapter, driver, profile, cell, configuration, figure, unit, clock } = self;
        [adapter, driver, profile, cell, configuration, figure, unit, clock].map(|name| &**name)
    }
}

/// The adapter's limits, those that bound something.
fn limits(run: &Run) -> Vec<(FigureKey, Estimate)> {
    let sound = run.ceilings.iter().filter(|ceiling| ceiling.is_sound());
    let figure = sound.map(|ceiling| {
        let key = FigureKey {
            adapter: run.adapter.title().into(),
            driver: driver(run).into(),
            profile: "".into(),
            cell: LIMITS.into(),
            configuration: "".into(),
            figure: ceiling.name().into(),
            unit: ceiling.limit.unit().into(),
            clock: "".into(),
        };
        (key, ceiling.rate)
    });
    figure.collect()
}

/// Frame, stages whose times are above the clock's resolution, and errors that are numbers.
fn cell_figures(run: &Run, cell: &Cell, measured: &Measured) -> Vec<(FigureKey, Estimate)> {
    let profile = match run.shader_checks {
        ShaderChecks::Checked => run.profile.to_string(),
        ShaderChecks::Unchecked => format!("{}, unchecked", run.profile),
    };
    let configuration = hex::encode(Sha256::digest(cell.resume_key()));
    let of_all = FigureKey {
        adapter: run.adapter.title().into(),
        driver: driver(run).into(),
        profile: profile.into(),
        cell: format!("{} {}", cell.experiment, cell.cell).trim_end().into(),
        configuration: configuration[..CONFIGURATION_DIGITS].into(),
        figure: FRAME.into(),
        unit: NANOSECONDS.into(),
        clock: "".into(),
    };
    let frame = measured.is_timed().then(|| (of_all.clone(), measured.frame.untimed));
    let mut figures: Vec<(FigureKey, Estimate)> = frame.into_iter().collect();
    let timed = measured
        .stages
        .iter()
        .filter(|stage| stage.time.n > 0 && stage.is_resolved() && stage.clock != Clock::Host);
    for stage in timed {
        let (figure, clock) = (stage.stage.as_str().into(), stage.clock.name().into());
        figures.push((FigureKey { figure, clock, ..of_all.clone() }, stage.time));
    }
    for error in measured.errors.iter().filter(|error| error.value.is_finite()) {
        let (figure, unit) = (error.name.as_str().into(), error.unit.as_str().into());
        let value = Estimate { median: error.value, interval: None, n: 1 };
        figures.push((FigureKey { figure, unit, ..of_all.clone() }, value));
    }
    figures
}
