//! The built-in scenes, and the files that users bring: scenes, meshes and volumes. Bad ones give one clear line.

mod built_in;
mod meshes;
mod volumes;

use std::io::Write;

use flate2::{Compression, write::GzEncoder};

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}
