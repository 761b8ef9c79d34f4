//! What a comparison says, for a terminal, in Markdown and on a page.

use itertools::{Itertools, chain};

use super::rows;
use crate::charts::strip;
use crate::document::{self, Block, ColumnKind, Field, Line, Span, Table, Tone};
use crate::noise;
use crate::page::{ComparisonOnPage, Page};
use fathom_judge::verdict::{CellVerdict, JudgedCell, Status, Verdicts};
use fathom_record::Interval;

/// Changes are shown up to this share, or to the largest of the comparison.
const MIN_SHOWN: f64 = 0.1;

/// The parts that each format puts into its own order.
struct VerdictBlocks {
    /// What was compared, on what, and how noisy that was.
    conditions: Vec<Block>,
    /// Every regression, then the verdict.
    verdict: Vec<Block>,
    details: Vec<Block>,
}

impl VerdictBlocks {
    fn new(verdicts: &Verdicts<'_>) -> VerdictBlocks {
        let [sides, adapter] = rows::sides(verdicts);
        let noise = noise::describe_noise(verdicts).map(Block::paragraph);
        let tone = match verdicts.status {
            Status::NoRegression => Tone::Good,
            Status::Regression => Tone::Bad,
            Status::CouldNotMeasure | Status::Inconclusive | Status::TimesNotJudged => Tone::Open,
        };
        let headline = Span::Chip(tone, rows::headline(verdicts));
        VerdictBlocks {
            conditions: chain![
                [Span::Bold(sides), Span::Faint(adapter)].map(Block::paragraph),
                noise
            ]
            .collect(),
            verdict: vec![Block::list(rows::regressions(verdicts)), Block::paragraph(headline)],
            details: chain![
                rows::differences_of_regressions(verdicts, usize::MAX),
                [
                    Block::Fold("All cells".into(), vec![Block::Table(cells(verdicts))]),
                    Block::Fold("Notes".into(), vec![Block::list(rows::notes(verdicts))]),
                ]
            ]
            .collect(),
        }
    }
}

/// The verdict at the end, where the eye is.
pub fn terminal(verdicts: &Verdicts<'_>) -> String {
    let VerdictBlocks { conditions, verdict, details } = VerdictBlocks::new(verdicts);
    let parts = chain![conditions, details, verdict].collect_vec();
    document::terminal(&parts)
}

/// For a pull request and for a job's summary.
pub fn markdown(verdicts: &Verdicts<'_>) -> String {
    let VerdictBlocks { conditions, verdict, details } = VerdictBlocks::new(verdicts);
    let title = Block::Heading(title(verdicts));
    let parts = chain![[title], conditions, verdict, details].collect_vec();
    document::markdown(&parts)
}

/// ✅ fathom compare: no regression `1a2b3c4d5e6f → 6f5e4d3c2b1a`
pub fn title(verdicts: &Verdicts<'_>) -> Line {
    let (status, summary) = (verdicts.status, rows::summary(verdicts));
    let title = Line::from(format!("{} fathom compare: {status}", rows::mark(status)));
    // Names of cells come from workers.
    if summary.is_empty() { title } else { title.and(" ").and(Span::Code(summary)) }
}

pub fn page(verdicts: &Verdicts<'_>) -> String {
    let mut page = Page::new(Vec::new());
    page.comparisons.push(on_page(verdicts));
    page.html()
}

/// What the page shows of a comparison.
pub fn on_page(verdicts: &Verdicts<'_>) -> ComparisonOnPage {
    let VerdictBlocks { conditions, verdict, details } = VerdictBlocks::new(verdicts);
    let parts = chain![conditions, verdict, details].collect_vec();
    let [sides, _] = rows::sides(verdicts);
    ComparisonOnPage { sides, parts }
}

fn cells(verdicts: &Verdicts<'_>) -> Table {
    let (threshold, reach) = (verdicts.comparison.header.settings.threshold, reach(verdicts));
    let band = Interval { low: -threshold, high: threshold };
    let shaded = format!("shaded: ± {:.1} %", 100.0 * threshold);
    let mut columns = rows::HEADER.map(str::to_owned).to_vec();
    columns.insert(2, shaded.clone());
    let row = |cell: &JudgedCell| {
        let [name, verdict, figures @ ..] = rows::cell(cell);
        let drawn = cell.time.as_ref().map(|time| Field {
            // All cells have one axis.
            line: Span::Drawn(strip(
                [-reach, reach],
                band,
                &time.change,
                None,
                &rows::change(time),
            ))
            .into(),
            value: Some(time.change.median),
        });
        let verdict = Span::Chip(tone(cell.verdict), verdict);
        let first = [name.into(), verdict.into(), drawn.unwrap_or_else(|| "no time".into())];
        chain![first, figures.map(Field::from)].collect_vec()
    };
    Table::new("Compared cells", columns)
        .with(ColumnKind::Drawings, &[&shaded])
        .with_class("sortable")
        .with_rows(verdicts.cells.iter().map(row))
}

fn tone(verdict: CellVerdict) -> Tone {
    use CellVerdict::*;
    match verdict {
        Slower | LessAccurate | FasterButLessAccurate | Costlier => Tone::Bad,
        Failed | NotMeasured | Inconclusive => Tone::Open,
        NotJudged | New => Tone::Neutral,
        Faster | Cheaper | Same | Unchanged => Tone::Good,
    }
}

/// The largest change that the comparison's axes show.
fn reach(verdicts: &Verdicts<'_>) -> f64 {
    let times = verdicts.cells.iter().filter_map(|cell| cell.time.as_ref());
    let ends = times.flat_map(|time| {
        let [low, high] = time.change.ends();
        [time.change.median.abs(), low.abs(), high.abs()]
    });
    ends.filter(|end| end.is_finite()).fold(MIN_SHOWN, f64::max)
}
