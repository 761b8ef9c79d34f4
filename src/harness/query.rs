//! `fathom query`: answers at the points of a CSV file.

use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

use glam::DVec3;
use thiserror::Error;

use super::subject::Subject;
use crate::gpu::{Gpu, GpuError};
use crate::input;
use crate::pipelines::volume_ao::{Params, occlusion_at};
use crate::stages::ao::query::{self, Point};

/// Columns that a file of points must have, in any order and among others.
const COLUMNS: [&str; 6] = ["x", "y", "z", "nx", "ny", "nz"];
/// The added column.
const ANSWER: &str = "occlusion";
/// Largest file of points, bytes: five million points of the shortest lines, which take 0.3 GiB.
const MAX_POINTS_FILE: u64 = 64 << 20;
/// Largest coordinate, metres, and largest component of a normal.
const FAR: f64 = 1e6;
/// Shorter normals have no direction in 32 bits.
const SHORT: f64 = 1e-6;

#[derive(Debug, Error)]
pub enum QueryError {
    #[error(transparent)]
    Gpu(#[from] GpuError),
    #[error("cannot read {}: {source}", path.display())]
    Read { path: PathBuf, source: io::Error },
    #[error("{}, {fault}", path.display())]
    Points { path: PathBuf, fault: PointFault },
    #[error("{0}")]
    Invalid(String),
    #[error("cannot write {target}: {source}")]
    Write { target: String, source: csv::Error },
}

/// What is wrong with a file of points.
#[derive(Debug, Error)]
pub enum PointFault {
    #[error("line 1: there is no column `{0}`: x, y, z, nx, ny and nz are needed")]
    Column(&'static str),
    #[error("line {line}, column `{column}`: `{}` is not a number within ±10⁶", input::one_line(.text))]
    Number {
        line: u64,
        column: &'static str,
        text: String,
    },
    #[error("line {line}, columns `nx`, `ny`, `nz`: a normal of length {length} has no direction")]
    Normal { line: u64, length: f64 },
    #[error("line {line} has {fields} fields, the header has {expected}")]
    Fields {
        line: u64,
        fields: u64,
        expected: u64,
    },
    #[error("line 2: there is no point")]
    Empty,
    #[error("{0}")]
    Csv(csv::Error),
}

/// A surface point as its file has it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    pub position_m: DVec3,
    /// Of any length.
    pub normal: DVec3,
}

/// The points of a CSV file with the columns x, y, z (metres) and nx, ny, nz; others are left aside.
///
/// # Errors
/// The first fault, with its line and column.
pub fn read(path: &Path) -> Result<Vec<Row>, QueryError> {
    let file = input::plain(path, MAX_POINTS_FILE).map_err(|source| QueryError::Read {
        path: path.to_owned(),
        source,
    })?;
    parse(file).map_err(|fault| QueryError::Points {
        path: path.to_owned(),
        fault,
    })
}

fn parse(text: impl Read) -> Result<Vec<Row>, PointFault> {
    let mut reader = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .from_reader(text);
    let header = reader.headers().map_err(fault)?.clone();
    let mut places = [0; COLUMNS.len()];
    for (place, column) in places.iter_mut().zip(COLUMNS) {
        let found = header.iter().position(|name| name == column);
        *place = found.ok_or(PointFault::Column(column))?;
    }
    let rows = reader
        .records()
        .map(|record| row(&record.map_err(fault)?, places));
    let rows = rows.collect::<Result<Vec<Row>, _>>()?;
    if rows.is_empty() {
        return Err(PointFault::Empty);
    }
    Ok(rows)
}

fn row(record: &csv::StringRecord, places: [usize; 6]) -> Result<Row, PointFault> {
    let line = record.position().map_or(0, csv::Position::line);
    let mut numbers = [0.0; COLUMNS.len()];
    for ((number, place), column) in numbers.iter_mut().zip(places).zip(COLUMNS) {
        let text = record.get(place).unwrap_or_default();
        let parsed = text.parse().ok().filter(|n: &f64| n.abs() <= FAR);
        *number = parsed.ok_or_else(|| PointFault::Number {
            line,
            column,
            text: text.to_owned(),
        })?;
    }
    let [x, y, z, nx, ny, nz] = numbers;
    let normal = DVec3::new(nx, ny, nz);
    if normal.length() < SHORT {
        let length = normal.length();
        return Err(PointFault::Normal { line, length });
    }
    Ok(Row {
        position_m: DVec3::new(x, y, z),
        normal,
    })
}

fn fault(error: csv::Error) -> PointFault {
    match error.kind() {
        csv::ErrorKind::UnequalLengths {
            pos: Some(position),
            expected_len,
            len,
        } => PointFault::Fields {
            line: position.line(),
            fields: *len,
            expected: *expected_len,
        },
        _ => PointFault::Csv(error),
    }
}

/// Ambient occlusion at each point by the volumes and rays of a subject of the pipeline `volume_ao`: 0 open … 1 closed.
///
/// # Errors
/// Limits of the adapter, named before anything is allocated, and what the GPU reports.
pub fn occlusion(gpu: &Gpu, subject: &Subject, rows: &[Row]) -> Result<Vec<f32>, QueryError> {
    let params = Params::from_value(&subject.params).map_err(QueryError::Invalid)?;
    let demand = (subject.kind.demand)(&subject.params, &subject.scene)
        .map_err(QueryError::Invalid)?
        .and(query::demand(rows.len() as u64));
    demand.check(&gpu.limits).map_err(QueryError::Invalid)?;
    let points: Vec<Point> = rows
        .iter()
        .map(|row| Point {
            position_m: row.position_m.as_vec3(),
            normal: row.normal.normalize().as_vec3(),
        })
        .collect();
    Ok(gpu.scoped(|| occlusion_at(gpu, &subject.scene, &params, &points))?)
}

/// Writes the points in their order with their occlusion; `target` names the writer in errors.
pub fn write(
    target: &str,
    writer: impl Write,
    rows: &[Row],
    occlusion: &[f32],
) -> Result<(), QueryError> {
    let mut csv = csv::Writer::from_writer(writer);
    let written = (|| {
        csv.write_record(COLUMNS.iter().chain([&ANSWER]))?;
        for (row, occlusion) in rows.iter().zip(occlusion) {
            let numbers = [row.position_m.to_array(), row.normal.to_array()].concat();
            let fields = numbers.iter().map(f64::to_string);
            csv.write_record(fields.chain([format!("{occlusion:.6}")]))?;
        }
        csv.flush().map_err(csv::Error::from)
    })();
    written.map_err(|source| QueryError::Write {
        target: target.to_owned(),
        source,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_found_by_name_and_others_left_aside() {
        let text = "name,nz, ny,nx,z,y,x\n\"a, b\",0,2,0,3, 2,1\n";
        let row = Row {
            position_m: DVec3::new(1.0, 2.0, 3.0),
            normal: DVec3::new(0.0, 2.0, 0.0),
        };
        let rows = parse(text.as_bytes()).unwrap();
        assert_eq!(rows, [row]);
        let mut out = Vec::new();
        write("memory", &mut out, &rows, &[0.25]).unwrap();
        let expected = "x,y,z,nx,ny,nz,occlusion\n1,2,3,0,2,0,0.250000\n";
        assert_eq!(String::from_utf8(out).unwrap(), expected);
    }

    #[test]
    fn faults_name_line_and_column() {
        let fault = |text: &str| parse(text.as_bytes()).unwrap_err().to_string();
        let header = "x,y,z,nx,ny,nz\n";
        assert!(fault("x,y,z,nx,nz\n1,2,3,0,1\n").starts_with("line 1: there is no column `ny`"));
        assert!(fault("").starts_with("line 1: there is no column `x`"));
        assert_eq!(fault(header), "line 2: there is no point");
        let bad = fault(&format!("{header}1,2,3,0,1,0\n1,2,three,0,1,0\n"));
        assert!(
            bad.starts_with("line 3, column `z`: `three` is not"),
            "{bad}"
        );
        for number in ["NaN", "inf", "1e7", ""] {
            let bad = fault(&format!("{header}1,{number},3,0,1,0\n"));
            assert!(bad.starts_with("line 2, column `y`"), "{bad}");
        }
        let bad = fault(&format!("{header}1,2,3,0,0,0\n"));
        assert!(bad.starts_with("line 2, columns `nx`, `ny`, `nz`"), "{bad}");
        let bad = fault(&format!("{header}1,2,3,0,1\n"));
        assert_eq!(bad, "line 2 has 5 fields, the header has 6");
    }
}
