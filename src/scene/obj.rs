//! OBJ files, plain or compressed by gzip: vertices, normals and faces. Materials, texture coordinates, lines and points are left aside.

use std::collections::HashMap;

use super::Mesh;
use super::read::{self, MAX_VERTICES, Source};
use fathom_base::input::{LineEnd, Lines};

/// Longest line that is read, bytes.
const MAX_LINE: usize = 1 << 16;

/// Reads all objects of an OBJ file of at most `triangles` into one mesh. Polygons are cut into triangles, and normals are computed
/// for faces that have none.
pub fn read(source: Source, triangles: usize) -> Result<Mesh, String> {
    let mut lines = Lines::new(source, MAX_LINE);
    let mut objects = Objects { most_triangles: triangles, ..Objects::default() };
    let before = |what, line| format!("{what} in the object before line {line}");
    loop {
        let face = match lines.advance() {
            Ok(None) => break,
            Ok(Some(LineEnd::TooLong)) => Err(format!("longer than {MAX_LINE} bytes")),
            Ok(Some(LineEnd::Newline | LineEnd::File)) => objects.statement(&lines.line),
            Err(error) => Err(error.to_string()),
        };
        let face = face.map_err(|what| format!("line {}: {what}", lines.number))?;
        objects.add(&face).map_err(|what| before(what, lines.number))?;
    }
    if lines.number == 1 {
        return Err("the file is empty".into());
    }
    objects.end().map_err(|what| before(what, lines.number))?;
    Ok(objects.mesh)
}

/// Indices of a position and a normal, from 1; a normal of 0: none.
type Corner = (u32, u32);

/// What was read so far.
#[derive(Default)]
struct Objects {
    positions: Vec<[f32; 3]>,
    normals: Vec<[f32; 3]>,
    triangles: usize,
    most_triangles: usize,
    /// Three for each triangle of the object that is read. What they name may follow within the object.
    corners: Vec<Corner>,
    /// Whether its faces have normals.
    has_normals: bool,
    /// The next face starts an object.
    ended: bool,
    /// The objects before.
    mesh: Mesh,
}

impl Objects {
    /// The corners of a face; none of another statement.
    fn statement(&mut self, line: &[u8]) -> Result<Vec<Corner>, String> {
        let keyword = line.split(u8::is_ascii_whitespace).find(|word| !word.is_empty());
        match keyword.unwrap_or_default() {
            b"o" | b"g" => self.ended = true,
            // Names and remarks may be in any encoding.
            b"" | b"usemtl" | b"mtllib" | b"vt" | b"l" | b"p" | b"s" => {}
            word if word.starts_with(b"#") => {}
            _ => return self.geometry(std::str::from_utf8(line).map_err(|_| "not text in UTF-8")?),
        }
        Ok(Vec::new())
    }

    fn geometry(&mut self, line: &str) -> Result<Vec<Corner>, String> {
        let words: Vec<&str> = line.split_whitespace().collect();
        match &words[..] {
            ["v", numbers @ ..] => {
                counted(&self.positions, "vertices")?;
                self.positions.push(position(numbers)?);
            }
            ["vn", numbers @ ..] => {
                counted(&self.normals, "normals")?;
                self.normals.push(three(numbers).ok_or("normal parse error")?);
            }
            ["f", corners @ ..] if corners.len() > 2 => {
                self.triangles += corners.len() - 2;
                if self.triangles > self.most_triangles {
                    return Err(read::too_many_triangles(self.most_triangles));
                }
                return corners.iter().map(|corner| self.corner(corner)).collect();
            }
            _ => {}
        }
        Ok(Vec::new())
    }

    /// Of `v`, `v/vt`, `v//vn` or `v/vt/vn`.
    fn corner(&self, text: &str) -> Result<Corner, String> {
        let mut parts = text.split('/');
        let position = parts.next().unwrap_or_default();
        let normal = parts.nth(1).filter(|normal| !normal.is_empty());
        if parts.next().is_some() {
            return Err(format!("`{}` is no corner of a face", read::clipped(text)));
        }
        let normal = normal.map(|normal| index(normal, self.normals.len())).transpose()?;
        Ok((index(position, self.positions.len())?, normal.unwrap_or(0)))
    }

    /// Adds a face as a fan of triangles. An object ends where faces begin or cease to have normals, too.
    fn add(&mut self, face: &[Corner]) -> Result<(), &'static str> {
        let [first, others @ ..] = face else { return Ok(()) };
        let has_normals = face.iter().all(|(_, normal)| *normal > 0);
        if self.ended || self.has_normals != has_normals {
            self.end()?;
            (self.ended, self.has_normals) = (false, has_normals);
        }
        self.corners.extend(others.windows(2).flat_map(|pair| [*first, pair[0], pair[1]]));
        Ok(())
    }

    /// Moves the object to the mesh: a vertex for each pair of position and normal; without normals one for each position, for
    /// smooth surfaces.
    fn end(&mut self) -> Result<(), &'static str> {
        let mut object = Mesh::default();
        let mut known = HashMap::new();
        for (position, normal) in self.corners.drain(..) {
            let normal = if self.has_normals { normal } else { 0 };
            let next = object.positions.len() as u32;
            let index = *known.entry((position, normal)).or_insert(next);
            object.indices.push(index);
            if index < next {
                continue;
            }
            let place = self.positions.get(position as usize - 1);
            object.positions.push(*place.ok_or("face vertex index out of bounds")?);
            if self.has_normals {
                let normal = self.normals.get(normal as usize - 1);
                object.normals.push(*normal.ok_or("face normal index out of bounds")?);
            }
        }
        drop(known);
        if !self.has_normals {
            object.recompute_normals();
        }
        self.mesh.append(&object);
        Ok(())
    }
}

/// Whether one more is read.
fn counted(read: &[[f32; 3]], what: &str) -> Result<(), String> {
    if read.len() == MAX_VERTICES {
        return Err(format!("more than {MAX_VERTICES} {what}; at most that is read"));
    }
    Ok(())
}

/// x, y and z, divided by w where that is given; a colour is left aside.
fn position(numbers: &[&str]) -> Result<[f32; 3], &'static str> {
    let place = three(numbers).ok_or("position parse error")?;
    match numbers[3..] {
        [] | [_, _, _] => Ok(place),
        [w] => match w.parse::<f32>() {
            Ok(0.0) => Err("scaling (w) by zero"),
            Ok(w) => Ok(place.map(|c| c / w)),
            Err(_) => Err("position parse error"),
        },
        _ => Err("color parse error (too many or too few components)"),
    }
}

fn three(numbers: &[&str]) -> Option<[f32; 3]> {
    let numbers: Vec<f32> =
        numbers.iter().map_while(|number| number.parse().ok()).take(3).collect();
    numbers.try_into().ok()
}

/// An index from 1; a negative one counts back from the last that was read. What a positive one names may follow later.
fn index(text: &str, count: usize) -> Result<u32, String> {
    let number: i64 = text.parse().map_err(|_| format!("`{}` is no index", read::clipped(text)))?;
    let index = match number {
        1.. => number,
        _ => number.saturating_add(count as i64 + 1),
    };
    match usize::try_from(index) {
        Ok(index @ 1..=MAX_VERTICES) if number != 0 => Ok(index as u32),
        _ => Err(format!("index {number} is out of bounds: there are {count}")),
    }
}
