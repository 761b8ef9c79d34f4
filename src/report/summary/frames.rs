//! Where the time goes: a frame for each pipeline, by stage.

use super::super::ReportView;
use super::super::facts::{self, Representative, StageShare};
use super::super::format::{self, Table, percent};
use super::cut;
use fathom_base::text;

/// Rows of all frames.
const MOST_ROWS: usize = 46;
/// Stages below this share of a frame stand in one row.
const SMALL_SHARE: f64 = 0.04;

pub fn write(view: &ReportView<'_>, text: &mut String) {
    let frames = facts::representatives(view);
    let rows: Vec<[String; 4]> = frames.iter().flat_map(rows).collect();
    let (rows, more) = cut(rows, MOST_ROWS);
    let mut table = Table::new(["frame", "stage", "time (ms)", "share of the stages"]);
    rows.into_iter().for_each(|row| table.row_of_markdown(row));
    let about = "A frame for each pipeline: of those with every stage above the clock's resolution the one nearest to the defaults, \
                 by the parameters that its experiment sets. Medians with 95 % intervals.";
    table.add_to(text, &format!("## Where the time goes\n\n{about}{more}\n\n"));
}

/// The frame's longest stages, and the sum of its short ones.
fn rows(frame: &Representative<'_>) -> Vec<[String; 4]> {
    let mut stages = frame.stages();
    stages.sort_by(|a, b| b.share.median.total_cmp(&a.share.median));
    let (long, short): (Vec<_>, Vec<_>) =
        stages.into_iter().partition(|stage| stage.share.median >= SMALL_SHARE);
    let mut rows: Vec<[String; 4]> = long.iter().map(row).collect();
    rows.extend(sum_of(&short));
    if let Some(first) = rows.first_mut() {
        first[0] = text::markdown(&format!(
            "{} ({} {}, {}, n = {})",
            frame.cell.pipeline,
            frame.cell.experiment,
            frame.cell.cell,
            frame.conditions(),
            frame.measured.frame.untimed.n
        ));
    }
    rows
}

fn row(stage: &StageShare<'_>) -> [String; 4] {
    let bound = if stage.stage.is_resolved() { "" } else { "< " };
    [
        String::new(),
        stage.stage.stage.to_string(),
        format::stage_ms(stage.stage),
        format!("{bound}{}", facts::share(&stage.share)),
    ]
    .map(|cell| text::markdown(&cell))
}

fn sum_of(short: &[StageShare<'_>]) -> Option<[String; 4]> {
    let time: f64 = short.iter().map(|stage| stage.stage.time.median).sum();
    let share: f64 = short.iter().map(|stage| stage.share.median).sum();
    (!short.is_empty()).then(|| {
        [
            String::new(),
            if short.len() == 1 { "1 other".to_owned() } else { format!("{} others", short.len()) },
            format::three(time / format::NS_PER_MS),
            percent(share),
        ]
    })
}
