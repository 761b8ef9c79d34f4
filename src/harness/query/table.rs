//! Numbers by row of a CSV file.

use std::io::Read;

use anyhow::{Context, Result, anyhow, ensure};

use fathom_base::text::line as on_one_line;

/// Largest coordinate, metres, and largest component of a direction.
const FAR: f64 = 1e6;
/// Shorter directions have none in 32 bits.
pub const SHORT: f64 = 1e-6;

/// A row's line and its numbers, in the order of the columns asked for.
pub type TableRow = (u64, Vec<f64>);

/// Columns in any order and among others, which are left aside.
pub fn read(text: impl Read, columns: &[&str]) -> Result<Vec<TableRow>> {
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(text);
    let header = reader.headers().map_err(fault)?.clone();
    let places = columns.iter().map(|column| {
        let found = header.iter().position(|name| name == *column);
        let needed = || format!("{} are needed", list(columns));
        let missing = || format!("line 1: there is no column `{column}`: {}", needed());
        Ok((*column, found.with_context(missing)?))
    });
    let places = places.collect::<Result<Vec<_>>>()?;
    let rows = reader.records().map(|record| row(&record.map_err(fault)?, &places));
    let rows = rows.collect::<Result<Vec<TableRow>>>()?;
    ensure!(!rows.is_empty(), "line 2: there is no point");
    Ok(rows)
}

/// `a, b and c`.
fn list(columns: &[&str]) -> String {
    match columns.split_last() {
        Some((last, rest)) if !rest.is_empty() => format!("{} and {last}", rest.join(", ")),
        _ => columns.concat(),
    }
}

fn row(record: &csv::StringRecord, places: &[(&str, usize)]) -> Result<TableRow> {
    let line = record.position().map_or(0, csv::Position::line);
    let number = |(column, place): &(&str, usize)| {
        let text = record.get(*place).unwrap_or_default();
        let parsed = text.parse().ok().filter(|n: &f64| n.abs() <= FAR);
        let text = on_one_line(text);
        parsed.with_context(|| {
            format!("line {line}, column `{column}`: `{text}` is not a number within ±10⁶")
        })
    };
    Ok((line, places.iter().map(number).collect::<Result<_>>()?))
}

fn fault(error: csv::Error) -> anyhow::Error {
    match error.kind() {
        csv::ErrorKind::UnequalLengths { pos: Some(position), expected_len, len } => {
            let line = position.line();
            anyhow!("line {line} has {len} fields, the header has {expected_len}")
        }
        _ => anyhow!("{error}"),
    }
}
