//! Meshes from files, and what all readers share.

use std::{
    io::{self, Read},
    path::{Path, PathBuf},
};

use glam::Vec3;
use thiserror::Error;

use super::{Mesh, check, obj, ply};
use crate::input;

/// Most bytes that are read from one file, after decompression.
pub const MAX_BYTES: u64 = 512 << 20;

/// Most triangles of a scene, and so of one mesh file: with them `tobj`, which takes 104 bytes a face, and what becomes of its
/// output stay below 1 GiB.
pub const MAX_TRIANGLES: usize = 4_000_000;

/// Most vertices, and most normals, that are read from one mesh file: a hash table of 2²² places holds so many.
pub const MAX_VERTICES: usize = 3_600_000;

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
        MeshError::Malformed { path: path.to_owned(), what: what.into() }
    }

    pub(super) fn read(path: &Path, source: io::Error) -> MeshError {
        MeshError::Read { path: path.to_owned(), source }
    }
}

impl Mesh {
    /// Reads a mesh by the ending of its name: `.obj` or `.ply` (ASCII), each plain or compressed by gzip with `.gz` after it.
    pub fn read(path: &Path) -> Result<Mesh, MeshError> {
        Mesh::read_within(path, MAX_TRIANGLES)
    }

    /// The same of no more than so many triangles.
    pub(super) fn read_within(path: &Path, triangles: usize) -> Result<Mesh, MeshError> {
        let name = path.to_string_lossy().to_ascii_lowercase();
        let plain = name.strip_suffix(".gz").unwrap_or(&name);
        if plain.ends_with(".obj") {
            obj::read(path, triangles)
        } else if plain.ends_with(".ply") {
            ply::read(path, triangles)
        } else {
            Err(MeshError::malformed(
                path,
                "its name must end in .obj or .ply, or in one of them and .gz",
            ))
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

/// Enough of a word to know it by.
pub fn clipped(word: &str) -> String {
    word.chars().take(24).collect()
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
