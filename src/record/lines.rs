//! Files of records, a line of JSON each: a writer that appends, and a reader that gives every sound record that counts.
//!
//! A file may hold several versions of one cell: a run writes a cell as it stands, and again when it has more samples. The latest counts.
//! [`latest`] alone decides that, for every reader; [`Writer::compact`] takes the others out of the file when a run ends.

use std::collections::HashSet;
use std::fmt;
use std::fs::File;
use std::io::{BufReader, ErrorKind, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::rc::Rc;

use serde::Deserialize;
use serde_json::Value;

use super::{Record, SCHEMA};
use fathom_base::folder::{self, Dir};
use fathom_base::input::{LineEnd, limited, next_line};
use fathom_base::text;

/// Bytes that are read at once.
const READ_AT_ONCE: usize = 1 << 18;

/// Largest file that is read, bytes: 100,000 cells of thirteen stages with 50 samples each.
pub const MAX_FILE: u64 = 2 << 30;
/// Longest line that is read, bytes: a cell of ten stages with 40,000 samples each.
pub const MAX_LINE: usize = 8 << 20;

#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    #[error("cannot {action} {}: {source}", path.display())]
    Io { action: &'static str, path: PathBuf, source: std::io::Error },
    #[error(
        "{} line {line}: record format {found}, but this build reads format {SCHEMA}; \
         use the build that wrote it, or measure again", path.display()
    )]
    Schema { path: PathBuf, line: usize, found: u64 },
    #[error("a record that cannot be read back was not written: {0}")]
    Unreadable(serde_json::Error),
    #[error("{} holds no sound record: {damage}", path.display())]
    NothingSound { path: PathBuf, damage: String },
}

/// Appends records to a file. What one call writes is handed to the system in one piece.
#[derive(Debug)]
pub struct Writer {
    path: PathBuf,
    file: File,
}

impl Writer {
    /// Continues a file, or starts it where there is none, and gives what it held. A torn last line is cut off, unless `check`
    /// refuses what was read: then nothing is changed.
    pub fn open<E: From<RecordError>>(
        path: &Path,
        check: impl FnOnce(&RecordFile) -> Result<(), E>,
    ) -> Result<(Self, RecordFile), E> {
        let (folder, name) = folder::open_parent(path).map_err(io("open", path))?;
        let (mut read, mut torn_bytes) = (RecordFile::default(), 0);
        match folder.read(name).and_then(|file| limited(file, MAX_FILE)) {
            Err(error) if error.kind() == ErrorKind::NotFound => {}
            Err(error) => return Err(io("read", path)(error).into()),
            Ok(file) => (read, torn_bytes) = sift(path, file)?,
        }
        check(&read)?;
        let mut writer = Self::append(path, &folder, name)?;
        writer.end_last_line(torn_bytes).map_err(io("write", path))?;
        Ok((writer, read))
    }

    fn end_last_line(&mut self, torn_bytes: u64) -> std::io::Result<()> {
        let length = self.file.metadata()?.len() - torn_bytes;
        self.file.set_len(length)?;
        let mut last = *b"\n";
        if length > 0 {
            self.file.seek(SeekFrom::End(-1))?;
            self.file.read_exact(&mut last)?;
        }
        if last == *b"\n" { Ok(()) } else { self.file.write_all(b"\n") }
    }

    fn append(path: &Path, folder: &Dir, name: &Path) -> Result<Self, RecordError> {
        let file = folder.append(name).map_err(io("open", path))?;
        Ok(Self { path: path.to_owned(), file })
    }

    /// Appends one record, which is on the disk when this returns. What cannot be read back (a number that is not finite) is an
    /// error, and nothing is written.
    pub fn write(&mut self, record: &Record) -> Result<(), RecordError> {
        self.write_all(std::slice::from_ref(record))
    }

    /// Appends records, which are on the disk when this returns.
    pub fn write_all(&mut self, records: &[Record]) -> Result<(), RecordError> {
        self.append_unsynced(records)?;
        self.file.sync_data().map_err(io("write", &self.path))
    }

    /// Appends records and leaves it to the system when they go to the disk: they outlive this process, but not a loss of power.
    pub fn append_unsynced(&mut self, records: &[Record]) -> Result<(), RecordError> {
        self.file.write_all(&lines(records)?).map_err(io("write", &self.path))
    }

    /// Ends the file: only records that count stay, which this gives. They are written beside it and take its name. A file with damaged
    /// lines stays as it is.
    pub fn compact(self) -> Result<Vec<Record>, RecordError> {
        let (path, file) = (&self.path, File::open(&self.path));
        let (read, torn_bytes) = sift(path, file.map_err(io("read", path))?)?;
        if read.superseded > 0 && read.damaged.is_empty() && torn_bytes == 0 {
            let (folder, name) = folder::open_parent(path).map_err(io("open", path))?;
            let bytes = lines(&read.records)?;
            let write = |file: &mut File| file.write_all(&bytes).and_then(|()| file.sync_data());
            folder.write_with(name, write).map_err(io("write", path))?;
        }
        Ok(read.records)
    }
}

/// Records as a file has them.
fn lines(records: &[Record]) -> Result<Vec<u8>, RecordError> {
    let mut bytes = Vec::new();
    for record in records {
        let start = bytes.len();
        serde_json::to_writer(&mut bytes, record).map_err(RecordError::Unreadable)?;
        serde_json::from_slice::<Record>(&bytes[start..]).map_err(RecordError::Unreadable)?;
        bytes.push(b'\n');
    }
    Ok(bytes)
}

