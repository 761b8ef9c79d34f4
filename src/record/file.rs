//! Records on disk, and which of them need no second measurement.

use std::collections::BTreeSet;
use std::io::Read;
use std::path::Path;

use itertools::Itertools as _;
use serde_json::Value;

use super::lines::{
    Damaged, Line, LineWriter, OtherFormat, Reading, RecordError, read_lines, read_stored, sift,
};
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

    fn is_header(&self) -> bool {
        matches!(self, Self::Run(_))
    }

    fn needs_header(&self) -> bool {
        matches!(self, Self::Cell(_) | Self::Begun(_) | Self::End(_))
    }

    /// Unless it begins as another kind of record does and holds no header's beginning.
    fn may_be_header(line: &[u8]) -> bool {
        let line = String::from_utf8_lossy(line);
        let other = OTHER_RECORDS.iter().any(|begin| line.starts_with(begin));
        !other || line.contains(HEADER)
    }

    fn is_of_header(piece: &[u8]) -> bool {
        let piece = String::from_utf8_lossy(piece);
        [HEADER, ONLY_IN_HEADERS].iter().any(|word| piece.contains(word))
    }
}

/// How a header line names itself.
const HEADER: &str = r#""record":"run""#;
/// A field that no other record has.
const ONLY_IN_HEADERS: &str = r#""submit_cost_ns":"#;
/// How lines begin that are no headers.
const OTHER_RECORDS: [&str; 5] = [
    r#"{"record":"cell""#,
    r#"{"record":"begun""#,
    r#"{"record":"experiment""#,
    r#"{"record":"end""#,
    r#"{"record":"comparison""#,
];

pub type Writer = LineWriter<Record>;

/// See [`read_lines`].
pub fn read(path: &Path) -> Result<Reading, RecordError> {
    read_lines(path)
}

/// As [`read`]; lines in another format are left out like damaged ones. A file without any sound record is an error that names
/// its damage.
pub fn read_good(path: &Path) -> Result<Reading, RecordError> {
    let read = read_stored::<Record>(path, OtherFormat::IsLeftOut)?;
    if read.records.is_empty() {
        Err(nothing_sound::<Record>(path, &read.damaged))
    } else {
        Ok(read)
    }
}

/// The same of what `source` gives of the file, a record at a time.
pub fn each_good(
    path: &Path,
    source: impl Read,
    mut take: impl FnMut(Record),
) -> Result<Damaged, RecordError> {
    let mut any = false;
    let sifted = sift(path, source, OtherFormat::IsLeftOut, |record, _| {
        any = true;
        take(record);
    })?;
    if any { Ok(sifted.damaged) } else { Err(nothing_sound::<Record>(path, &sifted.damaged)) }
}

/// Lines were read and none is sound, or none was read.
fn nothing_sound<T: Line>(path: &Path, damaged: &Damaged) -> RecordError {
    let first = damaged.first().map(ToString::to_string);
    RecordError::NothingSound {
        path: path.to_owned(),
        name: T::NAME,
        damage: first.unwrap_or_else(|| "it is empty".to_owned()),
    }
}

/// Refuses a file of which lines were read and none is sound. An empty file passes: a process that was killed early leaves one.
pub fn empty_or_sound<T: Line>(path: &Path, read: &Reading<T>) -> Result<(), RecordError> {
    if read.damaged.is_empty() || !read.records.is_empty() {
        return Ok(());
    }
    Err(nothing_sound::<T>(path, &read.damaged))
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
    let runs = records.chunk_by(|_, next| !next.is_header());
    let ended_in = runs.filter_map(|run| match run.last()? {
        Record::Begun(begun) => Some(begun.id.clone()),
        _ => None,
    });
    ended_in.duplicates().collect()
}
