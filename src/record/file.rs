//! Records on disk, and what a resumed run takes from them.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use itertools::Itertools as _;
use serde_json::Value;
use sha2::{Digest, Sha256};

use super::lines::{Damaged, RecordError, RecordFile, read};
use super::{Begun, Cell, Measured, NoteKind, Outcome, Record, Run};
use fathom_base::text;

/// Bytes of the digest that names a cell.
const ID_BYTES: usize = 12;

impl Record {
    /// What no sound record holds, beyond what its types say: an experiment's id names files of the report.
    pub(super) fn check(&self) -> Result<(), String> {
        let id = match self {
            Record::Experiment(definition) => &definition.id,
            Record::Cell(cell) => &cell.experiment,
            Record::Run(_) | Record::Begun(_) | Record::End(_) | Record::Comparison(_) => {
                return Ok(());
            }
        };
        text::check_id(id).map_err(|fault| format!("experiment {fault}"))
    }
}

/// As [`read`]. A file without any sound record is an error that names its damage.
pub fn read_good(path: &Path) -> Result<RecordFile, RecordError> {
    let read = read(path)?;
    if read.records.is_empty() { Err(nothing_sound(path, read.damaged)) } else { Ok(read) }
}

/// Lines were read and none is sound, or none was read.
fn nothing_sound(path: &Path, damaged: Damaged) -> RecordError {
    let damage = if damaged.is_empty() { "it is empty".to_owned() } else { damaged.to_string() };
    RecordError::NothingSound { path: path.to_owned(), damage }
}

/// Refuses a file of which lines were read and none is sound. An empty file passes: a process that was killed early leaves one.
pub fn empty_or_sound(path: &Path, read: &RecordFile) -> Result<(), RecordError> {
    if read.damaged.is_empty() || !read.records.is_empty() {
        return Ok(());
    }
    Err(nothing_sound(path, read.damaged.clone()))
}

/// Of tables; those in lists stay as they are.
fn sort_keys(value: &mut Value) {
    if let Value::Object(map) = value {
        map.sort_keys();
        map.values_mut().for_each(sort_keys);
    }
}

impl Cell {
    /// Identity of a cell for `--resume`: one with another scene, stand-in, parameter, mesh or volume is another cell.
    pub fn resume_key(&self) -> String {
        if self.sources.is_empty() {
            return self.key(&self.scene);
        }
        self.settings_key() + &serde_json::json!(self.sources).to_string()
    }

    /// What a cell asks for, whatever the files that it names held.
    pub fn settings_key(&self) -> String {
        self.key(self.scene_name())
    }

    /// Of a scene's path the last part: the rest depends on where the command ran.
    pub fn scene_name(&self) -> &str {
        Path::new(&self.scene).file_name().and_then(|name| name.to_str()).unwrap_or(&self.scene)
    }

    /// None of the files of both differs; unknown where the records of one do not tell.
    pub fn has_same_sources(&self, other: &Self) -> Option<bool> {
        let is_same = |(name, digest)| other.sources.get(name).is_none_or(|other| other == digest);
        let is_known = !self.sources.is_empty() && !other.sources.is_empty();
        is_known.then(|| self.sources.iter().all(is_same))
    }

    fn key(&self, scene: &str) -> String {
        let Self { experiment, cell, pipeline, stand_ins, params, .. } = self;
        let mut params = Value::Object(params.to_map());
        sort_keys(&mut params);
        serde_json::json!([experiment, cell, pipeline, scene, stand_ins, params]).to_string()
    }
}

impl Measured {
    /// Its figures were read: what a run writes of a cell that it still samples, and a kill leaves, may lack them.
    pub fn is_finished(&self) -> bool {
        self.notes.iter().all(|note| note.kind != NoteKind::Unfinished)
    }
}

/// Cells by what became of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct OutcomeCounts {
    pub measured: usize,
    pub skipped: usize,
    pub failed: usize,
    /// Not run or not finished, as the time budget ended or the run was interrupted.
    pub over_budget: usize,
}

impl OutcomeCounts {
    pub fn count<'a>(cells: impl IntoIterator<Item = &'a Cell>) -> Self {
        let mut counts = Self::default();
        for cell in cells {
            *match &cell.outcome {
                Outcome::Measured(measured) if measured.is_finished() => &mut counts.measured,
                Outcome::Skipped { .. } => &mut counts.skipped,
                Outcome::Failed { .. } => &mut counts.failed,
                Outcome::Measured(_) | Outcome::OverBudget => &mut counts.over_budget,
            } += 1;
        }
        counts
    }
}

/// What earlier runs left of a cell.
#[derive(Clone, Copy, Debug)]
pub struct Earlier<'a> {
    pub cell: &'a Cell,
    /// By the same build, on the same machine, by the same clocks: its samples and those of the resumed run go together.
    pub is_continued: bool,
}

impl Earlier<'_> {
    /// The cell needs no second measurement.
    pub fn is_finished(&self) -> bool {
        self.cell.measured().is_none_or(Measured::is_finished)
    }
}

/// By resume key the cells that were measured or skipped before under the conditions of `run`: the same adapter, profile and shader checks.
/// Failed cells are tried again, and those that were not run are measured.
pub fn earlier<'a>(records: &'a [Record], run: &Run) -> BTreeMap<String, Earlier<'a>> {
    let (mut header, mut found) = (None, BTreeMap::new());
    for record in records {
        match record {
            Record::Run(of) => header = Some(of).filter(|of| of.has_same_conditions(run)),
            Record::Cell(cell)
                if matches!(cell.outcome, Outcome::Measured(_) | Outcome::Skipped { .. }) =>
            {
                let Some(of) = header else { continue };
                let is_continued = of.is_compatible(run) && of.clocks == run.clocks;
                found.insert(cell.resume_key(), Earlier { cell, is_continued });
            }
            _ => {}
        }
    }
    found
}

impl Run {
    /// What a cell's figures rest on: those of different ones do not stand for each other.
    pub(super) fn conditions_key(&self) -> String {
        serde_json::json!([self.adapter, self.profile, self.shader_checks]).to_string()
    }

    fn has_same_conditions(&self, other: &Run) -> bool {
        self.conditions_key() == other.conditions_key()
    }

    /// Samples of both, by the same clocks, go together: they are of one build, machine and driver.
    pub fn is_compatible(&self, other: &Run) -> bool {
        let build = |run: &Run| (run.fathom_version.clone(), run.build.clone());
        self.has_same_conditions(other)
            && build(self) == build(other)
            && self.conditions.host == other.conditions.host
    }
}

impl Begun {
    /// The cell under a run's conditions: the same build, machine, adapter, profile and shader checks.
    pub fn new(run: &Run, cell: &Cell) -> Self {
        let Run { fathom_version, adapter, profile, shader_checks, .. } = run;
        let (host, key) = (&run.conditions.host, cell.resume_key());
        let conditions =
            serde_json::json!([fathom_version, host, adapter, profile, shader_checks, key]);
        let id = hex::encode(&Sha256::digest(conditions.to_string())[..ID_BYTES]);
        Self { id, experiment: cell.experiment.clone(), cell: cell.cell.clone() }
    }
}

/// Ids of the cells in which more than one process ended: their runs end with a [`Begun`] line.
pub fn crashed_cells(records: &[Record]) -> BTreeSet<String> {
    let runs = records.chunk_by(|_, next| !matches!(next, Record::Run(_)));
    let ended_in = runs.filter_map(|run| match run.last()? {
        Record::Begun(begun) => Some(begun.id.clone()),
        _ => None,
    });
    ended_in.duplicates().collect()
}
