//! Meshes from files, and what all readers share.

use std::io::{self, BufReader, Read};
use std::path::Path;

use glam::Vec3;

use super::{Mesh, check, obj, ply};
use fathom_base::input;

/// Most bytes that are read from one file, after decompression.
pub const MAX_BYTES: u64 = 512 << 20;

/// Most triangles of a scene, and so of one mesh file: with them `tobj`, which takes 104 bytes a face, and what becomes of its
/// output stay below 1 GiB.
pub const MAX_TRIANGLES: usize = 4_000_000;

/// Most vertices, and most normals, that are read from one mesh file: a hash table of 2²² places holds so many.
pub const MAX_VERTICES: usize = 3_600_000;

/// A file's content as it is read, decompressed.
pub type Source = BufReader<Box<dyn Read>>;

impl Mesh {
    /// Reads a mesh by the ending of its name: `.obj` or `.ply` (ASCII), each plain or compressed by gzip with `.gz` after it.
    pub fn read(path: &Path) -> Result<Mesh, String> {
        Mesh::read_within(path, MAX_TRIANGLES)
    }

    /// The same of no more than so many triangles.
    pub(super) fn read_within(path: &Path, triangles: usize) -> Result<Mesh, String> {
        let malformed = |what| format!("mesh {}: {what}", path.display());
        let name = path.to_string_lossy().to_ascii_lowercase();
        let plain = name.strip_suffix(".gz").unwrap_or(&name);
        let read: fn(Source, usize) -> Result<Mesh, String> = match plain.rsplit_once('.') {
            Some((_, "obj")) => obj::read,
            Some((_, "ply")) => ply::read,
            _ => {
                let what = "its name must end in .obj or .ply, or in one of them and .gz";
                return Err(malformed(what.to_owned()));
            }
        };
        let source =
            open(path).map_err(|e| format!("cannot read the mesh {}: {e}", path.display()))?;
        read(BufReader::new(source), triangles).and_then(checked).map_err(malformed)
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
fn checked(mut mesh: Mesh) -> Result<Mesh, String> {
    for n in &mut mesh.normals {
        *n = Vec3::from(*n).normalize_or(Vec3::Y).to_array();
    }
    let far = check::FAR_M as f32;
    let bad = |p: &[f32; 3]| !p.iter().all(|c| c.abs() <= far);
    if let Some(i) = mesh.positions.iter().position(bad) {
        let vertex = mesh.positions[i];
        return Err(format!(
            "vertex {i} is {vertex:?}; coordinates must be finite and within ±{far}"
        ));
    }
    mesh.validate()?;
    Ok(mesh)
}
