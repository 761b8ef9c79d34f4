//! Files of JSON lines: a writer that only ever appends, and a reader that gives back everything that is sound and says what
//! is not.

use std::fs::File;
use std::io::{BufReader, ErrorKind, Read, Seek, SeekFrom, Write};
use std::marker::PhantomData;
use std::ops::{Deref, Range};
use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::Record;
use fathom_base::folder::{self, Folder};
use fathom_base::input::{LineEnd, Lines};
use fathom_base::text;

/// Damaged lines that are told one by one.
const MOST_TOLD: usize = 20;
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

    /// It says under which conditions the lines after it were measured, up to the next such line.
    fn is_header(&self) -> bool {
        false
    }

    /// It means nothing without its header.
    fn needs_header(&self) -> bool {
        false
    }

    /// A line that cannot be read may have been a header.
    fn may_be_header(_line: &[u8]) -> bool {
        false
    }

    /// A piece of a line is one of a header.
    fn is_of_header(_piece: &[u8]) -> bool {
        false
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
    #[error(
        "{} was removed or replaced while it was written to; what it held is in {}: move that back and continue with --resume",
        path.display(), rescued.display()
    )]
    Removed { path: PathBuf, rescued: PathBuf },
}

/// Appends lines to a file. What one call writes is handed to the system in one piece; what fails half-way (a full disk) is
/// taken back.
#[derive(Debug)]
pub struct LineWriter<T> {
    path: PathBuf,
    folder: Folder,
    file: File,
    line: PhantomData<T>,
}

/// A file that was opened to be continued.
#[derive(Debug)]
pub struct Opened<T> {
    pub writer: LineWriter<T>,
    /// What it held.
    pub read: Reading<T>,
    /// Where the file is kept as it was, if it was damaged. The file itself has its sound lines only.
    pub aside: Option<PathBuf>,
}

impl<T: Line> Opened<T> {
    /// What there is to say of the damage, a line each.
    pub fn notices(&self) -> Vec<String> {
        let path = &self.writer.path;
        let mut notices = self.read.damaged.notices(path);
        let kept = |aside: &PathBuf| {
            format!("{} is kept as it was in {}", path.display(), aside.display())
        };
        notices.extend(self.aside.iter().map(kept));
        notices
    }
}

impl<T: Line> LineWriter<T> {
    /// Starts an empty file, replacing one of that name.
    pub fn create(path: &Path) -> Result<Self, RecordError> {
        folder::write(path, b"").map_err(io("create", path))?;
        Self::append(path)
    }

    /// Continues a file, or starts it where there is none. A damaged file is kept aside as it was, and continued with its
    /// sound lines, unless `check` refuses what was read: then nothing is changed.
    pub fn open<E: From<RecordError>>(
        path: &Path,
        check: impl FnOnce(&Reading<T>) -> Result<(), E>,
    ) -> Result<Opened<T>, E> {
        let (mut read, mut sound, mut unterminated) = (Reading::default(), Vec::new(), false);
        match folder::of(path).and_then(|(folder, name)| folder.plain(name, MAX_FILE)) {
            Err(error) if error.kind() == ErrorKind::NotFound => {}
            Err(error) => return Err(io("read", path)(error).into()),
            Ok(file) => {
                let take = |line, place| {
                    read.records.push(line);
                    sound.push(place);
                };
                let sifted = sift(path, file, OtherFormat::IsAnError, take)?;
                (read.damaged, unterminated) = (sifted.damaged, sifted.unterminated);
            }
        }
        check(&read)?;
        let is_damaged = !read.damaged.is_empty();
        let aside = if is_damaged { Some(keep_aside(path, &sound)?) } else { None };
        let mut writer = Self::append(path)?;
        if aside.is_none() && unterminated {
            writer.put(b"\n")?;
        }
        Ok(Opened { writer, read, aside })
    }

    fn append(path: &Path) -> Result<Self, RecordError> {
        let (folder, name) = folder::of(path).map_err(io("open", path))?;
        let file = folder.append(name).map_err(io("open", path))?;
        Ok(Self { path: path.to_owned(), folder, file, line: PhantomData })
    }

