//! ASCII PLY files, plain or compressed by gzip: vertices with x, y, z and faces as index lists.

use std::io::{self, BufRead, Read};
use std::str::{FromStr, SplitAsciiWhitespace};

use super::read::{self, FileReader, MAX_TRIANGLES, MAX_VERTICES};
use super::{Mesh, polygon};
use fathom_base::text::excerpt;

/// Longest line that is read, bytes.
const MAX_LINE: u64 = 1 << 16;

/// Most lines of a header.
const MAX_HEADER: usize = 1000;

/// Reads the vertices and faces of an ASCII PLY file of at most `triangles`; other elements are skipped.
pub fn read(source: FileReader, triangles: usize, _: &mut Vec<String>) -> Result<Mesh, String> {
    let mut lines =
        LineReader { source, triangles, remaining: triangles, number: 0, line: String::new() };
    let elements = header(&mut lines)?;
    let (mut positions, mut corners, mut counts) = (Vec::new(), Vec::new(), Vec::new());
    for element in &elements {
        for index in 0..element.count {
            lines.next(|| format!("{} {index} of {}", element.name, element.count))?;
            match element.name.as_str() {
                "vertex" => positions.push(lines.vertex(element)?),
                "face" => {
                    let mut face = lines.face()?;
                    counts.push(face.len() as u32);
                    corners.append(&mut face);
                }
                _ => {}
            }
        }
    }
    // To the end of the archive, whose checksum stands there.
    io::copy(&mut lines.source, &mut io::sink())
        .map_err(|e| format!("{e}, after the last element"))?;
    let count = positions.len();
    if let Some(bad) = corners.iter().find(|i| **i as usize >= count) {
        return Err(format!("a face uses vertex {bad}, but there are {count}"));
    }
    let indices = polygon::triangles(&positions, corners, &counts);
    Ok(Mesh::smooth(positions, indices))
}

/// An element of the header: so many lines, each with these properties.
struct Element {
    name: String,
    count: usize,
    properties: Vec<Property>,
}

struct Property {
    name: String,
    list: bool,
}

impl Element {
    fn place(&self, name: &str) -> Option<usize> {
        self.properties.iter().position(|p| p.name == name)
    }
}

fn header(lines: &mut LineReader) -> Result<Vec<Element>, String> {
    let within = || "the header".to_owned();
    lines.next(within)?;
    if lines.line.trim() != "ply" {
        return Err(lines.fault("a PLY file starts with the line `ply`"));
    }
    let mut elements = Vec::new();
    for _ in 0..MAX_HEADER {
        lines.next(within)?;
        let line = std::mem::take(&mut lines.line);
        let words: Vec<&str> = line.split_ascii_whitespace().collect();
        match words[..] {
            ["format", "ascii", _] | ["comment" | "obj_info", ..] | [] => {}
            ["format", other, ..] => {
                return Err(lines.fault(format!("format {other}: only ascii is read")));
            }
            ["element", name, count] => elements.push(element(lines, name, count)?),
            ["property", .., name] => {
                let element = elements.last_mut();
                let element =
                    element.ok_or_else(|| lines.fault("a property before the first element"))?;
                let list = words[1] == "list";
                element.properties.push(Property { name: name.to_owned(), list });
            }
            ["end_header"] => return complete(lines, elements),
            _ => return Err(lines.fault("not a line of a PLY header")),
        }
    }
    Err(lines.fault(format!("no end_header within {MAX_HEADER} lines")))
}

fn element(lines: &LineReader, name: &str, count: &str) -> Result<Element, String> {
    let most = if name == "vertex" { MAX_VERTICES } else { MAX_TRIANGLES };
    match count.parse::<usize>() {
        Ok(count) if count <= most => {
            Ok(Element { name: name.to_owned(), count, properties: Vec::new() })
        }
        _ => Err(lines.fault(format!("element {name} {count}: at most {most} are read"))),
    }
}

/// Checks that the header declares what a mesh needs.
fn complete(lines: &LineReader, elements: Vec<Element>) -> Result<Vec<Element>, String> {
    let of = |name: &str| elements.iter().find(|e| e.name == name);
    let plain = |e: &Element, name: &str| e.place(name).is_some_and(|i| !e.properties[i].list);
    let vertex = of("vertex").is_some_and(|e| {
        ["x", "y", "z"].iter().all(|axis| plain(e, axis)) && e.properties.iter().all(|p| !p.list)
    });
    let face = of("face").is_some_and(|e| e.properties.first().is_some_and(|p| p.list));
    if vertex && face {
        Ok(elements)
    } else {
        Err(lines.fault(
            "the header must declare element vertex with x, y, z and element face that starts with an index list",
        ))
    }
}

/// The lines of a file, counted.
struct LineReader {
    source: FileReader,
    /// Most that are read, and how many of them are left.
    triangles: usize,
    remaining: usize,
    /// Of `line`, from 1.
    number: usize,
    line: String,
}

impl LineReader {
    /// Reads the next line that is not blank; `wanted` names what it should hold.
    fn next(&mut self, wanted: impl Fn() -> String) -> Result<(), String> {
        loop {
            self.number += 1;
            self.line.clear();
            let read = (&mut self.source)
                .take(MAX_LINE)
                .read_line(&mut self.line)
                .map_err(|e| self.fault(format!("{e}, reading {}", wanted())))?;
            if read as u64 == MAX_LINE && !self.line.ends_with('\n') {
                return Err(self.fault(format!("longer than {MAX_LINE} bytes")));
            }
            if read == 0 {
                return Err(self.fault(format!("the file ends before {}", wanted())));
            }
            if !self.line.trim().is_empty() {
                return Ok(());
            }
        }
    }

    fn vertex(&self, element: &Element) -> Result<[f32; 3], String> {
        let mut position = [f32::NAN; 3];
        let mut words = self.line.split_ascii_whitespace();
        for property in &element.properties {
            let value = self.number_in::<f32>(&mut words)?;
            if let Some(axis) = ["x", "y", "z"].iter().position(|a| *a == property.name) {
                position[axis] = value;
            }
        }
        if !position.iter().all(|c| c.is_finite()) {
            return Err(self.fault("a coordinate is not finite"));
        }
        Ok(position)
    }

    /// The corners of a face.
    fn face(&mut self) -> Result<Vec<u32>, String> {
        let mut words = self.line.split_ascii_whitespace();
        let count = self.number_in::<usize>(&mut words)?;
        if count < 3 {
            return Err(self.fault(format!("a face of {count} corners")));
        }
        let remaining = self.remaining.checked_sub(count - 2);
        let remaining =
            remaining.ok_or_else(|| self.fault(read::too_many_triangles(self.triangles)))?;
        let corners = (0..count).map(|_| self.number_in::<u32>(&mut words));
        let mut corners: Vec<u32> = corners.collect::<Result<_, _>>()?;
        polygon::rotate_to_first(&mut corners);
        self.remaining = remaining;
        Ok(corners)
    }

    fn number_in<T: FromStr>(&self, words: &mut SplitAsciiWhitespace) -> Result<T, String> {
        let word = words.next().ok_or_else(|| self.fault("the line has too few numbers"))?;
        word.parse()
            .map_err(|_| self.fault(format!("`{}` is not a valid number here", excerpt(word))))
    }

    fn fault(&self, what: impl AsRef<str>) -> String {
        format!("line {}: {}", self.number, what.as_ref())
    }
}
