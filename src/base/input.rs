//! Files that a user names, read with a limit: a folder, pipe or device is refused before it is opened, and a file that is too
//! large or endless ends in an error that names the limit.

use std::fs::{self, File, Metadata, OpenOptions};
use std::io::{self, BufRead, BufReader, ErrorKind, Read, Take};
use std::path::Path;

use flate2::bufread::MultiGzDecoder;
use sha2::{Digest, Sha256};

/// Largest file that people write by hand (scene, experiment, gates), bytes: sixty times the longest of this project.
pub const MAX_TEXT: u64 = 1 << 20;

/// Bytes of a file that are summed up in one step.
const READ_AT_ONCE: usize = 1 << 20;
/// First bytes of what gzip compressed. RFC 1952, 2.3.1.
const GZIP: [u8; 2] = [0x1f, 0x8b];

/// Opens a regular file to read it. Anything else is an error: reading a pipe or a device may wait for ever.
pub fn open(path: &Path) -> io::Result<File> {
    // Asked before it is opened, because opening a device can act on it, and again of what was opened.
    regular(&fs::metadata(path)?)?;
    // Opening does not wait for the other end of a pipe.
    let mut options = OpenOptions::new();
    options.read(true);
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::custom_flags(&mut options, libc::O_NONBLOCK);
    let file = options.open(path)?;
    regular(&file.metadata()?)?;
    Ok(file)
}

fn regular(metadata: &Metadata) -> io::Result<()> {
    if metadata.is_file() {
        return Ok(());
    }
    let what = if metadata.is_dir() { "a folder" } else { "a pipe or a device" };
    let message = format!("it is {what}, and only regular files are read");
    Err(io::Error::new(ErrorKind::InvalidInput, message))
}

/// A source that fails where it gives more than its limit.
pub struct Limited<R> {
    source: Take<R>,
    limit: u64,
}

impl<R: Read> Limited<R> {
    pub fn new(source: R, limit: u64) -> Self {
        Self { source: source.take(limit.saturating_add(1)), limit }
    }
}

impl Limited<File> {
    /// A file that is larger is an error before it is read.
    pub fn of_file(file: File, limit: u64) -> io::Result<Self> {
        if file.metadata()?.len() > limit {
            return Err(too_large(limit));
        }
        Ok(Self::new(file, limit))
    }

    /// All its bytes at once.
    pub fn bytes(mut self) -> io::Result<Vec<u8>> {
        let mut bytes = Vec::new();
        self.read_to_end(&mut bytes)?;
        Ok(bytes)
    }

    /// All of its text.
    pub fn text(mut self) -> io::Result<String> {
        let mut text = String::new();
        self.read_to_string(&mut text)?;
        Ok(text)
    }
}

impl<R: Read> Read for Limited<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.source.read(buffer)?;
        if self.source.limit() == 0 {
            return Err(too_large(self.limit));
        }
        Ok(read)
    }
}

fn too_large(limit: u64) -> io::Error {
    let message = format!("more than {}, and at most that is read", size(limit));
    io::Error::new(ErrorKind::FileTooLarge, message)
}

/// A number of bytes for people.
fn size(bytes: u64) -> String {
    if bytes.is_multiple_of(1 << 20) {
        format!("{} MiB", bytes >> 20)
    } else if bytes.is_multiple_of(1 << 10) {
        format!("{} KiB", bytes >> 10)
    } else {
        format!("{bytes} bytes")
    }
}

/// A file's bytes, no more than `limit`.
pub fn plain(path: &Path, limit: u64) -> io::Result<Limited<File>> {
    Limited::of_file(open(path)?, limit)
}

/// A file's bytes, decompressed where it starts as gzip does; no more than `limit` before and after.
pub fn unpacked(path: &Path, limit: u64) -> io::Result<Box<dyn Read>> {
    unpack(open(path)?, limit)
}

/// The same of an open file.
pub fn unpack(file: File, limit: u64) -> io::Result<Box<dyn Read>> {
    let mut file = BufReader::new(Limited::of_file(file, limit)?);
    Ok(if file.fill_buf()?.starts_with(&GZIP) {
        Box::new(Limited::new(MultiGzDecoder::new(file), limit))
    } else {
        Box::new(file)
    })
}

/// SHA-256 of all bytes, in hexadecimal.
pub fn sha256(source: impl Read) -> io::Result<String> {
    let mut sum = Sha256::new();
    let mut source = BufReader::with_capacity(READ_AT_ONCE, source);
    loop {
        let bytes = source.fill_buf()?;
        if bytes.is_empty() {
            return Ok(hex::encode(sum.finalize()));
        }
        sum.update(bytes);
        let read = bytes.len();
        source.consume(read);
    }
}

