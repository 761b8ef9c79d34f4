//! Files of meshes and volumes.

use std::io::Write;

use flate2::{Compression, write::GzEncoder};

pub fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

struct Writer {
    little: bool,
    bytes: Vec<u8>,
}

impl Writer {
    fn put<const N: usize>(&mut self, at: usize, little: [u8; N]) {
        let mut bytes = little;
        if !self.little {
            bytes.reverse();
        }
        self.bytes[at..at + N].copy_from_slice(&bytes);
    }
}

/// A NIfTI-1 file of 2 × 3 × 2 cells of 1 × 2 × 3 mm with the values of `data`, given low byte first.
pub fn nifti<const N: usize>(little: bool, datatype: i16, data: &[[u8; N]]) -> Vec<u8> {
    let mut file = Writer { little, bytes: vec![0; 352] };
    file.put(0, 348i32.to_le_bytes());
    for (i, n) in [3i16, 2, 3, 2, 1, 1, 1, 1].into_iter().enumerate() {
        file.put(40 + 2 * i, n.to_le_bytes());
    }
    file.put(70, datatype.to_le_bytes());
    file.put(72, (8 * N as i16).to_le_bytes());
    for (i, edge) in [1.0f32, 1.0, 2.0, 3.0].into_iter().enumerate() {
        file.put(76 + 4 * i, edge.to_le_bytes());
    }
    file.put(108, 352f32.to_le_bytes());
    file.put(112, 1f32.to_le_bytes());
    file.bytes[123] = 2;
    file.bytes[344..348].copy_from_slice(b"n+1\0");
    for value in data {
        let mut value = *value;
        if !little {
            value.reverse();
        }
        file.bytes.extend(value);
    }
    file.bytes
}
