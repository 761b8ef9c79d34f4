//! PLY files: vertices with x, y, z and faces as index lists. `ply-rs-bw` reads headers and binary elements. It refuses numbers in ASCII
//! that others write, such as `.5` and `nan`, so those are read here.

use std::io::{ErrorKind, Read};
use std::str::FromStr;

use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{
    ElementDef, Encoding, Header, Property, PropertyAccess, PropertyAccessResult, PropertyType,
};

use super::read::{self, LineReader, MAX_LINE, MAX_TRIANGLES, MAX_VERTICES};
use super::{Mesh, polygon};
use fathom_base::text::excerpt;

/// Most lines of a header.
const MAX_HEADER: usize = 1000;

const AXES: [&str; 3] = ["x", "y", "z"];

/// Reads the vertices and faces of a file of at most `triangles`; other elements are skipped.
pub fn read(file: &mut dyn Read, triangles: usize) -> Result<Mesh, String> {
    let mut lines = LineReader::new(file)?;
    let header = header(&mut lines)?;
    let (mut positions, mut corners, mut counts) = (Vec::new(), Vec::new(), Vec::new());
    let mut remaining = triangles;
    // Those without properties take no bytes, however many there are.
    for element in header.elements.values().filter(|element| !element.properties.is_empty()) {
        for number in 0..element.count {
            let fault = |what| format!("{} {number} of {}: {what}", element.name, element.count);
            let values = values(&mut lines, header.encoding, element).map_err(fault)?;
            match element.name.as_str() {
                "vertex" => positions.push(values.position),
                "face" => {
                    let mut face = values.corners(element).map_err(fault)?;
                    let left = remaining.checked_sub(face.len() - 2);
                    remaining = left.ok_or_else(|| read::too_many_triangles(triangles))?;
                    polygon::rotate_to_first(&mut face);
                    counts.push(face.len() as u32);
                    corners.append(&mut face);
                }
                _ => {}
            }
        }
    }
    let count = positions.len();
    if let Some(bad) = corners.iter().find(|i| **i as usize >= count) {
        return Err(format!("a face uses vertex {bad}, but there are {count}"));
    }
    let indices = polygon::triangles(&positions, corners, &counts);
    Ok(Mesh::smooth(positions, indices))
}

/// The header of a file of which no more is read. It declares what a mesh needs, within limits, and nothing twice: the last would count.
fn header(lines: &mut LineReader<'_>) -> Result<Header, String> {
    let text = header_text(lines).map_err(|what| format!("line {}: {what}", lines.number))?;
    let header = Parser::<ElementValues>::new().read_header(&mut Reader::new(text.as_bytes()));
    let header = header.map_err(|error| {
        let line = error.line().and_then(|number| text.lines().nth(number - 1));
        let what = error.to_string();
        let what = what.lines().next().unwrap_or_default();
        format!("{} `{}`", excerpt(what), excerpt(line.unwrap_or_default()))
    })?;
    let is_declaration = |line: &&str| line.starts_with("element") || line.starts_with("property");
    let elements = header.elements.values();
    let declared: usize = elements.clone().map(|element| 1 + element.properties.len()).sum();
    if text.lines().filter(is_declaration).count() != declared {
        return Err("its header declares an element or a property twice".to_owned());
    }
    for ElementDef { name, count, .. } in elements {
        let max = if name == "vertex" { MAX_VERTICES } else { MAX_TRIANGLES };
        if *count > max {
            return Err(format!("element {} {count}: at most {max} are read", excerpt(name)));
        }
    }
    let vertex = header.elements.get("vertex");
    let has = |axis: &&str| vertex.is_some_and(|vertex| vertex.properties.contains_key(*axis));
    if AXES.iter().all(has) && header.elements.contains_key("face") {
        return Ok(header);
    }
    Err("its header must declare element vertex with x, y, z, and element face".to_owned())
}

