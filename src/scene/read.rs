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

/// A file's content as it is read, decompressed.
pub type FileReader = BufReader<Box<dyn Read>>;

/// Text of UTF-8 without the byte order mark, its lines ended by a line feed alone.
pub fn text_of(file: Box<dyn Read>) -> io::Result<FileReader> {
    let mut source = BufReader::new(file);
    if source.fill_buf()?.starts_with(BYTE_ORDER_MARK.as_bytes()) {
        source.consume(BYTE_ORDER_MARK.len());
    }
    Ok(BufReader::new(Box::new(LineFeeds { source, after_return: false })))
}

/// Each carriage return, and the line feed that may follow it, as a line feed.
struct LineFeeds {
    source: FileReader,
    after_return: bool,
}

impl Read for LineFeeds {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        loop {
            let (read, mut kept) = (self.source.read(buffer)?, 0);
            if !self.after_return && !buffer[..read].contains(&b'\r') {
                return Ok(read);
            }
            for at in 0..read {
                let byte = buffer[at];
                if !(byte == b'\n' && self.after_return) {
                    buffer[kept] = if byte == b'\r' { b'\n' } else { byte };
                    kept += 1;
                }
                self.after_return = byte == b'\r';
            }
            if kept > 0 || read == 0 {
                return Ok(kept);
            }
        }
    }
}

/// A file's content, decompressed where it starts as gzip does; an error where there is more than [`MAX_BYTES`] of it.
pub fn open(path: &Path) -> io::Result<Box<dyn Read>> {
    input::unpacked(path, MAX_BYTES)
}

/// Why a mesh with more triangles than `most` is refused.
pub fn too_many_triangles(most: usize) -> String {
    if most == MAX_TRIANGLES {
        format!("more than {most} triangles; at most that is read")
    } else {
        format!(
            "more than {most} triangles, which the scene's other objects leave of {MAX_TRIANGLES}"
        )
    }
}
