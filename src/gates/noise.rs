//! How noisy the times of a comparison are, and what that lets it see: told before any verdict.

use itertools::Itertools;

use crate::time::{CellTime, TimeVerdict};
use crate::verdict::{GateState, Verdicts};
use fathom_base::statistics::median;
use fathom_record::comparison::Gate;
use fathom_report::noise::Noise;

/// Beyond so many times the threshold, the scatter hides more than the threshold lets through.
const NOISY: f64 = 2.0;

/// What the median cell says; none without a time that is judged.
fn of_cells(cells: &[&CellTime], threshold: f64) -> Option<String> {
    let judged = cells.iter().filter(|cell| cell.verdict != TimeVerdict::NotJudged);
    let judged = judged.collect_vec();
    if judged.is_empty() {
        return None;
    }
    let middle = |figure: &dyn Fn(&CellTime) -> f64| {
        median(&judged.iter().map(|cell| figure(cell)).collect_vec())
    };
    let scatter = format!("scatter by {:.1} %", 100.0 * middle(&CellTime::scatter));
    let visible = middle(&|cell| cell.detectable.unwrap_or(f64::INFINITY));
    if visible.is_infinite() {
        return Some(format!(
            "too few launches to see a slowdown in half of the cells; those of the median cell {scatter}"
        ));
    }
    let noise = if visible > NOISY * threshold { Noise::Noisy } else { Noise::Quiet };
    let visible = 100.0 * visible;
    Some(format!(
        "{noise}: launches of the median cell {scatter}; in half of the cells a slowdown below {visible:.1} % can go unseen"
    ))
}

/// One sentence; none where no times were to be judged.
pub fn told(verdicts: &Verdicts<'_>) -> Option<String> {
    let (_, state) = verdicts.gates.iter().find(|(gate, _)| *gate == Gate::Time)?;
    match state {
        GateState::Skipped(_) => None,
        GateState::Void(reason) => Some(format!("times cannot be used: {reason}")),
        GateState::Ran => {
            let times = verdicts.cells.iter().filter_map(|cell| cell.time.as_ref()).collect_vec();
            let threshold = verdicts.comparison.header.settings.threshold;
            of_cells(&times, threshold)
        }
    }
}
