//! Files of JSON lines: a writer that only ever appends, and a reader that gives back every sound line and counts the others.

use std::fmt;
use std::fs::File;
use std::io::{BufReader, ErrorKind, Read, Seek, SeekFrom, Write};
use std::marker::PhantomData;
use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::Record;
use fathom_base::folder::{self, Folder};
use fathom_base::input::{LineEnd, limited, next_line};
use fathom_base::text;

/// Bytes that are read at once.
const READ_AT_ONCE: usize = 1 << 18;

/// Largest file that is read, bytes: 100,000 cells of thirteen stages with 50 samples each.
pub const MAX_FILE: u64 = 2 << 30;
/// Longest line that is read, bytes: a cell of ten stages with 40,000 samples each.
pub const MAX_LINE: usize = 8 << 20;

/// What a file of lines holds.
pub trait Line: Clone + Serialize + DeserializeOwned {
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
    Io { action: &'static str, path: PathBuf, source: std::io::Error },
    #[error(
        "{} line {line}: {name} format {found}, but this build reads format {reads}; \
         use the build that wrote it, or measure again", path.display()
    )]
    Schema { path: PathBuf, line: usize, name: &'static str, found: u64, reads: u32 },
    #[error("a {name} that cannot be read back was not written: {source}")]
    Unreadable { name: &'static str, source: serde_json::Error },
    #[error("{} holds no sound {name}: {damage}", path.display())]
    NothingSound { path: PathBuf, name: &'static str, damage: String },
}

/// Appends lines to a file. What one call writes is handed to the system in one piece.
#[derive(Debug)]
pub struct LineWriter<T> {
    path: PathBuf,
    file: File,
    line: PhantomData<T>,
}

impl<T: Line> LineWriter<T> {
    /// Starts an empty file, replacing one of that name.
    pub fn create(path: &Path) -> Result<Self, RecordError> {
        folder::write(path, b"").map_err(io("create", path))?;
        let (folder, name) = folder::of(path).map_err(io("open", path))?;
        Self::append(path, &folder, name)
    }

    /// Continues a file, or starts it where there is none, and gives what it held. A torn last line is cut off, unless `check`
    /// refuses what was read: then nothing is changed.
    pub fn open<E: From<RecordError>>(
        path: &Path,
        check: impl FnOnce(&Reading<T>) -> Result<(), E>,
    ) -> Result<(Self, Reading<T>), E> {
        let (folder, name) = folder::of(path).map_err(io("open", path))?;
        let (mut read, mut torn_bytes) = (Reading::default(), 0);
        match folder.read(name).and_then(|file| limited(file, MAX_FILE)) {
            Err(error) if error.kind() == ErrorKind::NotFound => {}
            Err(error) => return Err(io("read", path)(error).into()),
            Ok(file) => {
                (read.damaged, torn_bytes) = sift(path, file, |line| read.records.push(line))?;
            }
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

    fn append(path: &Path, folder: &Folder, name: &Path) -> Result<Self, RecordError> {
        let file = folder.append(name).map_err(io("open", path))?;
        Ok(Self { path: path.to_owned(), file, line: PhantomData })
    }

    /// Appends one line, which is on the disk when this returns. What cannot be read back (a number that is not finite) is an
    /// error, and nothing is written.
    pub fn write(&mut self, line: &T) -> Result<(), RecordError> {
        self.write_all(std::slice::from_ref(line))
    }

    /// Appends lines, which are on the disk when this returns.
    pub fn write_all(&mut self, lines: &[T]) -> Result<(), RecordError> {
        self.hand_over(lines)?;
        self.sync()
    }

    /// Appends lines and leaves it to the system when they go to the disk: they outlive this process, but not a loss of power.
    pub fn hand_over(&mut self, lines: &[T]) -> Result<(), RecordError> {
        let unreadable = |source| RecordError::Unreadable { name: T::NAME, source };
        let mut bytes = Vec::new();
        for line in lines {
            let start = bytes.len();
            serde_json::to_writer(&mut bytes, line).map_err(unreadable)?;
            serde_json::from_slice::<T>(&bytes[start..]).map_err(unreadable)?;
            bytes.push(b'\n');
        }
        self.put(&bytes)
    }

    /// Waits until all lines are on the disk.
    pub fn sync(&self) -> Result<(), RecordError> {
        self.file.sync_data().map_err(io("write", &self.path))
    }

    fn put(&mut self, bytes: &[u8]) -> Result<(), RecordError> {
        self.file.write_all(bytes).map_err(io("write", &self.path))
    }
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

/// What a file held: its sound lines, and how many of the others there are.
#[derive(Clone, Debug, PartialEq)]
pub struct Reading<T = Record> {
    pub records: Vec<T>,
    pub damaged: Damaged,
}

impl<T> Default for Reading<T> {
    fn default() -> Self {
        Self { records: Vec::new(), damaged: Damaged::default() }
    }
}

/// Reads every sound line of a file, which may be compressed: see [`stored`]. Damaged lines, the torn last one of a crash among them,
/// are counted and left out; a line in another format is an error.
pub fn read_lines<T: Line>(path: &Path) -> Result<Reading<T>, RecordError> {
    let path = stored(path);
    let source = folder::unpacked(&path, MAX_FILE).map_err(io("read", &path))?;
    let mut records = Vec::new();
    let (damaged, _) = sift(&path, source, |line: T| records.push(line))?;
    Ok(Reading { records, damaged })
}

/// Where the lines of a file are read: from the file, or where there is none from `FILE.gz` beside it, which gzip compressed.
/// Nothing is written to such a file.
pub fn stored(path: &Path) -> PathBuf {
    let mut packed = path.as_os_str().to_owned();
    packed.push(".gz");
    let packed = PathBuf::from(packed);
    if !folder::is_there(path) && folder::is_there(&packed) { packed } else { path.to_owned() }
}

/// Hands over each sound line, one at a time. Gives the damaged ones, and the bytes of a torn last line.
pub(super) fn sift<T: Line>(
    path: &Path,
    source: impl Read,
    mut take: impl FnMut(T),
) -> Result<(Damaged, u64), RecordError> {
    let mut source = BufReader::with_capacity(READ_AT_ONCE, source);
    let (mut damaged, mut line) = (Damaged::default(), Vec::new());
    for number in 1.. {
        let end = next_line(&mut source, MAX_LINE, &mut line).map_err(io("read", path))?;
        let Some(end) = end else { break };
        if line.iter().all(u8::is_ascii_whitespace) {
            continue;
        }
        match parse::<T>(&line, end) {
            Err(found) => {
                let (path, name, reads) = (path.to_owned(), T::NAME, T::SCHEMA);
                return Err(RecordError::Schema { path, line: number, name, found, reads });
            }
            Ok(Err(reason)) if end == LineEnd::File => {
                damaged.add(number, &format!("torn off while it was written ({reason})"));
                return Ok((damaged, line.len() as u64));
            }
            Ok(Err(reason)) => damaged.add(number, &reason),
            // A copy has no room for more samples, which was made while they were read.
            Ok(Ok(parsed)) => take(parsed.clone()),
        }
    }
    Ok((damaged, 0))
}

/// A line, or why it is damaged; the error is the format that it says it has where that is another.
fn parse<T: Line>(line: &[u8], end: LineEnd) -> Result<Result<T, String>, u64> {
    if end == LineEnd::TooLong {
        return Ok(Err(format!("longer than {} MiB", MAX_LINE >> 20)));
    }
    let stated = serde_json::from_slice::<Stated>(line).ok();
    let found = stated.and_then(|stated| stated.schema?.as_u64());
    if let Some(found) = found.filter(|found| *found != u64::from(T::SCHEMA)) {
        return Err(found);
    }
    Ok(match serde_json::from_slice::<T>(line) {
        Ok(line) => line.check().map(|()| line),
        Err(error) if error.is_data() => Err(format!("not a {}: {error}", T::NAME)),
        Err(error) => Err(format!("not JSON: {error}")),
    })
}

/// The format that a line says it has, if it says so.
#[derive(Deserialize)]
struct Stated {
    #[serde(default)]
    schema: Option<Value>,
}
