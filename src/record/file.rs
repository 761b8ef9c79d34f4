//! Records on disk, and which of them need no second measurement.

use std::collections::BTreeSet;
use std::io::Read;
use std::path::Path;

use itertools::Itertools as _;
use serde_json::Value;

use super::lines::{Damaged, Line, LineWriter, Reading, RecordError, read_lines, sift};
use super::{Cell, Outcome, Record, Run, SCHEMA};
use fathom_base::text;

impl Line for Record {
    const SCHEMA: u32 = SCHEMA;
    const NAME: &'static str = "record";

    /// An experiment's id names files of the report.
    fn check(&self) -> Result<(), String> {
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

pub type Writer = LineWriter<Record>;

/// See [`read_lines`].
pub fn read(path: &Path) -> Result<Reading, RecordError> {
    read_lines(path)
}

/// As [`read`]. A file without any sound record is an error that names its damage.
pub fn read_good(path: &Path) -> Result<Reading, RecordError> {
    let read = read(path)?;
    if read.records.is_empty() { Err(nothing_sound(path, read.damaged)) } else { Ok(read) }
}

/// The same of what `source` gives of the file, a record at a time.
pub fn each_good(
    path: &Path,
    source: impl Read,
    mut take: impl FnMut(Record),
) -> Result<Damaged, RecordError> {
    let mut any = false;
    let (damaged, _) = sift(path, source, |record| {
        any = true;
        take(record);
    })?;
    if any { Ok(damaged) } else { Err(nothing_sound(path, damaged)) }
}

/// Lines were read and none is sound, or none was read.
fn nothing_sound(path: &Path, damaged: Damaged) -> RecordError {
    let damage = if damaged.is_empty() { "it is empty".to_owned() } else { damaged.to_string() };
    RecordError::NothingSound { path: path.to_owned(), name: Record::NAME, damage }
}

/// Refuses a file of which lines were read and none is sound. An empty file passes: a process that was killed early leaves one.
pub fn empty_or_sound(path: &Path, read: &Reading) -> Result<(), RecordError> {
    if read.damaged.is_empty() || !read.records.is_empty() {
        return Ok(());
    }
    Err(nothing_sound(path, read.damaged.clone()))
}

/// Identity of a cell for `--resume`: a cell with another scene, stand-in or parameter is another cell.
pub fn resume_key(
    experiment: &str,
    cell: &str,
    pipeline: &str,
    scene: &str,
    stand_ins: &[String],
    params: &Value,
) -> String {
    let mut sorted = params.clone();
    sort_keys(&mut sorted);
    serde_json::json!([experiment, cell, pipeline, scene, stand_ins, sorted]).to_string()
}

/// Of tables; those in lists stay as they are.
fn sort_keys(value: &mut Value) {
    if let Value::Object(map) = value {
        map.sort_keys();
        map.values_mut().for_each(sort_keys);
    }
}

impl Cell {
    /// See [`resume_key`].
    pub fn resume_key(&self) -> String {
        let Self { experiment, cell, pipeline, scene, stand_ins, params, .. } = self;
        let params = Value::Object(params.to_map());
        resume_key(experiment, cell, pipeline, scene, stand_ins, &params)
    }
}

/// Resume keys of the cells that need no second measurement: those measured or skipped under the
/// conditions of `run` (same adapter, profile and shader checks). Failed cells are tried again, and those that were not run are
/// measured.
pub fn finished(records: &[Record], run: &Run) -> BTreeSet<String> {
    let mut same_conditions = false;
    let mut keys = BTreeSet::new();
    for record in records {
        match record {
            Record::Run(earlier) => {
                same_conditions = earlier.adapter == run.adapter
                    && earlier.profile == run.profile
                    && earlier.shader_checks == run.shader_checks;
            }
            Record::Cell(cell)
                if same_conditions
                    && matches!(cell.outcome, Outcome::Measured(_) | Outcome::Skipped { .. }) =>
            {
                keys.insert(cell.resume_key());
            }
            _ => {}
        }
    }
    keys
}

/// Ids of the cells in which more than one process ended: their runs end with a [`Begun`](super::Begun) line.
pub fn deadly(records: &[Record]) -> BTreeSet<String> {
    let runs = records.chunk_by(|_, next| !matches!(next, Record::Run(_)));
    let ended_in = runs.filter_map(|run| match run.last()? {
        Record::Begun(begun) => Some(begun.id.clone()),
        _ => None,
    });
    ended_in.duplicates().collect()
}
