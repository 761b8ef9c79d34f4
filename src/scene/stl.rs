//! STL files, ASCII and binary. Corners at one place are one vertex. The normals of facets are not read: they follow from the triangles.

use std::collections::HashMap;
use std::io::Read;

use super::Mesh;
use super::read::{self, LineReader, MAX_VERTICES};
use fathom_base::input::BYTE_ORDER_MARK;
use fathom_base::text::excerpt;

/// Bytes before the triangles of a binary file, and of one triangle.
const HEADER: usize = 84;
const TRIANGLE: usize = 50;
/// Bytes by which the two kinds are told apart: binary files may begin with `solid` too.
const START: u64 = 1024;

/// Reads the triangles of a file, of at most `triangles`.
pub fn read(
    file: &mut dyn Read,
    triangles: usize,
    notes: &mut Vec<String>,
) -> Result<Mesh, String> {
    let mut start = Vec::new();
    file.take(START).read_to_end(&mut start).map_err(|error| error.to_string())?;
    let words = String::from_utf8_lossy(&start).to_ascii_lowercase();
    let is_solid = words.trim_start_matches(BYTE_ORDER_MARK).trim_start().starts_with("solid");
    let is_text = is_solid && (words.contains("facet") || words.contains("endsolid"));
    let mut facets = Facets { triangles, ..Facets::default() };
    let mut file = start.chain(file);
    if is_text {
        let mut lines = LineReader::new(&mut file)?;
        let read = facets.read_text(&mut lines);
        read.map_err(|what| format!("line {}: {what}", lines.number))?;
    } else {
        facets.read_binary(&mut file, notes)?;
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
    /// Most that are read.
    triangles: usize,
}

impl Facets {
    fn add(&mut self, position: [f32; 3]) -> Result<(), String> {
        if self.corners.len() == self.triangles.saturating_mul(3) {
            return Err(read::too_many_triangles(self.triangles));
        }
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

    fn read_binary(&mut self, file: &mut dyn Read, notes: &mut Vec<String>) -> Result<(), String> {
        let mut start = [0; HEADER];
        let header = file.read_exact(&mut start);
        header.map_err(|error| format!("{error}, reading the header of a binary STL file"))?;
        let count = u32::from_le_bytes([80, 81, 82, 83].map(|at| start[at]));
        let mut has_attributes = false;
        for number in 0..count {
            let mut facet = [0; TRIANGLE];
            let read = file.read_exact(&mut facet);
            read.map_err(|error| format!("{error}, reading triangle {number} of {count}"))?;
            // Behind the normal.
            for corner in facet[12..48].chunks(12) {
                let number = |at: usize| f32::from_le_bytes([0, 1, 2, 3].map(|i| corner[at + i]));
                self.add([0, 4, 8].map(number))?;
            }
            has_attributes |= facet[48..] != [0; 2];
        }
        notes.extend(has_attributes.then(|| "colours of triangles are not read".to_owned()));
        Ok(())
    }

    fn read_text(&mut self, lines: &mut LineReader<'_>) -> Result<(), String> {
        while lines.next()? {
            self.read_line(&String::from_utf8_lossy(&lines.line))?;
        }
        let is_whole = self.corners.len().is_multiple_of(3);
        is_whole.then_some(()).ok_or_else(|| "the file ends within a facet".to_owned())
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
            // Some write `end solid`.
            "endloop" | "end" if !self.corners.len().is_multiple_of(3) => {
                Err("a facet has three corners".to_owned())
            }
            "" | "solid" | "facet" | "outer" | "endloop" | "endfacet" | "endsolid" | "end" => {
                Ok(())
            }
            other => Err(format!("`{}` begins no line of an STL file", excerpt(other))),
        }
    }
}
