//! A table for people at a terminal: columns in step, regressions once more at the end, where the eye is.

use super::{Format, rows};
use crate::compare::verdict::Verdicts;

pub const FORMAT: Format = Format {
    name: "text",
    about: "a table for the terminal",
    file: None,
    write,
};

fn write(verdicts: &Verdicts<'_>) -> String {
    let [sides, adapter] = rows::sides(verdicts);
    let mut text = format!("{sides}\n{adapter}\n\n");
    let header = rows::HEADER.map(str::to_owned);
    let cells = verdicts.cells.iter().map(rows::cell);
    text += &columns(&std::iter::once(header).chain(cells).collect::<Vec<_>>());
    text.push('\n');
    for note in rows::notes(verdicts) {
        text += &format!("{note}\n");
    }
    text.push('\n');
    for regression in rows::regressions(verdicts) {
        text += &format!("{regression}\n");
    }
    text + &rows::headline(verdicts) + "\n"
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
        let padded: Vec<String> = cells
            .map(|(cell, width)| format!("{cell:width$}"))
            .collect();
        format!("{}\n", padded.join("  ").trim_end())
    };
    rows.iter().map(line).collect()
}