fn io(action: &'static str, path: &Path) -> impl FnOnce(std::io::Error) -> RecordError {
    move |source| RecordError::Io { action, path: path.to_owned(), source }
}

/// The lines of a file that could not be read: how many there are, and the first with its number and the reason.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Damaged {
    count: usize,
    first: String,
}

impl Damaged {
    pub fn count(&self) -> usize {
        self.count
    }

    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    fn add(&mut self, line: usize, reason: &str) {
        if self.count == 0 {
            self.first = format!("line {line}: {}", text::line(reason));
        }
        self.count += 1;
    }

    /// What there is to say of a file that was read.
    pub fn notice(&self, path: &Path) -> Option<String> {
        (!self.is_empty()).then(|| format!("{}, {self}: skipped", path.display()))
    }
}

impl fmt::Display for Damaged {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.count {
            0 | 1 => f.write_str(&self.first),
            count => write!(f, "{} (and {} more)", self.first, count - 1),
        }
    }
}

/// What a file held: its sound records that count, how many others of cells are no longer the latest, and how many lines are damaged.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RecordFile {
    pub records: Vec<Record>,
    pub superseded: usize,
    pub damaged: Damaged,
}

/// Reads every record that counts of a file, which may be compressed: see [`stored`]. Damaged lines, the torn last one of a crash among
/// them, are counted and left out; a line in another format is an error.
pub fn read(path: &Path) -> Result<RecordFile, RecordError> {
    let path = stored(path);
    let source = folder::unpacked(&path, MAX_FILE).map_err(io("read", &path))?;
    sift(&path, source).map(|(read, _)| read)
}

/// The records that count: the latest of each cell under the same conditions. That a cell is begun counts where its run ends with that.
fn latest(records: Vec<Record>) -> Vec<Record> {
    let mut conditions: Rc<str> = "".into();
    let with_conditions = records.into_iter().map(|record| {
        if let Record::Run(run) = &record {
            conditions = run.conditions_key().into();
        }
        (conditions.clone(), record)
    });
    let mut counting: Vec<(Rc<str>, Record)> = with_conditions.collect();
    counting.reverse();
    let (mut met, mut ends_run) = (HashSet::new(), true);
    counting.retain(|(conditions, record)| {
        let is_last = std::mem::replace(&mut ends_run, matches!(record, Record::Run(_)));
        match record {
            Record::Cell(cell) => met.insert((conditions.clone(), cell.resume_key())),
            Record::Begun(_) => is_last,
            _ => true,
        }
    });
    counting.into_iter().rev().map(|(_, record)| record).collect()
}

/// Where the lines of a file are read: from the file, or where there is none from `FILE.gz` beside it, which gzip compressed.
/// Nothing is written to such a file.
pub fn stored(path: &Path) -> PathBuf {
    let mut packed = path.as_os_str().to_owned();
    packed.push(".gz");
    let packed = PathBuf::from(packed);
    if !folder::is_there(path) && folder::is_there(&packed) { packed } else { path.to_owned() }
}

/// The records of a file, and the bytes of a torn last line.
pub(super) fn sift(path: &Path, source: impl Read) -> Result<(RecordFile, u64), RecordError> {
    let mut source = BufReader::with_capacity(READ_AT_ONCE, source);
    let (mut damaged, mut torn_bytes) = (Damaged::default(), 0);
    let (mut all, mut line) = (Vec::new(), Vec::new());
    for number in 1.. {
        let end = next_line(&mut source, MAX_LINE, &mut line).map_err(io("read", path))?;
        let Some(end) = end else { break };
        if line.iter().all(u8::is_ascii_whitespace) {
            continue;
        }
        match parse(&line, end) {
            Err(found) => {
                return Err(RecordError::Schema { path: path.to_owned(), line: number, found });
            }
            Ok(Err(reason)) if end == LineEnd::File => {
                damaged.add(number, &format!("torn off while it was written ({reason})"));
                torn_bytes = line.len() as u64;
                break;
            }
            Ok(Err(reason)) => damaged.add(number, &reason),
            // A copy has no room for more samples, which was made while they were read.
            Ok(Ok(record)) => all.push(record.clone()),
        }
    }
    let count = all.len();
    let records = latest(all);
    Ok((RecordFile { superseded: count - records.len(), records, damaged }, torn_bytes))
}

/// A record, or why its line is damaged; the error is the format that it says it has where that is another.
fn parse(line: &[u8], end: LineEnd) -> Result<Result<Record, String>, u64> {
    if end == LineEnd::TooLong {
        return Ok(Err(format!("longer than {} MiB", MAX_LINE >> 20)));
    }
    let stated = serde_json::from_slice::<StatedFormat>(line).ok();
    let found = stated.and_then(|stated| stated.schema?.as_u64());
    if let Some(found) = found.filter(|found| *found != u64::from(SCHEMA)) {
        return Err(found);
    }
    Ok(match serde_json::from_slice::<Record>(line) {
        Ok(record) => record.check().map(|()| record),
        Err(error) if error.is_data() => Err(format!("not a record: {}", text::fault(error))),
        Err(error) => Err(format!("not JSON: {}", text::fault(error))),
    })
}

/// The format that a line says it has, if it says so.
#[derive(Deserialize)]
struct StatedFormat {
    #[serde(default)]
    schema: Option<Value>,
}
