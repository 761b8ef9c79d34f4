//! What all readers of files share.

use std::io::{self, BufRead, BufReader, Read};
use std::path::Path;

use fathom_base::input::{self, BYTE_ORDER_MARK};

/// Most bytes that are read from one file, after decompression.
pub const MAX_BYTES: u64 = 512 << 20;

/// Most triangles of a scene, and so of one mesh file: with them `tobj`, which takes 104 bytes a face, and what becomes of its
/// output stay below 1 GiB.
pub const MAX_TRIANGLES: usize = 4_000_000;

/// Most vertices, and most normals, that are read from one mesh file: a hash table of 2²² places holds so many.
pub const MAX_VERTICES: usize = 3_600_000;

/// Longest line that is read, bytes.
pub const MAX_LINE: usize = 1 << 16;

/// The lines of a file, counted.
pub struct LineReader<'a> {
    /// What follows the line.
    pub source: BufReader<&'a mut dyn Read>,
    /// Of the line, from 1.
    pub number: usize,
    /// Without what ended it: a line feed, a carriage return, or both.
    pub line: Vec<u8>,
}

impl<'a> LineReader<'a> {
    /// Begins behind the byte order mark.
    pub fn new(file: &'a mut dyn Read) -> Result<Self, String> {
        let mut source = BufReader::new(file);
        let start = source.fill_buf().map_err(|error| error.to_string())?;
        if start.starts_with(BYTE_ORDER_MARK.as_bytes()) {
            source.consume(BYTE_ORDER_MARK.len());
        }
        Ok(Self { source, number: 0, line: Vec::new() })
    }

    /// Reads the next line; false at the end of the file.
    pub fn next(&mut self) -> Result<bool, String> {
        self.line.clear();
        self.append().map_err(|error| error.to_string())
    }

    /// Reads the next line behind the one that is there.
    pub fn append(&mut self) -> io::Result<bool> {
        if self.source.fill_buf()?.is_empty() {
            return Ok(false);
        }
        self.number += 1;
        loop {
            let bytes = self.source.fill_buf()?;
            let length = bytes.iter().position(|byte| matches!(byte, b'\n' | b'\r'));
            let part = &bytes[..length.unwrap_or(bytes.len())];
            if self.line.len() + part.len() > MAX_LINE {
                return Err(io::Error::other(format!("longer than {MAX_LINE} bytes")));
            }
            self.line.extend(part);
            let end = bytes.get(part.len()).copied();
            let is_last = bytes.is_empty();
            let read = part.len() + usize::from(end.is_some());
            self.source.consume(read);
            if end == Some(b'\r') && self.source.fill_buf()?.starts_with(b"\n") {
                self.source.consume(1);
            }
            if end.is_some() || is_last {
                return Ok(true);
            }
        }
    }
}

/// A file's content, decompressed where it starts as gzip does; an error where there is more than [`MAX_BYTES`] of it.
pub fn open(path: &Path) -> io::Result<Box<dyn Read>> {
    input::unpacked(path, MAX_BYTES)
}

/// Why a mesh with more triangles than `most` is refused.
pub fn too_many_triangles(max: usize) -> String {
    if max == MAX_TRIANGLES {
        format!("more than {max} triangles; at most that is read")
    } else {
        format!(
            "more than {max} triangles, which the scene's other objects leave of {MAX_TRIANGLES}"
        )
    }
}