    /// Appends one line, which is on the disk when this returns. What cannot be read back (a number that is not finite) is an
    /// error, and nothing is written.
    pub fn write(&mut self, line: &T) -> Result<(), RecordError> {
        self.write_all(std::slice::from_ref(line))
    }

    /// Appends lines, all or none, which are on the disk when this returns.
    pub fn write_all(&mut self, lines: &[T]) -> Result<(), RecordError> {
        self.hand_over(lines)?;
        self.sync()
    }

    /// Appends lines, all or none, and leaves it to the system when they go to the disk: they outlive this process, but not a
    /// loss of power.
    pub fn hand_over(&mut self, lines: &[T]) -> Result<(), RecordError> {
        let unreadable = |source| RecordError::Unreadable { name: T::NAME, source };
        let mut bytes = Vec::new();
        for line in lines {
            bytes.extend(encode(line).map_err(unreadable)?);
        }
        self.put(&bytes)
    }

    /// Waits until all lines are on the disk.
    pub fn sync(&self) -> Result<(), RecordError> {
        self.file.sync_data().map_err(io("write", &self.path))
    }

    fn put(&mut self, bytes: &[u8]) -> Result<(), RecordError> {
        let before = self.file.metadata().map_err(io("read", &self.path))?.len();
        if let Err(source) = self.file.write_all(bytes) {
            // The first error is the one to report; if shortening fails too, the reader names the torn line.
            let _ = self.file.set_len(before);
            return Err(io("write", &self.path)(source));
        }
        if self.folder.has(name(&self.path), &self.file) { Ok(()) } else { Err(self.rescue()) }
    }

    /// Writes all lines to a file beside the one that is gone.
    fn rescue(&mut self) -> RecordError {
        let mut bytes = Vec::new();
        let read =
            self.file.seek(SeekFrom::Start(0)).and_then(|_| self.file.read_to_end(&mut bytes));
        let rescued = read
            .map_err(io("read", &self.path))
            .and_then(|_| keep_beside(&self.folder, &self.path, "rescued", &bytes));
        match rescued {
            Ok(rescued) => RecordError::Removed { path: self.path.clone(), rescued },
            Err(error) => error,
        }
    }
}

/// Keeps a file as it is beside it, and leaves what lies in these places of it, each as a line.
fn keep_aside(path: &Path, sound: &[Range<usize>]) -> Result<PathBuf, RecordError> {
    let (folder, name) = folder::of(path).map_err(io("write", path))?;
    let bytes = folder.bytes(name, MAX_FILE).map_err(io("read", path))?;
    let aside = keep_beside(&folder, path, "damaged", &bytes)?;
    let lines = sound.iter().filter_map(|place| bytes.get(place.clone()));
    let lines: Vec<u8> = lines.flat_map(|line| [line, b"\n"]).flatten().copied().collect();
    let written = folder.write_with(name, |file| {
        file.write_all(&lines)?;
        file.sync_all()
    });
    written.map_err(io("write", path))?;
    Ok(aside)
}

/// Writes bytes to the first free file `STEM.WORD-N.EXTENSION` beside a file, and gives its path.
fn keep_beside(
    folder: &Folder,
    path: &Path,
    word: &str,
    bytes: &[u8],
) -> Result<PathBuf, RecordError> {
    for number in 1.. {
        let beside = beside(path, word, number);
        match folder.create_new(name(&beside)) {
            Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
            Err(source) => return Err(io("create", &beside)(source)),
            Ok(mut file) => {
                let written = file.write_all(bytes).and_then(|()| file.sync_all());
                return written.map(|()| beside.clone()).map_err(io("write", &beside));
            }
        }
    }
    unreachable!("numbers do not end")
}

fn name(path: &Path) -> &Path {
    Path::new(path.file_name().unwrap_or_default())
}

fn beside(path: &Path, word: &str, number: u32) -> PathBuf {
    let part =
        |part: Option<&std::ffi::OsStr>| part.unwrap_or_default().to_string_lossy().into_owned();
    let (stem, extension) = (part(path.file_stem()), part(path.extension()));
    path.with_file_name(format!("{stem}.{word}-{number}.{extension}"))
}

/// Damaged states of a file that were kept beside it.
pub fn kept_aside(path: &Path) -> Vec<PathBuf> {
    (1..)
        .map(|number| beside(path, "damaged", number))
        .take_while(|beside| folder::is_there(beside))
        .collect()
}

