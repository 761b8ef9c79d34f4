//! Meshes from files.

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

use super::read::{MAX_TRIANGLES, Source, open, text_of};
use super::{Mesh, check, obj, ply};
use fathom_base::tell;

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
        let read: fn(Source, usize, &mut Vec<String>) -> Result<Mesh, String> =
            match plain.rsplit_once('.') {
                Some((_, "obj")) => obj::read,
                Some((_, "ply")) => ply::read,
                _ => {
                    let what = "its name must end in .obj or .ply, or in one of them and .gz";
                    return Err(malformed(what.to_owned()));
                }
            };
        let source = open(path).and_then(text_of);
        let source = source.map_err(|e| format!("cannot read the mesh {}: {e}", path.display()))?;
        let mut notes = Vec::new();
        let mesh = read(source, triangles, &mut notes).and_then(checked).map_err(malformed)?;
        notes.into_iter().map(malformed).for_each(note_once);
        Ok(mesh)
    }
}

/// Prints a note, if this process has not done so before: a scene's files are read more than once.
fn note_once(note: String) {
    static KNOWN: Mutex<BTreeSet<String>> = Mutex::new(BTreeSet::new());
    if KNOWN.lock().unwrap_or_else(PoisonError::into_inner).insert(note.clone()) {
        tell::note(note);
    }
}

/// The mesh, if it can be used.
fn checked(mesh: Mesh) -> Result<Mesh, String> {
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
