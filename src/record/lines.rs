//! Files of JSON lines: a writer that leaves the file whole after every line, and a reader that gives back
//! everything that is sound and says what is not.

use std::fs::{File, OpenOptions};
use std::io::{Read, Seek, SeekFrom, Write};
use std::marker::PhantomData;
use std::path::{Path, PathBuf};

use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

use crate::input;

/// Largest file that is read, bytes: 100,000 cells of ten stages with 30 samples each.
pub const MAX_FILE: u64 = 512 << 20;
/// Longest line that is read, bytes: a cell of ten stages with 40,000 samples each.
const MAX_LINE: usize = 8 << 20;

/// What a file of lines holds.
pub trait Line: Serialize + DeserializeOwned {
    /// Version of the format. A line with a `schema` field states it.
    const SCHEMA: u32;
    /// Names a line in messages, such as `record`.
    const NAME: &'static str;

    /// What no sound line holds, beyond what its types say.
    fn check(&self) -> Result<(), String> {
        Ok(())
    }
}

#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    #[error("cannot {action} {}: {source}", path.display())]
    Io {
        action: &'static str,
        path: PathBuf,
        source: std::io::Error,
    },
    #[error(
        "{} line {line}: {name} format {found}, but this build reads format {reads}; \
         use the build that wrote it, or measure again", path.display()
    )]
    Schema {
        path: PathBuf,
        line: usize,
        name: &'static str,
        found: u64,
        reads: u32,
    },
    #[error("a {name} that cannot be read back was not written: {source}")]
    Unreadable {
        name: &'static str,
        source: serde_json::Error,
    },
}

/// Appends lines to a file. What one call writes is handed to the system in one piece and synced before it
/// returns; what fails half-way (a full disk) is taken back.
#[derive(Debug)]
pub struct LineWriter<T> {
    path: PathBuf,
    file: File,
    /// Bytes of whole lines in the file.
    length: u64,
    line: PhantomData<T>,
}

impl<T: Line> LineWriter<T> {
    /// Starts an empty file, replacing one of that name.
    pub fn create(path: &Path) -> Result<Self, RecordError> {
        let file = File::create(path).map_err(io("create", path))?;
        Ok(Self {
            path: path.to_owned(),
            file,
            length: 0,
            line: PhantomData,
        })
    }

    /// Continues a file, or starts it where there is none. A last line that was torn by a crash is cut off.
    pub fn append(path: &Path) -> Result<Self, RecordError> {
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
        let unterminated = !tail.is_empty() && serde_json::from_slice::<T>(tail).is_ok();
        if unterminated {
            length = bytes.len();
        }
        file.set_len(length as u64).map_err(io("shorten", path))?;
        file.seek(SeekFrom::End(0)).map_err(io("read", path))?;
        let mut writer = Self {
            path: path.to_owned(),
            file,
            length: length as u64,
            line: PhantomData,
        };
        if unterminated {
            writer.put(b"\n")?;
        }
        Ok(writer)
    }

    /// Appends one line. What cannot be read back (a number that is not finite) is an error, and nothing is written.
    pub fn write(&mut self, line: &T) -> Result<(), RecordError> {
        self.write_all(std::slice::from_ref(line))
    }

    /// Appends lines, all or none.
    pub fn write_all(&mut self, lines: &[T]) -> Result<(), RecordError> {
        let mut bytes = Vec::new();
        for line in lines {
            bytes.extend(encode(line).map_err(|source| RecordError::Unreadable {
                name: T::NAME,
                source,
            })?);
        }
        self.put(&bytes)
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

fn encode<T: Line>(line: &T) -> Result<Vec<u8>, serde_json::Error> {
    let mut bytes = serde_json::to_vec(line)?;
    serde_json::from_slice::<T>(&bytes)?;
    bytes.push(b'\n');
    Ok(bytes)
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
#[error("line {line}: {}", input::one_line(.reason))]
pub struct Damage {
    pub line: usize,
    pub reason: String,
}

/// What a file held.
#[derive(Clone, Debug, PartialEq)]
pub struct Lines<T> {
    pub lines: Vec<T>,
    pub damaged: Vec<Damage>,
}

impl<T> Default for Lines<T> {
    fn default() -> Self {
        Self {
            lines: Vec::new(),
            damaged: Vec::new(),
        }
    }
}

/// Reads every sound line of a file. Damaged lines, the torn last one of a crash among them, are listed
/// and left out; a line in another format is an error.
pub fn read_lines<T: Line>(path: &Path) -> Result<Lines<T>, RecordError> {
    let bytes = input::bytes(path, MAX_FILE).map_err(io("read", path))?;
    let mut reading = Lines::default();
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
            Parsed::Line(line) => reading.lines.push(line),
            Parsed::OtherSchema(found) => {
                return Err(RecordError::Schema {
                    path: path.to_owned(),
                    line: number,
                    name: T::NAME,
                    found,
                    reads: T::SCHEMA,
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

enum Parsed<T> {
    Line(T),
    OtherSchema(u64),
    Damaged(String),
}

fn parse<T: Line>(line: &[u8]) -> Parsed<T> {
    if line.len() > MAX_LINE {
        return Parsed::Damaged(format!("longer than {} MiB", MAX_LINE >> 20));
    }
    let value: Value = match serde_json::from_slice(line) {
        Ok(value) => value,
        Err(error) => return Parsed::Damaged(format!("not JSON: {error}")),
    };
    let schema = value.get("schema").and_then(Value::as_u64);
    if let Some(found) = schema.filter(|found| *found != u64::from(T::SCHEMA)) {
        return Parsed::OtherSchema(found);
    }
    match serde_json::from_value::<T>(value) {
        Ok(line) => match line.check() {
            Ok(()) => Parsed::Line(line),
            Err(fault) => Parsed::Damaged(fault),
        },
        Err(error) => Parsed::Damaged(format!("not a {}: {error}", T::NAME)),
    }
}
