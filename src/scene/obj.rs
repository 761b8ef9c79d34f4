//! OBJ files, plain or compressed by gzip, read by `tobj`.
//!
//! `tobj` keeps every face and object, whether or not it holds a triangle, and computes with indices before it checks them. So
//! lines reach it through [`Statements`], which passes on what a mesh needs, within limits.

use std::collections::{BTreeMap, HashMap};
use std::io::{self, BufRead, Read, Write};

use glam::Vec3;
use tobj::{LoadError, LoadOptions};

use super::read::{self, LineReader, MAX_VERTICES};
use super::{Mesh, polygon};
use fathom_base::text::excerpt;

/// Most unknown keywords that are named.
const MAX_UNKNOWN: usize = 8;

/// The index of a normal that is none, passed on before those of the file.
const NO_NORMAL: usize = 1;

/// Most objects and groups that hold triangles. Each takes `tobj` about half a kilobyte.
const MAX_OBJECTS: usize = 100_000;

/// Reads all objects of an OBJ file of at most `triangles` into one mesh, and adds what is not read of it to `notes`. Polygons are
/// cut into triangles, materials are left aside, and normals are computed where a corner has none that can be used.
pub fn read(
    file: &mut dyn Read,
    triangles: usize,
    notes: &mut Vec<String>,
) -> Result<Mesh, String> {
    let mut statements = Statements::new(LineReader::new(file)?, triangles);
    let no_materials = |_: &std::path::Path| Ok((Vec::new(), Default::default()));
    let loaded = tobj::load_obj_buf(&mut statements, &LoadOptions::default(), no_materials);
    let (models, _) = loaded.map_err(|fault| malformed(&statements, fault))?;
    if statements.lines.number == 0 {
        return Err("the file is empty".into());
    }
    notes.extend(statements.unknown.iter().map(|(keyword, line)| {
        format!("line {line}: lines that start with `{keyword}` are not read")
    }));
    let mut mesh = Mesh::default();
    models.iter().for_each(|model| mesh.append(&convert(&model.mesh)));
    Ok(mesh)
}

fn malformed(statements: &Statements<'_>, fault: LoadError) -> String {
    let line = statements.lines.number;
    match (&statements.fault, fault) {
        (Some(what), _) => format!("line {line}: {what}"),
        // Found when an object ends, so the line would mislead.
        (None, fault @ (LoadError::FaceVertexOutOfBounds | LoadError::FaceNormalOutOfBounds)) => {
            format!("{fault} in the object that ends at line {line}")
        }
        (None, fault) => format!("line {line}: {fault}"),
    }
}

/// The lines of a file that describe geometry, as `tobj` is to read them: one line a statement, coordinates without colours, faces
/// of three corners and more with indices that count from 1, all with normals, and a new object wherever one with faces has ended.
struct Statements<'a> {
    lines: LineReader<'a>,
    /// What is passed on of the statement, and how much of it was taken.
    out: Vec<u8>,
    taken: usize,
    positions: usize,
    normals: usize,
    triangles: usize,
    max_triangles: usize,
    objects: usize,
    /// The next face starts an object.
    ended: bool,
    /// Keywords, and where each stands first.
    unknown: BTreeMap<String, usize>,
    /// Why reading stopped.
    fault: Option<String>,
}

impl<'a> Statements<'a> {
    fn new(lines: LineReader<'a>, max_triangles: usize) -> Self {
        Self {
            lines,
            out: b"vn 0 0 0\n".to_vec(),
            taken: 0,
            positions: 0,
            normals: 0,
            triangles: 0,
            max_triangles,
            objects: 0,
            ended: true,
            unknown: BTreeMap::new(),
            fault: None,
        }
    }

    /// Reads statements up to one that is passed on; false at the end of the file.
    fn advance(&mut self) -> Result<bool, String> {
        self.out.clear();
        self.taken = 0;
        while self.out.is_empty() {
            if !self.join()? {
                return Ok(false);
            }
            let line = std::mem::take(&mut self.lines.line);
            self.statement(&line)?;
            self.lines.line = line;
        }
        Ok(true)
    }

    /// Reads a line without its comment, with those that it continues on; false at the end of the file.
    fn join(&mut self) -> Result<bool, String> {
        let first = self.lines.number;
        self.lines.line.clear();
        loop {
            let start = self.lines.line.len();
            if !self.lines.append().map_err(|error| error.to_string())? {
                return Ok(self.lines.number > first);
            }
            let line = &mut self.lines.line;
            let comment = line[start..].iter().position(|byte| *byte == b'#');
            line.truncate(comment.map_or(line.len(), |length| start + length));
            line.truncate(line.trim_ascii_end().len());
            if comment.is_some() || line.pop_if(|byte| *byte == b'\\').is_none() {
                return Ok(true);
            }
            line.push(b' ');
        }
    }

    fn statement(&mut self, line: &[u8]) -> Result<(), String> {
        let mut words = line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
        let Some(keyword) = words.next() else {
            return Ok(());
        };
        match keyword {
            b"o" | b"g" => self.ended = true,
            // Names may be in any encoding.
            b"usemtl" | b"mtllib" | b"vt" | b"l" | b"p" | b"s" => {}
            _ => self.geometry(std::str::from_utf8(line).map_err(|_| "not text in UTF-8")?)?,
        }
        Ok(())
    }

