//! STL files, ASCII and binary. Corners at one place are one vertex. The normals of facets are not read: they follow from the triangles.

use std::collections::HashMap;
use std::io::{self, Cursor, Read};

use super::Mesh;
use super::read::{self, MAX_VERTICES, text_of};
use fathom_base::input::{BYTE_ORDER_MARK, LineEnd, next_line};
use fathom_base::text::excerpt;

/// Bytes before the triangles of a binary file, and of one triangle.
const HEADER: usize = 84;
const TRIANGLE: usize = 50;
/// Bytes by which the two kinds are told apart: binary files may begin with `solid` too.
const START: u64 = 1024;
/// Longest line of an ASCII file, bytes.
const MAX_LINE: usize = 1 << 12;

/// Reads the triangles of a file, of at most `triangles`.
pub fn read(
    mut file: Box<dyn Read>,
    triangles: usize,
    notes: &mut Vec<String>,
) -> Result<Mesh, String> {
    let mut start = Vec::new();
    (&mut file).take(START).read_to_end(&mut start).map_err(|error| error.to_string())?;
    let words = String::from_utf8_lossy(&start).to_ascii_lowercase();
    let is_solid = words.trim_start_matches(BYTE_ORDER_MARK).trim_start().starts_with("solid");
    let is_text = is_solid && (words.contains("facet") || words.contains("endsolid"));
    let mut facets = Facets { most_corners: triangles.saturating_mul(3), ..Facets::default() };
    let file = Box::new(Cursor::new(start).chain(file));
    if is_text {
        facets.read_text(file)?;
    } else {
        facets.read_binary(file, notes).map_err(|error| error.to_string())?;
    }
    if facets.corners.len() > facets.most_corners {
        return Err(read::too_many_triangles(triangles));
    }
    Ok(Mesh::smooth(facets.positions, facets.corners))
}

#[derive(Default)]
struct Facets {
    /// The vertex at a place, by the bits of its coordinates.
    known: HashMap<[u32; 3], u32>,
    positions: Vec<[f32; 3]>,
    /// Three of each triangle.
    corners: Vec<u32>,
    most_corners: usize,
}

impl Facets {
    fn add(&mut self, position: [f32; 3]) -> Result<(), String> {
        // −0 is 0.
        let position = position.map(|c| c + 0.0);
        let next = self.positions.len();
        let vertex = *self.known.entry(position.map(f32::to_bits)).or_insert(next as u32);
        if next == MAX_VERTICES && vertex as usize == next {
            return Err(format!("more than {MAX_VERTICES} vertices; at most that is read"));
        }
        self.positions.extend((vertex as usize == next).then_some(position));
        self.corners.push(vertex);
        Ok(())
    }

    fn read_binary(&mut self, mut file: impl Read, notes: &mut Vec<String>) -> io::Result<()> {
        let ended =
            |what: String| move |error| io::Error::other(format!("{error}, reading {what}"));
        let mut start = [0; HEADER];
        file.read_exact(&mut start).map_err(ended("the header of a binary STL file".to_owned()))?;
        let count = u32::from_le_bytes([80, 81, 82, 83].map(|at| start[at]));
        let mut has_attributes = false;
        for number in 0..count {
            let mut facet = [0; TRIANGLE];
            let what = format!("triangle {number} of {count}");
            file.read_exact(&mut facet).map_err(ended(what))?;
            // Behind the normal.
            for corner in facet[12..48].chunks(12) {
                let number = |at: usize| f32::from_le_bytes([0, 1, 2, 3].map(|i| corner[at + i]));
                self.add([0, 4, 8].map(number)).map_err(io::Error::other)?;
            }
            has_attributes |= facet[48..] != [0; 2];
            if self.corners.len() > self.most_corners {
                return Ok(());
            }
        }
        notes.extend(has_attributes.then(|| "colours of triangles are not read".to_owned()));
        // To the end of the archive, whose checksum stands there.
        io::copy(&mut file, &mut io::sink()).map(drop)
    }

    fn read_text(&mut self, file: Box<dyn Read>) -> Result<(), String> {
        let mut source = text_of(file).map_err(|error| error.to_string())?;
        let mut line = Vec::new();
        for number in 1.. {
            let fault = |what: String| format!("line {number}: {what}");
            let end = next_line(&mut source, MAX_LINE, &mut line);
            match end.map_err(|error| fault(error.to_string()))? {
                Some(LineEnd::TooLong) => {
                    return Err(fault(format!("longer than {MAX_LINE} bytes")));
                }
                Some(_) => self.read_line(&String::from_utf8_lossy(&line)).map_err(fault)?,
                None if !self.corners.len().is_multiple_of(3) => {
                    return Err(fault("the file ends within a facet".to_owned()));
                }
                None => break,
            }
            if self.corners.len() > self.most_corners {
                break;
            }
        }
        Ok(())
    }

    fn read_line(&mut self, line: &str) -> Result<(), String> {
        let mut words = line.split_ascii_whitespace();
        let keyword = words.next().unwrap_or_default().to_ascii_lowercase();
        match keyword.as_str() {
            "vertex" => {
                let numbers: Vec<f32> = words.filter_map(|word| word.parse().ok()).collect();
                let position = numbers.try_into().map_err(|_| "a vertex has three coordinates")?;
                self.add(position)
            }
            "endloop" if !self.corners.len().is_multiple_of(3) => {
                Err("a facet has three corners".to_owned())
            }
            "" | "solid" | "facet" | "outer" | "endloop" | "endfacet" | "endsolid" => Ok(()),
            other => Err(format!("`{}` begins no line of an STL file", excerpt(other))),
        }
    }
}