fn encode<T: Line>(line: &T) -> Result<Vec<u8>, serde_json::Error> {
    let mut bytes = serde_json::to_vec(line)?;
    serde_json::from_slice::<T>(&bytes)?;
    bytes.push(b'\n');
    Ok(bytes)
}

fn io(action: &'static str, path: &Path) -> impl FnOnce(std::io::Error) -> RecordError {
    move |source| RecordError::Io { action, path: path.to_owned(), source }
}

/// A line that could not be read, numbered from 1.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("line {line}: {}", text::line(.reason))]
pub struct Damage {
    pub line: usize,
    pub reason: String,
}

/// The damaged lines of a file: the first ones, and how many there are.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Damaged {
    first: Vec<Damage>,
    count: usize,
}

impl Damaged {
    pub fn count(&self) -> usize {
        self.count
    }

    fn push(&mut self, line: usize, reason: String) {
        if self.first.len() < MOST_TOLD {
            self.first.push(Damage { line, reason });
        }
        self.count += 1;
    }

    /// `say` of each of the first, and how many more there are.
    pub fn told(&self, say: impl FnMut(&Damage) -> String) -> Vec<String> {
        let more = self.count - self.first.len();
        let more = (more > 0).then(|| format!("{more} more lines are unreadable"));
        self.first.iter().map(say).chain(more).collect()
    }

    /// What there is to say of a file that was read, a line each.
    pub fn notices(&self, path: &Path) -> Vec<String> {
        let path = path.display();
        let told = self.told(|damage| format!("{damage}: skipped"));
        told.into_iter().map(|told| format!("{path}, {told}")).collect()
    }
}

/// The first ones.
impl Deref for Damaged {
    type Target = [Damage];

    fn deref(&self) -> &[Damage] {
        &self.first
    }
}

/// What a file held: its sound lines, and which of the others were damaged.
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

/// Reads every sound line of a file, which may be compressed: see [`stored`]. Damaged lines, the torn last one of a crash
/// among them, are listed and left out; a line in another format is an error.
pub fn read_lines<T: Line>(path: &Path) -> Result<Reading<T>, RecordError> {
    read_stored(path, OtherFormat::IsAnError)
}

/// The same, with lines in another format, and those that belong to a header in another format, treated like `other` says.
pub(super) fn read_stored<T: Line>(
    path: &Path,
    other: OtherFormat,
) -> Result<Reading<T>, RecordError> {
    let path = stored(path);
    let source = folder::unpacked(&path, MAX_FILE).map_err(io("read", &path))?;
    let mut records = Vec::new();
    let found = sift(&path, source, other, |line: T, _| records.push(line))?;
    Ok(Reading { records, damaged: found.damaged })
}

/// What becomes of a line that says it is in another format than this build reads.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum OtherFormat {
    IsAnError,
    /// Like damaged ones.
    IsLeftOut,
}

/// Where the lines of a file are read: from the file, or where there is none from `FILE.gz` beside it, which gzip compressed.
/// Nothing is written to such a file.
pub fn stored(path: &Path) -> PathBuf {
    let mut packed = path.as_os_str().to_owned();
    packed.push(".gz");
    let packed = PathBuf::from(packed);
    if !folder::is_there(path) && folder::is_there(&packed) { packed } else { path.to_owned() }
}

/// What a source held beside its sound lines.
#[derive(Default)]
pub(super) struct Sifted {
    pub(super) damaged: Damaged,
    /// The last line has no end.
    unterminated: bool,
}

