//! What a run says on stderr while it measures: on a terminal one line that is rewritten, elsewhere a line every now and then.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{IsTerminal, stderr};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use fathom_base::print;
use fathom_base::text;
use fathom_base::visits::MIN_VISITS;
use fathom_experiments::CellPlan;
use fathom_record::{Cell, Outcome};

/// Between two lines where there is no terminal.
const INTERVAL: Duration = Duration::from_secs(10);
/// Steps of the bar.
const STEPS: u64 = 1000;

/// Follows a run over all its cells and claims.
pub struct Progress {
    /// Hidden where there is no terminal.
    bar: ProgressBar,
    start: Instant,
    budget_s: f64,
    cells: usize,
    /// Experiment and cell.
    pub finished: BTreeSet<(String, String)>,
    /// Of each experiment, by its number: claims that are settled, of all.
    claims: BTreeMap<usize, (usize, usize)>,
    /// The fewest and the most visits to a timed cell.
    pub visits: Option<(usize, usize)>,
    last_printed: Instant,
}

impl Progress {
    /// For so many cells and a time budget in seconds from `start` on.
    pub fn new(cells: usize, start: Instant, budget_s: f64) -> Self {
        let hidden = !stderr().is_terminal();
        let target =
            if hidden { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
        let style = ProgressStyle::with_template("{bar:20} {msg}")
            .unwrap_or_else(|_| ProgressStyle::default_bar());
        let bar = ProgressBar::with_draw_target(Some(STEPS), target).with_style(style);
        let (finished, claims) = (BTreeSet::new(), BTreeMap::new());
        let last_printed = start;
        Self { bar, start, budget_s, cells, finished, claims, visits: None, last_printed }
    }

    /// A cell's pipeline is about to be built.
    pub fn preparing(&mut self, cell: &CellPlan) {
        self.bar.set_prefix(cell.experiment.clone());
        self.tick();
    }

    /// A frame has been rendered.
    pub fn tick(&mut self) {
        if !self.bar.is_hidden() {
            let used = self.start.elapsed().as_secs_f64() / self.budget_s;
            self.bar.set_position((used.min(1.0) * STEPS as f64) as u64);
            self.bar.set_message(text::line(&format!("{}  {}", self.line(), self.bar.prefix())));
        } else if self.last_printed.elapsed() >= INTERVAL {
            print::note(self.line());
            self.last_printed = Instant::now();
        }
    }

    /// A cell has a record. What went wrong is told at once.
    pub fn finished(&mut self, cell: &Cell) {
        self.finished.insert((cell.experiment.clone(), cell.cell.clone()));
        if matches!(cell.outcome, Outcome::Measured(_) | Outcome::OverBudget) {
            return;
        }
        let why = cell.outcome.words().join(": ");
        let line = text::line(&format!("{} {}: {why}", cell.experiment, cell.cell));
        if self.bar.is_hidden() { print::note(line) } else { self.bar.println(line) }
    }

    pub fn set_settled(&mut self, experiment: usize, settled: usize, claims: usize) {
        self.claims.insert(experiment, (settled, claims));
    }

    /// Clears the bar.
    pub fn end(&self) {
        self.bar.finish_and_clear();
    }

    /// `1:24 of 4:00, 120 of 337 cells, visits to each: 1 to 3 (an interval takes 4), 31 of 91 claims settled so far`
    fn line(&self) -> String {
        let (used, budget) = (clock(self.start.elapsed().as_secs_f64()), clock(self.budget_s));
        let mut cells = format!("{} of {} cells", self.finished.len(), self.cells);
        if let Some((min, max)) = self.visits {
            let range = if min == max { min.to_string() } else { format!("{min} to {max}") };
            cells += &format!(", visits to each: {range} (an interval takes {MIN_VISITS})");
        }
        let sum = |of: fn(&(usize, usize)) -> usize| self.claims.values().map(of).sum::<usize>();
        match (sum(|claims| claims.0), sum(|claims| claims.1)) {
            (_, 0) => format!("{used} of {budget}, {cells}"),
            (settled, all) => {
                format!("{used} of {budget}, {cells}, {settled} of {all} claims settled so far")
            }
        }
    }
}

/// Minutes and seconds.
fn clock(seconds: f64) -> String {
    let whole = seconds as u64;
    format!("{}:{:02}", whole / 60, whole % 60)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_tells_time_cells_and_claims() {
        let mut progress = Progress::new(3, Instant::now(), 240.0);
        assert_eq!(progress.line(), "0:00 of 4:00, 0 of 3 cells");
        let cell = |name: &str| {
            let outcome = Outcome::Measured(Box::default());
            Cell { cell: name.to_owned(), outcome, ..Cell::default() }
        };
        // A cell that is sampled once more is not another cell.
        ["a", "a", "b"].map(cell).iter().for_each(|cell| progress.finished(cell));
        progress.set_settled(0, 1, 2);
        progress.set_settled(4, 0, 3);
        progress.set_settled(0, 2, 2);
        progress.visits = Some((1, 3));
        let visits = "2 of 3 cells, visits to each: 1 to 3 (an interval takes 4), 2 of 5 claims";
        assert_eq!(progress.line(), format!("0:00 of 4:00, {visits} settled so far"));
        assert_eq!(clock(3_725.0), "62:05");
    }
}
