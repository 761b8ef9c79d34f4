//! What is known of cells: their samples, records and figures, from batch to batch.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use super::outcome::CellFindings;
use super::plan::PlannedExperiment;
use fathom_clock::Samples;
use fathom_gpu::StageCounters;
use fathom_record::{Cell, Earlier, Measured, Outcome, Record, SetUp};

/// What is known of an experiment's cells from batch to batch.
#[derive(Default)]
pub struct CellProgress {
    /// The latest record of each cell, by its name; of an earlier run too.
    pub records: BTreeMap<String, Cell>,
    /// What was sampled of each cell.
    pub samples: BTreeMap<usize, Samples>,
    /// Of each cell, once it was found out.
    pub findings: BTreeMap<usize, CellFindings>,
    /// Of these they are found out beside.
    pub awaited: BTreeSet<usize>,
    pub counters: BTreeMap<usize, Vec<StageCounters>>,
    /// A picture has been tried.
    pub pictured: bool,
}

/// What was done beside.
pub enum Done {
    Figures(Box<ComputedFigures>),
    Report(Duration),
}

/// What was computed from a cell's read-backs: the numbers of its experiment and its own, and what parts of it took, seconds.
pub struct ComputedFigures {
    pub place: (usize, usize),
    pub findings: CellFindings,
    pub took_s: BTreeMap<SetUp, f64>,
}

impl CellProgress {
    pub fn is_read(&self, cell: usize) -> bool {
        self.findings.contains_key(&cell) || self.awaited.contains(&cell)
    }

    pub fn keep_findings(&mut self, cell: usize, findings: CellFindings) {
        self.awaited.remove(&cell);
        self.findings.insert(cell, findings);
    }

    /// Puts what was found out beside into the cell's latest record, if it still has one.
    pub fn complete(&mut self, computed: ComputedFigures, name: &str) -> Option<&mut Measured> {
        self.keep_findings(computed.place.1, computed.findings.clone());
        let Outcome::Measured(measured) = &mut self.records.get_mut(name)?.outcome else {
            return None;
        };
        computed.findings.add_to(measured);
        Some(measured)
    }

    /// With the records of earlier runs, and those by resume key whose samples may be gone on with.
    pub fn new(
        planned: &PlannedExperiment,
        before: &[Record],
        earlier: &BTreeMap<String, Earlier<'_>>,
    ) -> Self {
        let cells = before.iter().filter_map(Record::try_as_cell_ref);
        let own = cells.filter(|cell| cell.experiment == planned.experiment.id);
        let finished = own.filter(|cell| cell.measured().is_none_or(Measured::is_finished));
        let records: BTreeMap<String, Cell> =
            finished.map(|cell| (cell.cell.clone(), Cell::clone(cell))).collect();
        let mut measured = records.values().filter_map(Cell::measured);
        let pictured = measured.any(|measured| !measured.pictures.is_empty());
        let mut known = Self { records, pictured, ..Self::default() };
        for (index, cell) in planned.cells.iter().enumerate() {
            let earlier = earlier.get(&cell.resume_key).filter(|earlier| earlier.is_continued);
            let Some(measured) = earlier.and_then(|earlier| earlier.cell.measured()) else {
                continue;
            };
            known.samples.insert(index, Samples::recorded(measured));
            if measured.is_finished() {
                known.findings.insert(index, CellFindings::recorded(measured));
            }
        }
        known
    }
}
