//! Records on disk: a writer that leaves the file whole after every line, and a reader that gives back
//! everything that is sound and says what is not.

use std::collections::BTreeSet;
use std::fs::{File, OpenOptions};
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use serde_json::Value;

use super::{Cell, Outcome, Record, Run, SCHEMA};

#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    #[error("cannot {action} {}: {source}", path.display())]
    Io {
        action: &'static str,
        path: PathBuf,
        source: std::io::Error,
    },
    #[error(
        "{} line {line}: record format {found}, but this build reads format {SCHEMA}; \
         use the build that wrote it, or measure again", path.display()
    )]
    Schema {
        path: PathBuf,
        line: usize,
        found: u64,
    },
    #[error("a record that cannot be read back was not written: {0}")]
    Unreadable(serde_json::Error),
}

/// Appends records to a file. Each is handed to the system in one piece and synced before
/// [`Writer::write`] returns; one that fails half-way (a full disk) is taken back.
#[derive(Debug)]
pub struct Writer {
    path: PathBuf,
    file: File,
    /// Bytes of whole lines in the file.
    length: u64,
}

impl Writer {
    /// Starts an empty file, replacing one of that name.
    pub fn create(path: &Path) -> Result<Writer, RecordError> {
        let file = File::create(path).map_err(io("create", path))?;
        Ok(Writer {
            path: path.to_owned(),
            file,
            length: 0,
        })
    }

    /// Continues a file, or starts it where there is none. A last line that was torn by a crash is cut off.
    pub fn append(path: &Path) -> Result<Writer, RecordError> {
        let mut file = OpenOptions::new()
            .read(true)
            .write(true)
            .create(true)
            .truncate(false)
            .open(path)
            .map_err(io("open", path))?;
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes).map_err(io("read", path))?;
        let whole = bytes.iter().rposition(|byte| *byte == b'\n');
        let mut length = whole.map_or(0, |at| at + 1);
        let tail = &bytes[length..];
        let unterminated = !tail.is_empty() && serde_json::from_slice::<Record>(tail).is_ok();
        if unterminated {
            length = bytes.len();
        }
        file.set_len(length as u64).map_err(io("shorten", path))?;
        file.seek(SeekFrom::End(0)).map_err(io("read", path))?;
        let mut writer = Writer {
            path: path.to_owned(),
            file,
            length: length as u64,
        };
        if unterminated {
            writer.put(b"\n")?;
        }
        Ok(writer)
    }

    /// Appends one record. What cannot be read back (a number that is not finite) is an error, and nothing is written.
    pub fn write(&mut self, record: &Record) -> Result<(), RecordError> {
        let mut line = serde_json::to_vec(record).map_err(RecordError::Unreadable)?;
        serde_json::from_slice::<Record>(&line).map_err(RecordError::Unreadable)?;
        line.push(b'\n');
        self.put(&line)
    }

    fn put(&mut self, bytes: &[u8]) -> Result<(), RecordError> {
        let written = self
            .file
            .write_all(bytes)
            .and_then(|()| self.file.sync_data());
        if let Err(source) = written {
            // The first error is the one to report; if shortening fails too, the reader skips the torn line.
            let _ = self.file.set_len(self.length);
            let _ = self.file.seek(SeekFrom::Start(self.length));
            return Err(io("write", &self.path)(source));
        }
        self.length += bytes.len() as u64;
        Ok(())
    }
}

fn io(action: &'static str, path: &Path) -> impl FnOnce(std::io::Error) -> RecordError {
    move |source| RecordError::Io {
        action,
        path: path.to_owned(),
        source,
    }
}

/// A line that could not be read, numbered from 1.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("line {line}: {reason}")]
pub struct Damage {
    pub line: usize,
    pub reason: String,
}

/// What a file held.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Reading {
    pub records: Vec<Record>,
    pub damaged: Vec<Damage>,
}

/// Reads every sound line of a file. Damaged lines, the torn last one of a crash among them, are listed
/// and left out; a run in another record format is an error.
pub fn read(path: &Path) -> Result<Reading, RecordError> {
    let bytes = std::fs::read(path).map_err(io("read", path))?;
    let mut reading = Reading::default();
    let torn_line = match bytes.last() {
        None | Some(b'\n') => None,
        Some(_) => Some(bytes.split(|byte| *byte == b'\n').count()),
    };
    for (index, line) in bytes.split(|byte| *byte == b'\n').enumerate() {
        let number = index + 1;
        if line.iter().all(u8::is_ascii_whitespace) {
            continue;
        }
        match parse(line) {
            Parsed::Record(record) => reading.records.push(*record),
            Parsed::OtherSchema(found) => {
                return Err(RecordError::Schema {
                    path: path.to_owned(),
                    line: number,
                    found,
                });
            }
            Parsed::Damaged(reason) => {
                let torn = torn_line == Some(number);
                let reason = if torn {
                    format!("torn off while it was written ({reason})")
                } else {
                    reason
                };
                reading.damaged.push(Damage {
                    line: number,
                    reason,
                });
            }
        }
    }
    Ok(reading)
}

enum Parsed {
    Record(Box<Record>),
    OtherSchema(u64),
    Damaged(String),
}

fn parse(line: &[u8]) -> Parsed {
    let value: Value = match serde_json::from_slice(line) {
        Ok(value) => value,
        Err(error) => return Parsed::Damaged(format!("not JSON: {error}")),
    };
    let schema = value.get("schema").and_then(Value::as_u64);
    if let Some(found) = schema.filter(|found| *found != u64::from(SCHEMA)) {
        return Parsed::OtherSchema(found);
    }
    match serde_json::from_value(value) {
        Ok(record) => Parsed::Record(Box::new(record)),
        Err(error) => Parsed::Damaged(format!("not a record: {error}")),
    }
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
    let sorted = sort_keys(params);
    serde_json::json!([experiment, cell, pipeline, scene, stand_ins, sorted]).to_string()
}

fn sort_keys(value: &Value) -> Value {
    match value {
        Value::Object(map) => {
            let mut entries: Vec<_> = map.iter().collect();
            entries.sort_by_key(|(name, _)| *name);
            let sorted = entries
                .into_iter()
                .map(|(name, inner)| (name.clone(), sort_keys(inner)));
            Value::Object(sorted.collect())
        }
        other => other.clone(),
    }
}

impl Cell {
    /// See [`resume_key`].
    pub fn resume_key(&self) -> String {
        resume_key(
            &self.experiment,
            &self.cell,
            &self.pipeline,
            &self.scene,
            &self.stand_ins,
            &self.params,
        )
    }
}

/// Resume keys of the cells that need no second measurement: those measured or skipped under the
/// conditions of `run` (same adapter, profile and shader checks). Failed cells are tried again.
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
                if same_conditions && !matches!(cell.outcome, Outcome::Failed { .. }) =>
            {
                keys.insert(cell.resume_key());
            }
            _ => {}
        }
    }
    keys
}
