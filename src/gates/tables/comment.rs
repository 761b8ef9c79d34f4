//! A comment in a pull request: the verdict, the noise and the worst cells in at most 13 lines, however many cells there are. So a job can add a
//! hidden mark and a link within 15.

use itertools::Itertools;

use super::rows;
use crate::noise;
use crate::verdict::{CellVerdict, JudgedCell, Verdicts};
use fathom_base::text;

/// Cells and faults that are listed; the rest is counted.
const MOST_ITEMS: usize = 5;
/// Characters of a name.
const MOST_CHARACTERS: usize = 160;

pub fn export(verdicts: &Verdicts<'_>) -> String {
    let mut lines = vec![
        format!("### {} fathom compare: {}", rows::mark(verdicts.status), verdicts.status),
        String::new(),
    ];
    lines.extend(noise::told(verdicts).map(|noise| text::markdown(&short(&noise)) + "  "));
    lines.extend([rows::counted(verdicts), String::new()]);
    let items = items(verdicts);
    let more = items.len().saturating_sub(MOST_ITEMS);
    lines.extend(items.into_iter().take(MOST_ITEMS).map(|item| format!("- {item}")));
    if more > 0 {
        lines.push(format!("- and {more} more"));
    }
    if lines.last().is_some_and(|line| !line.is_empty()) {
        lines.push(String::new());
    }
    lines.push(rows::sides(verdicts).map(|side| name(&side)).join(" on "));
    lines.join("\n") + "\n"
}

/// What is wrong or open, the worst first.
fn items(verdicts: &Verdicts<'_>) -> Vec<String> {
    let threshold = verdicts.comparison.header.settings.threshold;
    let whole = verdicts.configurations.iter().filter(|difference| difference.worse);
    let unmeasured = [CellVerdict::Failed, CellVerdict::NotMeasured];
    let unmeasured = verdicts.cells.iter().filter(|cell| unmeasured.contains(&cell.verdict));
    let open = verdicts.cells.iter().filter(|cell| cell.may_be_slower(threshold));
    let open = open.sorted_by(|a, b| high(b).total_cmp(&high(a)));
    verdicts
        .regressions()
        .into_iter()
        .map(of_cell)
        .chain(whole.map(|difference| name(&rows::difference(difference))))
        .chain(verdicts.faults.iter().filter(|fault| !fault.absent).map(|f| name(&rows::fault(f))))
        .chain(unmeasured.map(of_cell))
        .chain(open.map(of_cell))
        .collect()
}

/// The upper end of the interval of a cell's change.
fn high(cell: &JudgedCell) -> f64 {
    let interval = cell.time.as_ref().and_then(|time| time.change.interval);
    interval.map_or(f64::INFINITY, |interval| interval.high)
}

/// `tank caustics/trace`: slower: time +5.0 % (4.8 … 5.2); instructions +6.10 %
fn of_cell(cell: &JudgedCell) -> String {
    let faults = cell.faults.iter().map(rows::fault);
    let others = cell.differences.iter().filter(|other| other.worse).map(rows::difference);
    let others = others.chain(faults).collect_vec();
    // Their names come from workers.
    let others = (!others.is_empty()).then(|| name(&others.join("; ")));
    let because = rows::because(cell).into_iter().chain(others).join("; ");
    format!("{}: {}: {because}", name(cell.cell.as_str()), cell.verdict)
}

/// As code: nothing in it becomes a link, a mention or markup.
fn name(text: &str) -> String {
    text::code(&short(text))
}

fn short(text: &str) -> String {
    match text.char_indices().nth(MOST_CHARACTERS) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text.to_owned(),
    }
}