/// The lines of the header without blanks around them and what comments say, which may be in any encoding.
fn header_text(lines: &mut LineReader<'_>) -> Result<String, String> {
    let mut text = String::new();
    while !text.ends_with("end_header\n") {
        if !lines.next()? {
            return Err("the file ends within its header".to_owned());
        }
        let line = String::from_utf8_lossy(lines.line.trim_ascii());
        if lines.number == 1 && line != "ply" {
            return Err("a PLY file starts with the line `ply`".to_owned());
        }
        if lines.number > MAX_HEADER {
            return Err(format!("no end_header within {MAX_HEADER} lines"));
        }
        let word = line.split_ascii_whitespace().next().unwrap_or("comment");
        text += if ["comment", "obj_info"].contains(&word) { "comment" } else { &line };
        text += "\n";
    }
    Ok(text)
}

/// What a mesh needs of an element.
struct ElementValues {
    /// Of a vertex.
    position: [f32; 3],
    /// The lists in their order, each if it holds indices: one of them has the corners of a face.
    lists: Vec<Option<Vec<u32>>>,
}

impl PropertyAccess for ElementValues {
    fn new() -> Self {
        Self { position: [f32::NAN; 3], lists: Vec::new() }
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        match (property.to_f32_lossy(), AXES.iter().position(|axis| *axis == name)) {
            (Some(value), Some(axis)) => self.position[axis] = value,
            (Some(_), None) => {}
            (None, _) => self.lists.push(property.to_u32_list()),
        }
        PropertyAccessResult::Set
    }
}

impl ElementValues {
    /// The corners of a face: the list that the format has for them, or the first.
    fn corners(mut self, face: &ElementDef) -> Result<Vec<u32>, String> {
        let properties = face.properties.values();
        let mut lists = properties.filter(|p| matches!(p.data_type, PropertyType::List(..)));
        let place = lists.position(|list| list.name.starts_with("vertex_ind")).unwrap_or(0);
        let corners = self.lists.get_mut(place).and_then(Option::take);
        match corners.ok_or("it has no list of indices of vertices")? {
            corners if corners.len() < 3 => Err(format!("a face of {} corners", corners.len())),
            corners => Ok(corners),
        }
    }
}

/// Reads an element.
fn values(
    lines: &mut LineReader<'_>,
    encoding: Encoding,
    element: &ElementDef,
) -> Result<ElementValues, String> {
    let parser = Parser::new();
    let mut bytes = (&mut lines.source).take(MAX_LINE as u64);
    let read = match encoding {
        Encoding::BinaryLittleEndian => parser.read_little_endian_element(&mut bytes, element),
        Encoding::BinaryBigEndian => parser.read_big_endian_element(&mut bytes, element),
        Encoding::Ascii => {
            let values = ascii_values(lines, element);
            return values.map_err(|what| format!("line {}: {what}", lines.number));
        }
    };
    read.map_err(|error| match error.kind() {
        ErrorKind::UnexpectedEof if bytes.limit() == 0 => format!("longer than {MAX_LINE} bytes"),
        ErrorKind::UnexpectedEof => "the file ends within it".to_owned(),
        _ => error.to_string(),
    })
}

/// Reads an element from the next line that is not blank. Numbers that a mesh does not need may be anything.
fn ascii_values(lines: &mut LineReader<'_>, element: &ElementDef) -> Result<ElementValues, String> {
    loop {
        if !lines.next()? {
            return Err("the file ends before it".to_owned());
        }
        if !lines.line.trim_ascii().is_empty() {
            break;
        }
    }
    let line = String::from_utf8_lossy(&lines.line);
    let mut words = line.split_ascii_whitespace();
    let mut next = || words.next().ok_or("the line has too few numbers");
    let mut values = ElementValues::new();
    for property in element.properties.values() {
        let word = next()?;
        if let PropertyType::List(..) = property.data_type {
            let items = (0..number::<usize>(word)?).map(|_| next());
            let items = items.collect::<Result<Vec<&str>, _>>()?;
            values.lists.push(items.iter().map(|item| item.parse().ok()).collect());
        } else if let Some(axis) = AXES.iter().position(|axis| *axis == property.name) {
            values.position[axis] = number(word)?;
        }
    }
    Ok(values)
}

fn number<T: FromStr>(word: &str) -> Result<T, String> {
    word.parse().map_err(|_| format!("`{}` is not a valid number here", excerpt(word)))
}