    fn geometry(&mut self, line: &str) -> Result<(), String> {
        let mut words = line.split_ascii_whitespace();
        match words.next() {
            Some("v") => {
                self.positions = counted(self.positions, "vertices")?;
                // Six numbers and more are a position and a colour.
                let has_colour = words.clone().nth(5).is_some();
                self.write("v", words.take(if has_colour { 3 } else { usize::MAX }));
            }
            Some("vn") => {
                self.normals = counted(self.normals, "normals")?;
                self.write("vn", words);
            }
            Some("f") => self.face(&words.collect::<Vec<_>>())?,
            Some(keyword) if self.unknown.len() < MAX_UNKNOWN => {
                self.unknown.entry(excerpt(keyword)).or_insert(self.lines.number);
            }
            _ => {}
        }
        Ok(())
    }

    fn face(&mut self, corners: &[&str]) -> Result<(), String> {
        if corners.len() < 3 {
            return Ok(());
        }
        self.triangles += corners.len() - 2;
        if self.triangles > self.max_triangles {
            return Err(read::too_many_triangles(self.max_triangles));
        }
        let corners = corners.iter().map(|corner| self.corner(corner));
        let mut corners: Vec<(usize, usize)> = corners.collect::<Result<_, _>>()?;
        polygon::rotate_to_first(&mut corners);
        if self.ended {
            self.object()?;
        }
        self.out.push(b'f');
        for (position, normal) in corners {
            // Into memory, which does not fail.
            let _ = write!(self.out, " {position}//{normal}");
        }
        self.out.push(b'\n');
        Ok(())
    }

    fn object(&mut self) -> Result<(), String> {
        if self.objects == MAX_OBJECTS {
            return Err(format!("more than {MAX_OBJECTS} objects; at most that is read"));
        }
        self.objects += 1;
        self.ended = false;
        self.write("o", ["object"].into_iter());
        Ok(())
    }

    /// Indices of the position and the normal of `v`, `v/vt`, `v//vn` or `v/vt/vn`.
    fn corner(&self, text: &str) -> Result<(usize, usize), String> {
        let mut parts = text.split('/');
        let position = parts.next().unwrap_or_default();
        let normal = parts.nth(1).filter(|normal| !normal.is_empty());
        if parts.next().is_some() {
            return Err(format!("`{}` is no corner of a face", excerpt(text)));
        }
        let normal = normal.map(|normal| Ok(NO_NORMAL + index(normal, self.normals)?));
        Ok((index(position, self.positions)?, normal.unwrap_or(Ok::<_, String>(NO_NORMAL))?))
    }

    fn write<'w>(&mut self, keyword: &str, words: impl Iterator<Item = &'w str>) {
        self.out.extend_from_slice(keyword.as_bytes());
        for word in words {
            self.out.push(b' ');
            self.out.extend_from_slice(word.as_bytes());
        }
        self.out.push(b'\n');
    }
}

/// One more of what is counted, within what is read.
fn counted(count: usize, what: &str) -> Result<usize, String> {
    if count == MAX_VERTICES {
        return Err(format!("more than {MAX_VERTICES} {what}; at most that is read"));
    }
    Ok(count + 1)
}

/// An index from 1; a negative one counts back from the last that was read. What a positive one names may follow later.
fn index(text: &str, count: usize) -> Result<usize, String> {
    let number: i64 = text.parse().map_err(|_| format!("`{}` is no index", excerpt(text)))?;
    let index = match number {
        1.. => number,
        _ => number.saturating_add(count as i64 + 1),
    };
    match usize::try_from(index) {
        Ok(index @ 1..=MAX_VERTICES) if number != 0 => Ok(index),
        _ => Err(format!("index {number} is out of bounds: there are {count}")),
    }
}

impl Read for Statements<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.fill_buf()?.read(buffer)?;
        self.consume(read);
        Ok(read)
    }
}

impl BufRead for Statements<'_> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        if self.taken == self.out.len() {
            self.advance().map_err(|fault| {
                self.fault = Some(fault);
                io::Error::from(io::ErrorKind::InvalidData)
            })?;
        }
        Ok(&self.out[self.taken..])
    }

    fn consume(&mut self, bytes: usize) {
        self.taken += bytes;
    }
}

/// One vertex per pair of position and normal; where that cannot be used one per position, for smooth surfaces.
fn convert(source: &tobj::Mesh) -> Mesh {
    let (positions, _) = source.positions.as_chunks::<3>();
    let (normals, _) = source.normals.as_chunks::<3>();
    let unit = |normal: u32| Vec3::from(normals[normal as usize]).as_dvec3().try_normalize();
    let mut mesh = Mesh::default();
    let mut known = HashMap::new();
    let corners = source.indices.iter().zip(&source.normal_indices).map(|(&position, &normal)| {
        let unit = unit(normal);
        *known.entry((position, unit.map(|_| normal))).or_insert_with(|| {
            mesh.positions.push(positions[position as usize]);
            mesh.normals.push(unit.unwrap_or_default().as_vec3().to_array());
            mesh.positions.len() as u32 - 1
        })
    });
    let corners = corners.collect();
    mesh.indices = polygon::triangles(&mesh.positions, corners, &source.face_arities);
    mesh.complete_normals();
    mesh
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_unknown_keyword_is_named_once() {
        let text = "V 0 0 0\nv 0 0 0\nv 1 0 0 # V\nv 0 1 0\nsurf 1\nV 1\nf 1 2 3\n#V\nsurf 2\ns off\nl 1 2\n";
        let mut notes = Vec::new();
        read(&mut text.as_bytes(), 1, &mut notes).unwrap();
        let told = "line 1: lines that start with `V` are not read, line 5: lines that start with `surf` are not read";
        assert_eq!(notes.join(", "), told);
    }
}
