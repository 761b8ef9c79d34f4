//! What a run says on stderr while it measures: a bar on a terminal, one line per cell elsewhere.

use std::io::{IsTerminal, stderr};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use fathom_base::tell;
use fathom_base::text;
use fathom_experiments::CellPlan;
use fathom_record::{Cell, Outcome};

/// Longest budget that is counted down, seconds: a year. A point in time too far away cannot be told.
const LONGEST_S: f64 = 365.0 * 86_400.0;

/// Follows a run over all its cells.
pub struct Progress {
    /// Hidden where there is no terminal; it counts the cells there too.
    bar: ProgressBar,
    end: Instant,
}

impl Progress {
    /// For `total` cells and a time budget in seconds.
    pub fn new(total: usize, budget_s: f64) -> Self {
        let hidden = !stderr().is_terminal();
        let target =
            if hidden { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
        let style = ProgressStyle::with_template("{bar:30} {pos}/{len} cells  {msg}")
            .unwrap_or_else(|_| ProgressStyle::default_bar());
        let bar = ProgressBar::with_draw_target(Some(total as u64), target).with_style(style);
        let budget = Duration::try_from_secs_f64(budget_s.clamp(0.0, LONGEST_S));
        let end = Instant::now() + budget.unwrap_or(Duration::ZERO);
        Self { bar, end }
    }

    /// A cell's pipeline is about to be built.
    pub fn preparing(&mut self, cell: &CellPlan) {
        self.bar.set_prefix(cell.experiment.clone());
        self.tick();
    }

    /// A frame has been rendered.
    pub fn tick(&mut self) {
        if !self.bar.is_hidden() {
            self.bar.set_message(format!("{}  {}", self.bar.prefix(), self.time_left()));
        }
    }

    /// A cell has its result.
    pub fn finished(&mut self, cell: &Cell) {
        self.bar.inc(1);
        let name = format!("{} {}", cell.experiment, cell.cell);
        let result = describe(&cell.outcome);
        if self.bar.is_hidden() {
            let (done, total) = (self.bar.position(), self.bar.length().unwrap_or(0));
            tell::note(format!("[{done}/{total}] {name}: {result}  ({})", self.time_left()));
        } else {
            self.bar.println(text::line(&format!("{name}: {result}")));
        }
    }

    /// Clears the bar.
    pub fn end(&self) {
        self.bar.finish_and_clear();
    }

    fn time_left(&self) -> String {
        match self.end.saturating_duration_since(Instant::now()).as_secs() {
            0 => "past the time budget, on each cell's least frames".to_owned(),
            left_s => format!("about {}:{:02} min left", left_s / 60, left_s % 60),
        }
    }
}

/// A cell's result in a few words.
fn describe(outcome: &Outcome) -> String {
    match outcome {
        Outcome::Measured(measured) if !measured.is_timed() => {
            format!("{} errors, nothing timed", measured.errors.len())
        }
        Outcome::Measured(measured) => {
            let frame = &measured.frame.untimed;
            let (median_ms, share) = (frame.median * 1e-6, 100.0 * frame.relative_half_width());
            format!("{median_ms:.3} ms ±{share:.1} % from {} pairs of frames", frame.n)
        }
        Outcome::Skipped { reason } => format!("skipped: {reason}"),
        Outcome::Failed { reason } => format!("failed: {reason}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A time too far away to be told is a year away.
    #[test]
    fn any_budget_is_counted_down() {
        for budget_s in [f64::MIN_POSITIVE, 1e19, f64::MAX] {
            let progress = Progress::new(1, budget_s);
            assert!(progress.end <= Instant::now() + Duration::from_secs_f64(LONGEST_S));
        }
    }
}