/// Hands over each sound line with its place in the source. One line is in memory at a time.
pub(super) fn sift<T: Line>(
    path: &Path,
    source: impl Read,
    other: OtherFormat,
    mut take: impl FnMut(T, Range<usize>),
) -> Result<Sifted, RecordError> {
    let mut lines = Lines::new(BufReader::with_capacity(READ_AT_ONCE, source), MAX_LINE);
    let (mut sifted, mut headers) = (Sifted::default(), Headers::default());
    loop {
        let begin = lines.bytes as usize;
        let Some(end) = lines.advance().map_err(io("read", path))? else { return Ok(sifted) };
        sifted.unterminated = end == LineEnd::File;
        let number = lines.number;
        let (zeros, line) = lines.line.split_at(after_zeros(&lines.line));
        if !zeros.is_empty() {
            let reason = headers.met_zeros::<T>(number, zeros);
            sifted.damaged.push(number, reason);
        }
        if line.iter().all(u8::is_ascii_whitespace) {
            continue;
        }
        let reason = match parse::<T>(line, end) {
            Err(found) if other == OtherFormat::IsAnError => {
                let (path, name, reads) = (path.to_owned(), T::NAME, T::SCHEMA);
                return Err(RecordError::Schema { path, line: number, name, found, reads });
            }
            Err(found) => {
                headers.lost = Some(number);
                format!("{} format {found}, but this build reads format {}", T::NAME, T::SCHEMA)
            }
            Ok(Ok(parsed)) => match headers.orphaned(&parsed) {
                None => {
                    let start = begin + zeros.len();
                    // A copy has no room for more samples, which was made while they were read.
                    take(parsed.clone(), start..start + line.len());
                    continue;
                }
                Some(lost) => {
                    format!("it belongs to a run whose header, line {lost}, could not be read")
                }
            },
            // The rest of a line whose beginning is zeros was told with them.
            Ok(Err(_)) if !zeros.is_empty() => {
                headers.met_rest::<T>(number, line);
                continue;
            }
            Ok(Err(reason)) => {
                headers.damaged::<T>(number, line);
                reason
            }
        };
        sifted.damaged.push(number, reason);
    }
}

/// Where a line goes on after its last zero byte. No line is written with one: a file system puts blocks of zeros where a
/// crash lost what was written.
fn after_zeros(line: &[u8]) -> usize {
    line.iter().rposition(|byte| *byte == 0).map_or(0, |last| last + 1)
}

/// Which header the lines of a file belong to, as far as that is known.
#[derive(Default)]
struct Headers {
    /// A header was read.
    met: bool,
    /// The line that cannot be read and may have been a header, if no header was read since.
    lost: Option<usize>,
}

impl Headers {
    fn damaged<T: Line>(&mut self, number: usize, line: &[u8]) {
        // Before the first header there is none that lines could be taken for.
        if self.met && T::may_be_header(line) {
            self.lost = Some(number);
        }
    }

    /// Nothing tells what zeros lie over, so what follows is taken to go on with the run before them, unless a piece of a header
    /// is left at their ends. Gives what to say of them.
    fn met_zeros<T: Line>(&mut self, number: usize, piece: &[u8]) -> String {
        self.met_rest::<T>(number, piece);
        let zeros = piece.iter().filter(|byte| **byte == 0).count();
        format!(
            "{zeros} zero bytes lie over what was written; what follows counts to the run before them"
        )
    }

    fn met_rest<T: Line>(&mut self, number: usize, piece: &[u8]) {
        if self.met && T::is_of_header(piece) {
            self.lost = Some(number);
        }
    }

    /// The lost header of a line that needs one.
    fn orphaned<T: Line>(&mut self, line: &T) -> Option<usize> {
        if line.is_header() {
            *self = Self { met: true, lost: None };
        }
        self.lost.filter(|_| line.needs_header())
    }
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
    let torn = |reason: String| match end {
        LineEnd::File => format!("torn off while it was written ({reason})"),
        LineEnd::Newline | LineEnd::TooLong => reason,
    };
    Ok(match serde_json::from_slice::<T>(line) {
        Ok(line) => line.check().map(|()| line).map_err(torn),
        Err(error) if error.is_data() => Err(torn(format!("not a {}: {error}", T::NAME))),
        Err(error) => Err(torn(format!("not JSON: {error}"))),
    })
}

/// The format that a line says it has, if it says so.
#[derive(Deserialize)]
struct Stated {
    #[serde(default)]
    schema: Option<Value>,
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn a_full_disk_is_an_error_that_names_the_file() {
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join("records.jsonl");
        let mut writer = LineWriter::<Record>::create(&path).unwrap();
        // The device on which there is never room.
        writer.file = File::options().write(true).open("/dev/full").unwrap();
        let end = Record::Comparison(super::super::Compared::Header(Box::default()));
        let error = writer.write(&end).unwrap_err().to_string();
        assert!(error.starts_with(&format!("cannot write {}", path.display())), "{error}");
    }
}
