//! OBJ files, plain or compressed by gzip, read by `tobj`.
//!
//! `tobj` keeps every face and object, whether or not it holds a triangle, and computes with indices before it checks them. So
//! lines reach it through [`Statements`], which passes on what a mesh needs, within limits.

use std::collections::HashMap;
use std::io::{self, BufRead, Read};

use tobj::{LoadError, LoadOptions};

use super::Mesh;
use super::read::{self, MAX_VERTICES, Source};
use fathom_base::input::{LineEnd, next_line};

/// Longest line that is read, bytes.
const MAX_LINE: usize = 1 << 16;

/// Most objects and groups that hold triangles. Each takes `tobj` about half a kilobyte.
const MAX_OBJECTS: usize = 100_000;

/// Reads all objects of an OBJ file of at most `triangles` into one mesh. Polygons are cut into triangles, materials are left
/// aside, and normals are computed for faces that have none.
pub fn read(source: Source, triangles: usize) -> Result<Mesh, String> {
    let mut statements = Statements::new(source, triangles);
    let options = LoadOptions { triangulate: true, ..LoadOptions::default() };
    let no_materials = |_: &std::path::Path| Ok((Vec::new(), Default::default()));
    let loaded = tobj::load_obj_buf(&mut statements, &options, no_materials);
    let (models, _) = loaded.map_err(|fault| malformed(&statements, fault))?;
    if statements.number == 1 {
        return Err("the file is empty".into());
    }
    let mut mesh = Mesh::default();
    for (model, has_normals) in models.iter().zip(&statements.objects) {
        mesh.append(&convert(&model.mesh, *has_normals));
    }
    Ok(mesh)
}

fn malformed<R>(statements: &Statements<R>, fault: LoadError) -> String {
    let line = statements.number;
    match (&statements.fault, fault) {
        (Some(what), _) => format!("line {line}: {what}"),
        // Found when an object ends, so the line would mislead.
        (None, fault @ (LoadError::FaceVertexOutOfBounds | LoadError::FaceNormalOutOfBounds)) => {
            format!("{fault} in the object before line {line}")
        }
        (None, fault) => format!("line {line}: {fault}"),
    }
}

/// The lines of a file that describe geometry, as `tobj` is to read them: coordinates without colours, faces of three corners
/// and more with indices that count from 1, and a new object wherever one with faces has ended.
struct Statements<R> {
    source: R,
    line: Vec<u8>,
    /// Of the line, from 1.
    number: usize,
    /// What is passed on of the line, and how much of it was taken.
    out: Vec<u8>,
    taken: usize,
    positions: usize,
    normals: usize,
    triangles: usize,
    most_triangles: usize,
    /// Whether its faces have normals, of each object passed on.
    objects: Vec<bool>,
    /// The next face starts an object.
    ended: bool,
    /// Why reading stopped.
    fault: Option<String>,
}

impl<R: BufRead> Statements<R> {
    fn new(source: R, most_triangles: usize) -> Self {
        Self {
            source,
            line: Vec::new(),
            number: 0,
            out: Vec::new(),
            taken: 0,
            positions: 0,
            normals: 0,
            triangles: 0,
            most_triangles,
            objects: Vec::new(),
            ended: true,
            fault: None,
        }
    }

    /// Reads lines up to one that is passed on; false at the end of the file.
    fn advance(&mut self) -> Result<bool, String> {
        self.out.clear();
        self.taken = 0;
        while self.out.is_empty() {
            self.number += 1;
            let read = next_line(&mut self.source, MAX_LINE, &mut self.line);
            match read.map_err(|error| error.to_string())? {
                None => return Ok(false),
                Some(LineEnd::TooLong) => return Err(format!("longer than {MAX_LINE} bytes")),
                Some(LineEnd::Newline | LineEnd::File) => {}
            }
            let line = std::mem::take(&mut self.line);
            let passed = self.statement(&line);
            self.line = line;
            passed?;
        }
        Ok(true)
    }

    fn statement(&mut self, line: &[u8]) -> Result<(), String> {
        let mut words = line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
        let Some(keyword) = words.next() else {
            return Ok(());
        };
        match keyword {
            b"o" | b"g" => self.ended = true,
            // Names and remarks may be in any encoding.
            b"usemtl" | b"mtllib" | b"vt" | b"l" | b"p" | b"s" => {}
            _ if keyword.starts_with(b"#") => {}
            _ => self.geometry(std::str::from_utf8(line).map_err(|_| "not text in UTF-8")?)?,
        }
        Ok(())
    }

