//! Meshes from files: what the readers share.

use std::{
    fs::File,
    io::{self, Read},
    path::{Path, PathBuf},
};

use glam::Vec3;
use thiserror::Error;

use super::{Mesh, check, obj, ply};

/// Most bytes that are read from one mesh file, after decompression.
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
    /// Reads a mesh by the ending of its name: `.obj`, `.ply`, or `.ply.gz` (both ASCII).
    pub fn read(path: &Path) -> Result<Mesh, MeshError> {
        let name = path.to_string_lossy().to_ascii_lowercase();
        if name.ends_with(".obj") {
            obj::read(path)
        } else if name.ends_with(".ply") || name.ends_with(".ply.gz") {
            ply::read(path)
        } else {
            Err(MeshError::malformed(
                path,
                "its name must end in .obj, .ply or .ply.gz",
            ))
        }
    }
}

/// All bytes of a file of at most [`MAX_BYTES`].
pub fn whole_file(path: &Path) -> Result<Vec<u8>, MeshError> {
    let file = File::open(path).map_err(|e| MeshError::read(path, e))?;
    let mut bytes = Vec::new();
    file.take(MAX_BYTES + 1)
        .read_to_end(&mut bytes)
        .map_err(|e| MeshError::read(path, e))?;
    if bytes.len() as u64 > MAX_BYTES {
        return Err(MeshError::malformed(path, too_large()));
    }
    if bytes.is_empty() {
        return Err(MeshError::malformed(path, "the file is empty"));
    }
    Ok(bytes)
}

pub fn too_large() -> String {
    format!(
        "more than {} MiB of text; at most that is read",
        MAX_BYTES >> 20
    )
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
