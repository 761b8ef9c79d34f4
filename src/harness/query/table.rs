//! Numbers by row of a CSV file.

use std::io::Read;

use thiserror::Error;

use fathom_base::text::line as on_one_line;

/// Largest coordinate, metres, and largest component of a direction.
const FAR: f64 = 1e6;
/// Shorter directions have none in 32 bits.
pub const SHORT: f64 = 1e-6;

/// What is wrong with a file of points.
#[derive(Debug, Error)]
pub enum PointFault {
    #[error("line 1: there is no column `{column}`: {needed} are needed")]
    Column { column: &'static str, needed: String },
    #[error("line {line}, column `{column}`: `{}` is not a number within ±10⁶", on_one_line(.text))]
    Number { line: u64, column: &'static str, text: String },
    #[error("line {line}, columns {columns}: {what}")]
    Direction { line: u64, columns: &'static str, what: String },
    #[error("line {line} has {fields} fields, the header has {expected}")]
    Fields { line: u64, fields: u64, expected: u64 },
    #[error("line 2: there is no point")]
    Empty,
    #[error("{0}")]
    Csv(csv::Error),
}

/// A row's line and its numbers, in the order of the columns asked for.
pub type TableRow = (u64, Vec<f64>);

/// Columns in any order and among others, which are left aside. Those of `optional` come all or not at all; the second part
/// of the answer says whether they are there.
pub fn read(
    text: impl Read,
    needed: &[&'static str],
    optional: &[&'static str],
) -> Result<(Vec<TableRow>, bool), PointFault> {
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(text);
    let header = reader.headers().map_err(fault)?.clone();
    let has = |column: &&&'static str| header.iter().any(|name| name == **column);
    let more = optional.iter().any(|column| has(&column));
    let mut columns = needed.to_vec();
    columns.extend(optional.iter().filter(|_| more));
    let places = columns.iter().map(|column| {
        let found = header.iter().position(|name| name == *column);
        let missing = || PointFault::Column { column, needed: list(&columns) };
        Ok((*column, found.ok_or_else(missing)?))
    });
    let places = places.collect::<Result<Vec<_>, PointFault>>()?;
    let rows = reader.records().map(|record| row(&record.map_err(fault)?, &places));
    let rows = rows.collect::<Result<Vec<TableRow>, _>>()?;
    if rows.is_empty() {
        return Err(PointFault::Empty);
    }
    Ok((rows, more))
}

/// `a, b and c`.
fn list(columns: &[&str]) -> String {
    match columns.split_last() {
        Some((last, rest)) if !rest.is_empty() => format!("{} and {last}", rest.join(", ")),
        _ => columns.concat(),
    }
}

fn row(
    record: &csv::StringRecord,
    places: &[(&'static str, usize)],
) -> Result<TableRow, PointFault> {
    let line = record.position().map_or(0, csv::Position::line);
    let number = |(column, place): &(&'static str, usize)| {
        let text = record.get(*place).unwrap_or_default();
        let parsed = text.parse().ok().filter(|n: &f64| n.abs() <= FAR);
        parsed.ok_or_else(|| PointFault::Number { line, column, text: text.to_owned() })
    };
    let numbers = places.iter().map(number).collect::<Result<Vec<f64>, _>>()?;
    Ok((line, numbers))
}

fn fault(error: csv::Error) -> PointFault {
    match error.kind() {
        csv::ErrorKind::UnequalLengths { pos: Some(position), expected_len, len } => {
            PointFault::Fields { line: position.line(), fields: *len, expected: *expected_len }
        }
        _ => PointFault::Csv(error),
    }
}
