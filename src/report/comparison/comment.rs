//! A comment in a pull request: the verdict, the noise and the worst cells in at most 13 lines, however many cells there are, beside folded
//! blocks with what differs in the worst. So a job can add a hidden mark and a link within 15.

use itertools::{Itertools, chain};

use super::{document, rows};
use crate::document::{Block, Line, Span, markdown};
use crate::noise;
use fathom_judge::verdict::{CellVerdict, JudgedCell, Verdicts};

/// Cells and faults that are listed; the rest is counted.
const MAX_ITEMS: usize = 5;
/// Characters of a name.
const MAX_CHARACTERS: usize = 160;

pub fn export(verdicts: &Verdicts<'_>) -> String {
    let noise =
        noise::describe_noise(verdicts).map(|noise| short(&noise) + ". ").unwrap_or_default();
    let items = items(verdicts);
    let more = items.len().saturating_sub(MAX_ITEMS);
    let more = (more > 0).then(|| format!("and {more} more").into());
    let [sides, adapters] = rows::sides(verdicts).map(|side| name(&side));
    let parts = chain![
        [
            Block::Heading(document::title(verdicts)),
            Block::paragraph(noise + &rows::count_words(verdicts)),
            Block::list(items.into_iter().take(MAX_ITEMS).chain(more)),
            Block::paragraph(sides.and(" on ").and(adapters)),
        ],
        rows::differences_of_regressions(verdicts, MAX_ITEMS)
    ];
    markdown(&parts.collect_vec()).trim_end().to_owned() + "\n"
}

/// What is wrong or open, the worst first.
fn items(verdicts: &Verdicts<'_>) -> Vec<Line> {
    let threshold = verdicts.comparison.header.settings.threshold;
    let whole = verdicts.configurations.iter().filter(|difference| difference.worse);
    let unmeasured = [CellVerdict::Failed, CellVerdict::NotMeasured];
    let unmeasured = verdicts.cells.iter().filter(|cell| unmeasured.contains(&cell.verdict));
    let open = verdicts.cells.iter().filter(|cell| cell.may_be_slower(threshold));
    let open = open.sorted_by(|a, b| high(b).total_cmp(&high(a)));
    verdicts
        .regressions()
        .into_iter()
        .map(cell_line)
        .chain(whole.map(|difference| name(&rows::difference(difference))))
        .chain(verdicts.faults.iter().filter(|fault| !fault.absent).map(|f| name(&rows::fault(f))))
        .chain(unmeasured.map(cell_line))
        .chain(open.map(cell_line))
        .collect()
}

/// The upper end of the interval of a cell's change.
fn high(cell: &JudgedCell) -> f64 {
    let interval = cell.time.as_ref().and_then(|time| time.change.interval);
    interval.map_or(f64::INFINITY, |interval| interval.high)
}

/// `tank caustics/trace`: slower: time +5.0 % (4.8 … 5.2); instructions +6.10 %
fn cell_line(cell: &JudgedCell) -> Line {
    let faults = cell.faults.iter().map(rows::fault);
    let others = cell.differences.iter().filter(|other| other.worse).map(rows::difference);
    let others = others.chain(faults).collect_vec();
    // Their names come from workers.
    let others = (!others.is_empty()).then(|| name(&others.join("; ")));
    let because = rows::reasons(cell).into_iter().map(Line::from).chain(others);
    let because = because.reduce(|line, more| line.and("; ").and(more)).unwrap_or_default();
    name(cell.cell.as_str()).and(format!(": {}: ", cell.verdict)).and(because)
}

/// As code: nothing in it becomes a link, a mention or markup.
fn name(text: &str) -> Line {
    Span::Code(short(text)).into()
}

fn short(text: &str) -> String {
    match text.char_indices().nth(MAX_CHARACTERS) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text.to_owned(),
    }
}
