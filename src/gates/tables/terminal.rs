//! A table for people at a terminal: columns in step, regressions once more at the end, where the eye is.

use super::rows;
use crate::noise;
use crate::verdict::Verdicts;
use fathom_base::text;

pub fn export(verdicts: &Verdicts<'_>) -> String {
    let [sides, adapter] = rows::sides(verdicts).map(|side| text::line(&side));
    let mut told = format!("{sides}\n{adapter}\n");
    told += &noise::told(verdicts).map_or_else(String::new, |noise| text::line(&noise) + "\n");
    told.push('\n');
    let header = rows::HEADER.map(str::to_owned);
    let cells = verdicts.cells.iter();
    let cells = cells.map(|cell| rows::cell(cell).map(|field| text::line(&field)));
    told += &text::columns(&std::iter::once(header).chain(cells).collect::<Vec<_>>()).join("\n");
    told += "\n\n";
    for note in rows::notes(verdicts) {
        told += &format!("{}\n", text::line(&note));
    }
    told.push('\n');
    for regression in rows::regressions(verdicts) {
        told += &format!("{}\n", text::line(&regression));
    }
    told + rows::headline(verdicts).as_str() + "\n"
}