    fn geometry(&mut self, line: &str) -> Result<(), String> {
        let words: Vec<&str> = line.split_ascii_whitespace().collect();
        match words[..] {
            ["v", ..] => {
                self.positions = counted(self.positions, "vertices")?;
                // Six numbers are a position and a colour.
                self.put(if words.len() == 7 { &words[..4] } else { &words });
            }
            ["vn", ..] => {
                self.normals = counted(self.normals, "normals")?;
                self.put(&words);
            }
            ["f", _, _, _, ..] => self.face(&words[1..])?,
            _ => {}
        }
        Ok(())
    }

    fn face(&mut self, corners: &[&str]) -> Result<(), String> {
        self.triangles += corners.len() - 2;
        if self.triangles > self.most_triangles {
            return Err(read::too_many_triangles(self.most_triangles));
        }
        let corners = corners.iter().map(|corner| self.corner(corner));
        let corners: Vec<(usize, Option<usize>)> = corners.collect::<Result<_, _>>()?;
        let has_normals = corners.iter().all(|(_, normal)| normal.is_some());
        if self.ended || self.objects.last() != Some(&has_normals) {
            self.object(has_normals)?;
        }
        self.out.push(b'f');
        for (position, normal) in corners {
            let text = match normal {
                Some(normal) if has_normals => format!(" {position}//{normal}"),
                _ => format!(" {position}"),
            };
            self.out.extend_from_slice(text.as_bytes());
        }
        self.out.push(b'\n');
        Ok(())
    }

    fn object(&mut self, has_normals: bool) -> Result<(), String> {
        if self.objects.len() == MAX_OBJECTS {
            return Err(format!("more than {MAX_OBJECTS} objects; at most that is read"));
        }
        self.objects.push(has_normals);
        self.ended = false;
        self.put(&["o", "object"]);
        Ok(())
    }

    /// Indices of the position and the normal of `v`, `v/vt`, `v//vn` or `v/vt/vn`.
    fn corner(&self, text: &str) -> Result<(usize, Option<usize>), String> {
        let mut parts = text.split('/');
        let position = parts.next().unwrap_or_default();
        let normal = parts.nth(1).filter(|normal| !normal.is_empty());
        if parts.next().is_some() {
            return Err(format!("`{}` is no corner of a face", read::clipped(text)));
        }
        let normal = normal.map(|normal| index(normal, self.normals));
        Ok((index(position, self.positions)?, normal.transpose()?))
    }

    fn put(&mut self, words: &[&str]) {
        self.out.extend_from_slice(words.join(" ").as_bytes());
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
    let number: i64 = text.parse().map_err(|_| format!("`{}` is no index", read::clipped(text)))?;
    let index = match number {
        1.. => number,
        _ => number.saturating_add(count as i64 + 1),
    };
    match usize::try_from(index) {
        Ok(index @ 1..=MAX_VERTICES) if number != 0 => Ok(index),
        _ => Err(format!("index {number} is out of bounds: there are {count}")),
    }
}

impl<R: BufRead> Read for Statements<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.fill_buf()?.read(buffer)?;
        self.consume(read);
        Ok(read)
    }
}

impl<R: BufRead> BufRead for Statements<R> {
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

/// One vertex per pair of position and normal; without normals one per position, for smooth surfaces.
fn convert(source: &tobj::Mesh, has_normals: bool) -> Mesh {
    let (positions, _) = source.positions.as_chunks::<3>();
    let (normals, _) = source.normals.as_chunks::<3>();
    if !has_normals {
        return Mesh::smooth(positions.to_vec(), source.indices.clone());
    }
    let mut mesh = Mesh::default();
    let mut known = HashMap::new();
    for (&position, &normal) in source.indices.iter().zip(&source.normal_indices) {
        let index = *known.entry((position, normal)).or_insert_with(|| {
            mesh.positions.push(positions[position as usize]);
            mesh.normals.push(normals[normal as usize]);
            mesh.positions.len() as u32 - 1
        });
        mesh.indices.push(index);
    }
    mesh
}
