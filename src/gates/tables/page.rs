//! A comparison on the HTML page, alone or beside runs.

use super::rows;
use crate::verdict::{CellVerdict, JudgedCell, Status, Verdicts};
use fathom_report::page::{ChangeOnPage, ComparisonOnPage, ComparisonRow, Page, Tone};

/// Columns of [`rows::cell`] that the page shows as text: all but cell and verdict.
const FIGURES: usize = 2;

pub fn export(verdicts: &Verdicts<'_>) -> String {
    let mut page = Page::new(Vec::new());
    page.comparisons.push(on_page(verdicts));
    page.html()
}

/// What the page shows of a comparison.
pub fn on_page(verdicts: &Verdicts<'_>) -> ComparisonOnPage {
    let [sides, adapter] = rows::sides(verdicts);
    let mut cells: Vec<&JudgedCell> = verdicts.cells.iter().collect();
    cells.sort_by_key(|cell| cell.verdict);
    ComparisonOnPage {
        headline: rows::headline(verdicts),
        tone: match verdicts.status {
            Status::NoRegression => Tone::Good,
            Status::Regression => Tone::Bad,
            Status::CouldNotMeasure | Status::Inconclusive => Tone::Open,
        },
        sides,
        adapter,
        threshold: verdicts.comparison.header.settings.threshold,
        columns: rows::HEADER[FIGURES..].to_vec(),
        rows: cells.into_iter().map(row).collect(),
        notes: rows::notes(verdicts),
    }
}

fn row(cell: &JudgedCell) -> ComparisonRow {
    let change = cell.time.as_ref();
    ComparisonRow {
        cell: cell.cell.to_string(),
        verdict: cell.verdict.to_string(),
        tone: tone(cell.verdict),
        change: change.map(|time| ChangeOnPage { share: time.change, interval: time.interval }),
        figures: rows::cell(cell)[FIGURES..].to_vec(),
    }
}

fn tone(verdict: CellVerdict) -> Tone {
    use CellVerdict::*;
    match verdict {
        Slower | LessAccurate | FasterButLessAccurate | Costlier => Tone::Bad,
        Failed | NotMeasured | Inconclusive => Tone::Open,
        NotJudged | New => Tone::Neutral,
        Faster | Cheaper | Same => Tone::Good,
    }
}
