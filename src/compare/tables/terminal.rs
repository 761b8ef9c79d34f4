//! A table for people at a terminal: columns in step, regressions once more at the end, where the eye is.

use super::{Format, rows};
use crate::compare::verdict::Verdicts;
use crate::text;

pub const FORMAT: Format =
    Format { name: "text", about: "a table for the terminal", file: None, write };

fn write(verdicts: &Verdicts<'_>) -> String {
    let [sides, adapter] = rows::sides(verdicts).map(|side| text::line(&side));
    let mut told = format!("{sides}\n{adapter}\n\n");
    let header = rows::HEADER.map(str::to_owned);
    let cells = verdicts.cells.iter();
    let cells = cells.map(|cell| rows::cell(cell).map(|field| text::line(&field)));
    told += &columns(&std::iter::once(header).chain(cells).collect::<Vec<_>>());
    told.push('\n');
    for note in rows::notes(verdicts) {
        told += &format!("{}\n", text::line(&note));
    }
    told.push('\n');
    for regression in rows::regressions(verdicts) {
        told += &format!("{}\n", text::line(&regression));
    }
    told + &rows::headline(verdicts) + "\n"
}

/// Each column as wide as its widest cell; nothing after a row's last text.
fn columns<const N: usize>(rows: &[[String; N]]) -> String {
    let width = |column: usize| {
        let cells = rows.iter().map(|row| row[column].chars().count());
        cells.max().unwrap_or(0)
    };
    let widths: Vec<usize> = (0..N).map(width).collect();
    let line = |row: &[String; N]| {
        let cells = row.iter().zip(&widths);
        let padded: Vec<String> = cells.map(|(cell, width)| format!("{cell:width$}")).collect();
        format!("{}\n", padded.join("  ").trim_end())
    };
    rows.iter().map(line).collect()
}
