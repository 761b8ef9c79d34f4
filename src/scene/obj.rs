//! OBJ files, plain or compressed by gzip, read by `tobj`.

use std::{collections::HashMap, io::Cursor, path::Path};

use tobj::{LoadError, LoadOptions};

use super::{
    Mesh,
    read::{self, MAX_TRIANGLES, MeshError},
};

/// Reads all objects of an OBJ file into one mesh. Polygons are cut into triangles, a missing
/// material library is no fault, and normals are computed where an object has none.
pub fn read(path: &Path) -> Result<Mesh, MeshError> {
    let bytes = read::whole_file(path)
        .map_err(|e| MeshError::read(path, e))?
        .map_err(|what| MeshError::malformed(path, what))?;
    count_triangles(path, &bytes)?;
    let options = LoadOptions {
        triangulate: true,
        ignore_points: true,
        ignore_lines: true,
        ..LoadOptions::default()
    };
    let no_materials = |_: &Path| Ok((Vec::new(), Default::default()));
    let mut reader = Cursor::new(bytes.as_slice());
    let loaded = tobj::load_obj_buf(&mut reader, &options, no_materials);
    let (models, _) = loaded.map_err(|fault| {
        let line = line_at(&bytes, reader.position());
        malformed(path, fault, line)
    })?;
    let mut mesh = Mesh::default();
    for model in &models {
        mesh.append(&convert(&model.mesh));
    }
    read::checked(path, mesh)
}

/// Refuses a file with too many triangles before anything is allocated for them.
fn count_triangles(path: &Path, bytes: &[u8]) -> Result<(), MeshError> {
    let mut triangles = 0;
    for line in bytes.split(|b| *b == b'\n') {
        let mut words = line
            .split(u8::is_ascii_whitespace)
            .filter(|word| !word.is_empty());
        if words.next() == Some(b"f") {
            triangles += words.count().saturating_sub(2);
        }
    }
    if triangles > MAX_TRIANGLES {
        return Err(MeshError::malformed(
            path,
            format!("{triangles} triangles; at most {MAX_TRIANGLES} are read"),
        ));
    }
    Ok(())
}

/// The number of the line that ends at `position`.
fn line_at(bytes: &[u8], position: u64) -> usize {
    let end = (position as usize).min(bytes.len()).saturating_sub(1);
    1 + bytes[..end].iter().filter(|b| **b == b'\n').count()
}

fn malformed(path: &Path, fault: LoadError, line: usize) -> MeshError {
    let what = match fault {
        // Found when an object ends, so the line would mislead.
        LoadError::FaceVertexOutOfBounds
        | LoadError::FaceNormalOutOfBounds
        | LoadError::FaceTexCoordOutOfBounds
        | LoadError::FaceColorOutOfBounds => format!("{fault} in the object before line {line}"),
        _ => format!("line {line}: {fault}"),
    };
    MeshError::malformed(path, what)
}

/// One vertex per pair of position and normal; without normals, one per position, so that smooth
/// surfaces stay smooth.
fn convert(source: &tobj::Mesh) -> Mesh {
    let triple = |values: &[f32], i: u32| {
        let at = 3 * i as usize;
        [values[at], values[at + 1], values[at + 2]]
    };
    if source.normal_indices.len() != source.indices.len() {
        let mut mesh = Mesh {
            positions: source
                .positions
                .chunks_exact(3)
                .map(|p| [p[0], p[1], p[2]])
                .collect(),
            normals: Vec::new(),
            indices: source.indices.clone(),
        };
        mesh.recompute_normals();
        return mesh;
    }
    let mut mesh = Mesh::default();
    let mut known = HashMap::new();
    for pair in source.indices.iter().zip(&source.normal_indices) {
        let index = *known.entry(pair).or_insert_with(|| {
            mesh.positions.push(triple(&source.positions, *pair.0));
            mesh.normals.push(triple(&source.normals, *pair.1));
            mesh.positions.len() as u32 - 1
        });
        mesh.indices.push(index);
    }
    mesh
}
