//! Times of a run's cells under names that stay the same from run to run.

use super::ReportView;
use fathom_base::text;
use fathom_record::{Cell, Estimate, Measured};

/// The time of a frame or of a stage in one cell.
pub struct NamedTime {
    /// [`cell_name`], for a stage [`stage_name`].
    pub name: String,
    /// Nanoseconds.
    pub time: Estimate,
}

/// `EXPERIMENT CELL`, which names a cell among those of all experiments.
pub fn cell_name(cell: &Cell) -> String {
    text::key([&*cell.experiment, &*cell.cell])
}

/// `EXPERIMENT CELL STAGE`.
pub fn stage_name(cell: &Cell, stage: &str) -> String {
    text::key([&*cell.experiment, &*cell.cell, stage])
}

/// The frame and the stages of every cell whose frames were timed. A stage's time below the clock's resolution is left out.
pub fn times(view: &ReportView<'_>) -> Vec<NamedTime> {
    view.timed().flat_map(|(cell, measured)| of_cell(cell, measured)).collect()
}

fn of_cell(cell: &Cell, measured: &Measured) -> Vec<NamedTime> {
    let frame = NamedTime { name: cell_name(cell), time: measured.frame.untimed };
    let resolved = measured.stages.iter().filter(|stage| stage.time.n > 0 && stage.is_resolved());
    let stages =
        resolved.map(|stage| NamedTime { name: stage_name(cell, &stage.stage), time: stage.time });
    std::iter::once(frame).chain(stages).collect()
}