/// A file's text, no more than `limit` bytes of it.
pub fn text(path: &Path, limit: u64) -> io::Result<String> {
    plain(path, limit)?.text()
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LineEnd {
    Newline,
    /// The file ends without a newline.
    File,
    /// It is longer than what is kept of a line; only its beginning is there.
    TooLong,
}

/// The lines of a source, one at a time, each kept up to a number of bytes.
pub struct Lines<R> {
    source: R,
    longest: usize,
    /// The line that was read last, without its newline.
    pub line: Vec<u8>,
    /// Its number, from 1.
    pub number: usize,
    /// Bytes of all lines so far, with their newlines.
    pub bytes: u64,
}

impl<R: BufRead> Lines<R> {
    pub fn new(source: R, longest: usize) -> Self {
        Self { source, longest, line: Vec::new(), number: 0, bytes: 0 }
    }

    /// Reads the next line; none at the end of the source.
    pub fn advance(&mut self) -> io::Result<Option<LineEnd>> {
        self.line.clear();
        self.number += 1;
        let mut seen = 0;
        loop {
            let bytes = self.source.fill_buf()?;
            let newline = bytes.iter().position(|byte| *byte == b'\n');
            let part = &bytes[..newline.unwrap_or(bytes.len())];
            seen += part.len();
            let room = self.longest - self.line.len();
            self.line.extend_from_slice(&part[..part.len().min(room)]);
            let (used, ended) = (part.len() + usize::from(newline.is_some()), bytes.is_empty());
            self.source.consume(used);
            self.bytes += used as u64;
            if ended && seen == 0 {
                return Ok(None);
            }
            if newline.is_some() || ended {
                return Ok(Some(match newline {
                    _ if seen > self.longest => LineEnd::TooLong,
                    Some(_) => LineEnd::Newline,
                    None => LineEnd::File,
                }));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use flate2::{Compression, write::GzEncoder};

    use super::*;

    fn written(bytes: &[u8]) -> tempfile::NamedTempFile {
        let mut file = tempfile::NamedTempFile::new().unwrap();
        file.write_all(bytes).unwrap();
        file
    }

    fn packed(bytes: &[u8]) -> Vec<u8> {
        let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
        encoder.write_all(bytes).unwrap();
        encoder.finish().unwrap()
    }

    #[test]
    fn the_limit_is_the_last_size_that_is_read() {
        let file = written(b"12345");
        assert_eq!(text(file.path(), 5).unwrap(), "12345");
        let fault = text(file.path(), 4).unwrap_err().to_string();
        assert!(fault.contains("more than 4 bytes"), "{fault}");
    }

    #[test]
    fn the_limit_holds_for_what_comes_out_of_an_archive() {
        let file = written(&packed(&[7; 1 << 20]));
        assert!(file.path().metadata().unwrap().len() < 1 << 12);
        let mut bytes = Vec::new();
        let whole = unpacked(file.path(), 1 << 20).unwrap().read_to_end(&mut bytes);
        assert_eq!(whole.unwrap(), 1 << 20);
        let mut source = unpacked(file.path(), (1 << 20) - 1).unwrap();
        let fault = source.read_to_end(&mut Vec::new()).unwrap_err();
        assert_eq!(fault.kind(), ErrorKind::FileTooLarge);
    }

    #[test]
    fn a_source_that_never_ends_is_left_at_the_limit() {
        let mut endless = Limited::new(io::repeat(0), 1 << 16);
        let fault = io::copy(&mut endless, &mut io::sink()).unwrap_err();
        assert!(fault.to_string().contains("more than 64 KiB"), "{fault}");
    }

    #[test]
    fn lines_are_cut_at_their_longest_and_the_next_one_is_whole() {
        let mut lines = Lines::new(BufReader::with_capacity(3, &b"ab\nabcdefgh\n\nabcd\nx"[..]), 4);
        let mut found = Vec::new();
        while let Some(end) = lines.advance().unwrap() {
            found.push((lines.number, String::from_utf8(lines.line.clone()).unwrap(), end));
        }
        let line = |number, text: &str, end| (number, text.to_owned(), end);
        let expected = [
            line(1, "ab", LineEnd::Newline),
            line(2, "abcd", LineEnd::TooLong),
            line(3, "", LineEnd::Newline),
            line(4, "abcd", LineEnd::Newline),
            line(5, "x", LineEnd::File),
        ];
        assert_eq!(found, expected);
    }
}
