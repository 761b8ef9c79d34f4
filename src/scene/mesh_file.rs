//! Meshes from files.

use std::collections::BTreeSet;
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use super::read::{MAX_TRIANGLES, open};
use super::{Mesh, check, gltf, obj, ply, stl};
use fathom_base::print;

/// What a mesh file holds of one colour.
pub struct MeshPart {
    pub mesh: Mesh,
    /// Diffuse reflectance, linear RGB, where the file has one.
    pub albedo: Option<[f32; 3]>,
    /// Opacity; 1 where the file has none.
    pub alpha: f32,
}

/// Reads the content of the file at a path, of no more than so many triangles, and adds what it does not read to the notes.
type Reader = fn(&mut dyn Read, &Path, usize, &mut Vec<String>) -> Result<Vec<MeshPart>, String>;

/// Endings of names with what reads such files.
const READERS: [(&str, Reader); 5] = [
    ("obj", |file, _, max, notes| Ok(vec![obj::read(file, max, notes)?.into()])),
    ("ply", |file, _, max, _| Ok(vec![ply::read(file, max)?.into()])),
    ("stl", |file, _, max, notes| Ok(vec![stl::read(file, max, notes)?.into()])),
    ("gltf", gltf::read),
    ("glb", gltf::read),
];

/// For messages.
pub const ENDINGS: &str = ".obj, .ply, .stl, .gltf or .glb";

impl From<Mesh> for MeshPart {
    fn from(mesh: Mesh) -> Self {
        Self { mesh, albedo: None, alpha: 1.0 }
    }
}

/// The ending of a file's name without that of gzip.
fn ending(path: &Path) -> Option<String> {
    let name = path.to_string_lossy().to_ascii_lowercase();
    let (_, ending) = name.strip_suffix(".gz").unwrap_or(&name).rsplit_once('.')?;
    Some(ending.to_owned())
}

/// What reads a file of this name; none where its ending is not that of a mesh.
pub fn reader(path: &Path) -> Option<Reader> {
    let ending = ending(path)?;
    READERS.iter().find(|(known, _)| *known == ending).map(|(_, reader)| *reader)
}

impl Mesh {
    /// Reads a mesh by the ending of its name: `ENDINGS`, each plain or compressed by gzip with `.gz` after it.
    pub fn read(path: &Path) -> Result<Mesh, String> {
        let mut mesh = Mesh::default();
        read_parts(path, MAX_TRIANGLES)?.iter().for_each(|part| mesh.append(&part.mesh));
        Ok(mesh)
    }
}

/// The parts of a mesh file of no more than so many triangles: one at least.
pub fn read_parts(path: &Path, triangles: usize) -> Result<Vec<MeshPart>, String> {
    let malformed = |what| format!("mesh {}: {what}", path.display());
    let named = || malformed(format!("its name must end in {ENDINGS}, or in one of them and .gz"));
    let read = reader(path).ok_or_else(named)?;
    let file = open(path);
    let mut file = file.map_err(|e| format!("cannot read the mesh {}: {e}", path.display()))?;
    let mut notes = Vec::new();
    let parts =
        read(&mut file, path, triangles, &mut notes).and_then(checked).map_err(malformed)?;
    // To the end of the archive, whose checksum stands there.
    let rest = io::copy(&mut file, &mut io::sink());
    rest.map_err(|error| malformed(format!("{error}, after the mesh")))?;
    notes.into_iter().map(malformed).for_each(note_once);
    Ok(parts)
}

/// The files that a mesh file names and that are read with it.
pub fn companions(path: &Path) -> Result<BTreeSet<PathBuf>, String> {
    match ending(path).as_deref() {
        Some("gltf" | "glb") => gltf::buffer_files(path),
        _ => Ok(BTreeSet::new()),
    }
}

/// Prints a note, if this process has not done so before: a scene's files are read more than once.
fn note_once(note: String) {
    static KNOWN: Mutex<BTreeSet<String>> = Mutex::new(BTreeSet::new());
    if KNOWN.lock().unwrap_or_else(PoisonError::into_inner).insert(note.clone()) {
        print::note(note);
    }
}

/// The parts that have triangles, if they can be used.
fn checked(mut parts: Vec<MeshPart>) -> Result<Vec<MeshPart>, String> {
    let far = check::FAR_M as f32;
    let bad = |p: &[f32; 3]| !p.iter().all(|c| c.abs() <= far);
    parts.retain(|part| !part.mesh.indices.is_empty());
    for MeshPart { mesh, .. } in &parts {
        if let Some(i) = mesh.positions.iter().position(bad) {
            let vertex = mesh.positions[i];
            return Err(format!(
                "vertex {i} is {vertex:?}; coordinates must be finite and within ±{far}"
            ));
        }
        mesh.validate()?;
    }
    if parts.is_empty() { Mesh::default().validate().map(|()| parts) } else { Ok(parts) }
}
