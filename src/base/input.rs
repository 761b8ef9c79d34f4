//! Files that a user names, read with a limit: only regular files are read, and a file that is larger ends in an error that names
//! the limit.

use std::fs::{self, File, FileType};
use std::io::{self, BufRead, BufReader, ErrorKind, Read, Take};
use std::path::Path;

use flate2::bufread::MultiGzDecoder;
use sha2::{Digest, Sha256};

/// Largest file that people write by hand (scene, experiment, gates), bytes: sixty times the longest of this project.
pub const MAX_TEXT: u64 = 1 << 20;

/// Bytes of a file that are summed up in one step.
const READ_AT_ONCE: usize = 1 << 20;
/// What some editors put before text.
pub const BYTE_ORDER_MARK: &str = "\u{feff}";
/// First bytes of what gzip compressed. RFC 1952, 2.3.1.
const GZIP: [u8; 2] = [0x1f, 0x8b];

/// Opens a regular file to read it. Anything else is an error: reading a pipe or a device may wait for ever.
pub fn open(path: &Path) -> io::Result<File> {
    let kind = fs::metadata(path)?.file_type();
    if kind.is_file() {
        return File::open(path);
    }
    let message = format!("it is {}, and only regular files are read", kind_name(kind));
    Err(io::Error::new(ErrorKind::InvalidInput, message))
}

/// What a file is, for people.
pub(crate) fn kind_name(kind: FileType) -> &'static str {
    match kind {
        kind if kind.is_symlink() => "a symbolic link",
        kind if kind.is_dir() => "a folder",
        kind if kind.is_file() => "a file",
        _ => "a pipe or a device",
    }
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

    /// All its bytes at once.
    pub fn bytes(mut self) -> io::Result<Vec<u8>> {
        let mut bytes = Vec::new();
        self.read_to_end(&mut bytes)?;
        Ok(bytes)
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
    let size = match limit {
        limit if limit.is_multiple_of(1 << 20) => format!("{} MiB", limit >> 20),
        limit => format!("{limit} bytes"),
    };
    let message = format!("more than {size}, and at most that is read");
    io::Error::new(ErrorKind::FileTooLarge, message)
}

/// The bytes of an open file, no more than `limit`. A file that is larger is an error before it is read.
pub fn limited(file: File, limit: u64) -> io::Result<Limited<File>> {
    if file.metadata()?.len() > limit {
        return Err(too_large(limit));
    }
    Ok(Limited::new(file, limit))
}

/// A file's bytes, decompressed where it starts as gzip does; no more than `limit` before and after.
pub fn unpacked(path: &Path, limit: u64) -> io::Result<Box<dyn Read>> {
    unpack(open(path)?, limit)
}

/// The same of an open file.
pub fn unpack(file: File, limit: u64) -> io::Result<Box<dyn Read>> {
    let mut file = BufReader::new(limited(file, limit)?);
    Ok(if file.fill_buf()?.starts_with(&GZIP) {
        Box::new(Limited::new(MultiGzDecoder::new(file), limit))
    } else {
        Box::new(file)
    })
}

/// SHA-256 of all bytes, in hexadecimal.
pub fn sha256(mut source: impl Read) -> io::Result<String> {
    let (mut sum, mut buffer) = (Sha256::new(), vec![0; READ_AT_ONCE]);
    loop {
        match source.read(&mut buffer)? {
            0 => return Ok(hex::encode(sum.finalize())),
            read => sum.update(&buffer[..read]),
        }
    }
}

/// The first digits of that: enough to tell two files from each other.
pub fn digest(source: impl Read) -> io::Result<String> {
    sha256(source).map(|sum| sum[..16].to_owned())
}

/// A file's text without the mark of byte order that some editors put before it, no more than `limit` bytes.
pub fn text(path: &Path, limit: u64) -> io::Result<String> {
    let text = io::read_to_string(limited(open(path)?, limit)?)?;
    Ok(text.strip_prefix(BYTE_ORDER_MARK).map(str::to_owned).unwrap_or(text))
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LineEnd {
    Newline,
    /// The file ends without a newline.
    File,
    /// It is longer than what is kept of a line; only its beginning is there.
    TooLong,
}

/// Reads the next line without its newline, of a longer one the first `longest` bytes; none at the end of the source.
pub fn next_line(
    source: &mut impl BufRead,
    longest: usize,
    line: &mut Vec<u8>,
) -> io::Result<Option<LineEnd>> {
    line.clear();
    if source.by_ref().take(longest as u64 + 1).read_until(b'\n', line)? == 0 {
        return Ok(None);
    }
    if line.pop_if(|byte| *byte == b'\n').is_some() {
        return Ok(Some(LineEnd::Newline));
    }
    if line.len() <= longest {
        return Ok(Some(LineEnd::File));
    }
    line.truncate(longest);
    source.skip_until(b'\n')?;
    Ok(Some(LineEnd::TooLong))
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use flate2::{Compression, write::GzEncoder};

    use super::*;

    #[test]
    fn the_limit_is_the_last_size_that_is_read_before_and_after_unpacking() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        fs::write(&path, "\u{feff}12").unwrap();
        assert_eq!(text(&path, 5).unwrap(), "12");
        fs::write(&path, "12345").unwrap();
        assert_eq!(text(&path, 5).unwrap(), "12345");
        let fault = text(&path, 4).unwrap_err().to_string();
        assert!(fault.contains("more than 4 bytes"), "{fault}");
        let mut packer = GzEncoder::new(File::create(&path).unwrap(), Compression::best());
        packer.write_all(&[7; 1 << 20]).unwrap();
        packer.finish().unwrap();
        let read = |limit| unpacked(&path, limit).unwrap().read_to_end(&mut Vec::new());
        assert_eq!(read(1 << 20).unwrap(), 1 << 20);
        assert_eq!(read((1 << 20) - 1).unwrap_err().kind(), ErrorKind::FileTooLarge);
        let endless = Limited::new(io::repeat(0), 1 << 20).bytes().unwrap_err();
        assert!(endless.to_string().contains("more than 1 MiB"), "{endless}");
    }

    #[test]
    fn lines_are_cut_at_their_longest_and_the_next_one_is_whole() {
        let mut source = BufReader::with_capacity(3, &b"ab\nabcdefgh\n\nabcd\nx"[..]);
        let (mut line, mut found) = (Vec::new(), Vec::new());
        while let Some(end) = next_line(&mut source, 4, &mut line).unwrap() {
            found.push((String::from_utf8(line.clone()).unwrap(), end));
        }
        use LineEnd::{File, Newline, TooLong};
        let lines =
            [("ab", Newline), ("abcd", TooLong), ("", Newline), ("abcd", Newline), ("x", File)];
        assert_eq!(found, lines.map(|(line, end)| (line.to_owned(), end)));
    }
}
