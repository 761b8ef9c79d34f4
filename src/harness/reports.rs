//! Output of a run: its records, and reports of the records so far, which the caller makes.

use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use itertools::Itertools as _;

use super::beside::Beside;
use super::cell_progress::Done;
use super::progress::Progress;
use super::schedule::Schedule;
use fathom_record::output::Recording;
use fathom_record::{Cell, Record, RecordError, Run, RunProgress};

/// Kept for the last records and the end of the process, seconds.
const LAST_STEPS_S: f64 = 0.2;

/// Shortest time between two reports.
const INTERVAL: Duration = Duration::from_secs(60);
/// Largest share of the time that reports take.
const MAX_SHARE: f64 = 0.03;
/// What the last report takes longer than the one before: it has more cells.
const GROWTH: f64 = 1.5;
/// Foreseen for a report before the first.
const UNSEEN: Duration = Duration::from_millis(500);

/// Makes a report of these records in this folder.
pub type MakeReport = Arc<dyn Fn(&Path, &[Record], RunProgress) + Send + Sync>;

/// When reports are made.
pub struct Reports {
    report: MakeReport,
    pub budget_s: f64,
    /// The end of the latest, and how long it took.
    latest: Option<(Instant, Duration)>,
    /// One is made beside.
    is_made: bool,
    /// The run has ended: none is written over the last.
    ended: Arc<Mutex<bool>>,
    /// What the run has waited for all of them, seconds.
    pub spent_s: f64,
}

impl Reports {
    pub fn new(report: MakeReport, budget_s: f64) -> Self {
        let ended = Arc::default();
        Self { report, budget_s, latest: None, is_made: false, ended, spent_s: 0.0 }
    }

    /// There was none, and one does not take too much of the budget.
    pub fn may_begin(&self) -> bool {
        !self.is_made && self.latest.is_none() && self.reserve_s() <= MAX_SHARE * self.budget_s
    }

    /// One is due after the first, which comes when the run chooses.
    pub fn is_due(&self) -> bool {
        let is_due = |(end, took): (Instant, Duration)| {
            end.elapsed() >= INTERVAL.max(took.div_f64(MAX_SHARE))
        };
        !self.is_made && self.latest.is_some_and(is_due)
    }

    pub fn made(&mut self, took: Duration) {
        (self.is_made, self.latest) = (false, Some((Instant::now(), took)));
    }

    /// No further one is written once this returns.
    pub fn end(&self) {
        *self.ended.lock().unwrap_or_else(PoisonError::into_inner) = true;
    }

    /// Time to keep for the last one, seconds.
    pub fn reserve_s(&self) -> f64 {
        GROWTH * self.latest.map_or(UNSEEN, |(_, took)| took).as_secs_f64()
    }
}

/// Where records, pictures, reports and progress go.
pub struct RunOutput {
    /// When the command began.
    pub start: Instant,
    pub folder: Recording,
    pub header: Run,
    pub progress: Progress,
    pub reports: Reports,
    /// Everything that the file of records holds.
    pub records: Vec<Record>,
}

impl RunOutput {
    pub fn write(&mut self, record: Record) -> Result<(), RecordError> {
        self.folder.writer.write(&record)?;
        self.records.push(record);
        Ok(())
    }

    /// Writes the record of a cell that is done before anything is said of it.
    pub fn finish(&mut self, cell: Cell) -> Result<(), RecordError> {
        self.finish_all(vec![cell])
    }

    /// The same of several, in one piece.
    pub fn finish_all(&mut self, cells: Vec<Cell>) -> Result<(), RecordError> {
        cells.iter().for_each(|cell| self.progress.finished(cell));
        let records = cells.into_iter().map(|cell| Record::Cell(Box::new(cell))).collect_vec();
        self.folder.writer.write_all(&records)?;
        self.records.extend(records);
        Ok(())
    }

    /// When no further step begins but the last report.
    pub fn deadline_s(&self) -> f64 {
        self.reports.budget_s - self.reports.reserve_s() - LAST_STEPS_S
    }

    pub fn now_s(&self) -> f64 {
        self.start.elapsed().as_secs_f64()
    }

    /// Makes a report of all records.
    pub fn report(&mut self, schedule: &Schedule, beside: &mut Beside<Done>) {
        let start = Instant::now();
        let standing = RunProgress {
            used_s: self.now_s(),
            budget_s: self.reports.budget_s,
            reached: schedule.all().filter(|cell| cell.recorded).count(),
            cells: schedule.all().count(),
        };
        let Reports { report, ended, .. } = &self.reports;
        let (report, ended) = (Arc::clone(report), Arc::clone(ended));
        let (folder, records) = (self.folder.output.folder.clone(), self.records.clone());
        self.reports.is_made = true;
        let made = beside.run(move || {
            let start = Instant::now();
            let has_ended = ended.lock().unwrap_or_else(PoisonError::into_inner);
            if !*has_ended {
                report(&folder, &records, standing);
            }
            Done::Report(start.elapsed())
        });
        if let Some(Done::Report(took)) = made {
            self.reports.made(took);
        }
        self.reports.spent_s += start.elapsed().as_secs_f64();
    }
}
