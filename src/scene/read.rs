//! Meshes from files, and what all readers share.

use std::{
    fs::File,
    io::{self, BufRead, BufReader, Read, Take},
    path::{Path, PathBuf},
};

use flate2::bufread::MultiGzDecoder;
use glam::Vec3;
use thiserror::Error;

use super::{Mesh, check, obj, ply};

/// Most bytes that are read from one file, after decompression.
pub const MAX_BYTES: u64 = 512 << 20;

/// Most triangles that are read from one mesh file.
pub const MAX_TRIANGLES: usize = 20_000_000;

/// Why a mesh file cannot be used.
#[derive(Debug, Error)]
pub enum MeshError {
    #[error("cannot read the mesh {path}: {source}")]
    Read { path: PathBuf, source: io::Error },
    #[error("mesh {path}: {what}")]
    Malformed { path: PathBuf, what: String },
}

impl MeshError {
    pub(super) fn malformed(path: &Path, what: impl Into<String>) -> MeshError {
        MeshError::Malformed {
            path: path.to_owned(),
            what: what.into(),
        }
    }

    pub(super) fn read(path: &Path, source: io::Error) -> MeshError {
        MeshError::Read {
            path: path.to_owned(),
            source,
        }
    }
}

impl Mesh {
    /// Reads a mesh by the ending of its name: `.obj` or `.ply` (ASCII), each plain or compressed by gzip with `.gz` after it.
    pub fn read(path: &Path) -> Result<Mesh, MeshError> {
        let name = path.to_string_lossy().to_ascii_lowercase();
        let plain = name.strip_suffix(".gz").unwrap_or(&name);
        if plain.ends_with(".obj") {
            obj::read(path)
        } else if plain.ends_with(".ply") {
            ply::read(path)
        } else {
            Err(MeshError::malformed(
                path,
                "its name must end in .obj or .ply, or in one of them and .gz",
            ))
        }
    }
}

/// A file's content, decompressed where it starts as gzip does, and no more than a byte over [`MAX_BYTES`] of it.
pub fn open(path: &Path) -> io::Result<Take<Box<dyn Read>>> {
    let mut file = BufReader::new(File::open(path)?);
    let source: Box<dyn Read> = if file.fill_buf()?.starts_with(&[0x1f, 0x8b]) {
        Box::new(MultiGzDecoder::new(file))
    } else {
        Box::new(file)
    };
    Ok(source.take(MAX_BYTES + 1))
}

/// All bytes of a file of at most [`MAX_BYTES`], decompressed where it starts as gzip does; an error of reading, or what is
/// wrong with the size.
pub fn whole_file(path: &Path) -> io::Result<Result<Vec<u8>, String>> {
    let mut bytes = Vec::new();
    open(path)?.read_to_end(&mut bytes)?;
    Ok(match bytes.len() as u64 {
        0 => Err("the file is empty".to_owned()),
        n if n > MAX_BYTES => Err(too_large()),
        _ => Ok(bytes),
    })
}

pub fn too_large() -> String {
    format!("more than {} MiB; at most that is read", MAX_BYTES >> 20)
}

/// The mesh with unit normals, if it can be used.
pub fn checked(path: &Path, mut mesh: Mesh) -> Result<Mesh, MeshError> {
    for n in &mut mesh.normals {
        *n = Vec3::from(*n).normalize_or(Vec3::Y).to_array();
    }
    let far = check::FAR_M as f32;
    let bad = |p: &[f32; 3]| !p.iter().all(|c| c.abs() <= far);
    if let Some(i) = mesh.positions.iter().position(bad) {
        return Err(MeshError::malformed(
            path,
            format!(
                "vertex {i} is {:?}; coordinates must be finite and within ±{far}",
                mesh.positions[i]
            ),
        ));
    }
    match mesh.validate() {
        Ok(()) => Ok(mesh),
        Err(what) => Err(MeshError::malformed(path, what)),
    }
}
