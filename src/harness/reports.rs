//! Reports while a run goes on: made by whoever runs it, from the records so far.

use std::path::Path;
use std::time::{Duration, Instant};

use super::executor::Output;
use super::schedule::Schedule;
use fathom_record::{Record, Standing};

/// Reports are written no more often than this,
const INTERVAL: Duration = Duration::from_secs(30);
/// and take no more than this share of the time.
const MOST_SHARE: f64 = 0.03;
/// What the last report takes longer than the one before: it has more cells.
const GROWTH: f64 = 1.5;
/// Foreseen for a report before the first.
const UNSEEN: Duration = Duration::from_millis(500);

/// Makes a report of these records in this folder.
pub type Report<'r> = &'r mut dyn FnMut(&Path, &[Record], Standing);

/// When reports are made.
pub struct Reports<'r> {
    report: Report<'r>,
    pub budget_s: f64,
    /// The end of the latest, and how long it took.
    latest: Option<(Instant, Duration)>,
    /// All together, seconds.
    pub spent_s: f64,
}

impl<'r> Reports<'r> {
    pub fn new(report: Report<'r>, budget_s: f64) -> Self {
        Self { report, budget_s, latest: None, spent_s: 0.0 }
    }

    /// There was none, and one does not take too much of the budget.
    pub fn may_begin(&self) -> bool {
        self.latest.is_none() && self.reserve_s() <= MOST_SHARE * self.budget_s
    }

    /// One is due after the first, which comes when the run chooses.
    pub fn is_due(&self) -> bool {
        self.latest
            .is_some_and(|(end, took)| end.elapsed() >= INTERVAL.max(took.div_f64(MOST_SHARE)))
    }

    /// Time to keep for the last one, seconds.
    pub fn reserve_s(&self) -> f64 {
        GROWTH * self.latest.map_or(UNSEEN, |(_, took)| took).as_secs_f64()
    }
}

impl Output<'_> {
    /// Makes a report of all records.
    pub fn report(&mut self, schedule: &Schedule) {
        let start = Instant::now();
        let standing = Standing {
            used_s: self.now_s(),
            budget_s: self.reports.budget_s,
            reached: schedule.all().filter(|cell| cell.recorded).count(),
            cells: schedule.all().count(),
        };
        (self.reports.report)(&self.held.output.folder, &self.records, standing);
        let took = start.elapsed();
        self.reports.latest = Some((Instant::now(), took));
        self.reports.spent_s += took.as_secs_f64();
    }
}
