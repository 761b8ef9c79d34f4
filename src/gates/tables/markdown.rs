//! Markdown for a pull request and for a job's summary: the regressions, and everything else folded away.

use super::rows;
use crate::noise;
use crate::verdict::{JudgedCell, Verdicts};
use fathom_base::text;
use fathom_report::format::Table;

pub fn export(verdicts: &Verdicts<'_>) -> String {
    let [sides, adapter] = rows::sides(verdicts);
    let noise = noise::told(verdicts);
    let noise = noise.map_or_else(String::new, |noise| text::markdown(&noise) + "  \n");
    let mut text = format!(
        "### {} fathom compare: {}\n\n{noise}{}\n\n{}  \n{}\n\n",
        rows::mark(verdicts.status),
        verdicts.status,
        rows::counted(verdicts),
        text::markdown(&sides),
        text::markdown(&adapter)
    );
    let regressions = verdicts.regressions();
    if !regressions.is_empty() {
        text += &table(regressions.into_iter());
    }
    let whole = verdicts.configurations.iter();
    let whole: Vec<String> =
        whole.filter(|difference| difference.worse).map(rows::difference).collect();
    text += &list(&whole);
    text += &format!(
        "<details><summary>All cells</summary>\n\n{}</details>\n\n",
        table(verdicts.cells.iter())
    );
    text + list(&rows::notes(verdicts)).as_str()
}

fn table<'a>(cells: impl Iterator<Item = &'a JudgedCell>) -> String {
    let mut table = Table::new(rows::HEADER);
    for cell in cells {
        table.row(rows::cell(cell));
    }
    table.markdown()
}

/// A list with an empty line after it; nothing for no items.
fn list(items: &[String]) -> String {
    if items.is_empty() {
        return String::new();
    }
    let lines: String = items.iter().map(|item| format!("- {}\n", text::markdown(item))).collect();
    lines + "\n"
}
