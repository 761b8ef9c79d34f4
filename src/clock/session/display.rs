//! What was measured, for the terminal.

use std::fmt;

use super::FrameClock;
use fathom_base::visits::MIN_VISITS;
use fathom_record::{Cell, Estimate, Interval, PassKind, StageRecord};

/// The clock of each kind of pass with the audit's reason where timestamps are unsound, and each ended cell: times with their
/// 95 % intervals, and notes.
impl fmt::Display for FrameClock {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{} ({})", self.gpu.adapter.name, self.gpu.adapter.driver_info)?;
        for kind in PassKind::TIMED {
            let clock = self.audit.plan.clock(kind).name();
            write!(f, "{kind} passes: {clock} clock")?;
            let mut rows = self.audit.rows.iter().filter(|row| row.pass == kind && !row.sound);
            match rows.next() {
                Some(row) => writeln!(f, "; {}", row.reason)?,
                None => writeln!(f)?,
            }
        }
        self.cells().iter().try_for_each(|cell| write_cell(f, cell))
    }
}

fn write_cell(f: &mut fmt::Formatter<'_>, cell: &Cell) -> fmt::Result {
    writeln!(f, "\n{} {}", cell.experiment, cell.cell)?;
    let Some(measured) = cell.measured() else {
        return writeln!(f, "  {}", cell.outcome.words().join(": "));
    };
    for stage in &measured.stages {
        writeln!(f, "  {:<20} {}", stage.stage, stage_time(stage))?;
    }
    writeln!(f, "  {:<20} {}", "frame, untimed", milliseconds(&measured.frame.untimed))?;
    let cost = &measured.frame.timing_cost;
    writeln!(f, "  timing each pass makes a frame take {:.2} times as long", cost.median)?;
    measured.notes.iter().try_for_each(|note| writeln!(f, "  note: {}", note.text))
}

fn stage_time(stage: &StageRecord) -> String {
    let clock = stage.clock.name();
    if stage.is_resolved() {
        return format!("{}  {clock}", milliseconds(&stage.time));
    }
    format!("< {:.4} ms, the clock's resolution  {clock}", stage.resolution_ns() * 1e-6)
}

fn milliseconds(time: &Estimate) -> String {
    let (ms, visits) = (|ns: f64| format!("{:.4}", ns * 1e-6), time.n);
    match time.interval.map(|Interval { low, high }| [low, high].map(ms).join(" … ")) {
        Some(interval) => format!("{} ms ({interval}, {visits} visits)", ms(time.median)),
        None => format!("{} ms (no interval: {visits} visits of {MIN_VISITS})", ms(time.median)),
    }
}
