//! What was measured, as records that `fathom report`, `fathom compare` and `fathom history` read.

use std::path::Path;
use std::time::Instant;

use itertools::Itertools;

use super::{CellSampling, FEATURES, FrameClock};
use crate::{ClockError, Samples, StageTime, frame_record, sampling_notes, stage_record};
use fathom_base::{private, text};
use fathom_record::output::{FolderKind, LockedFolder, OutputError};
use fathom_record::{
    Cell, Conditions, End, Measured, Note, NoteKind, Outcome, PassKind, Record, Run, SCHEMA, SetUp,
    ShaderChecks,
};

impl FrameClock {
    /// Makes a cell of what was sampled since the last one, and begins another with a warm-up. `experiment` is the program's name:
    /// lower-case letters, digits and `-`. `cell` tells this cell from its others, such as `size=512,filter=box`, or `base` where
    /// there is one.
    ///
    /// # Errors
    /// `experiment` is no such name. The samples are kept.
    pub fn end_cell(&mut self, experiment: &str, cell: &str) -> Result<&Cell, ClockError> {
        text::check_id(experiment).map_err(ClockError::Name)?;
        let next = CellSampling::begin(self.sampled.round);
        let samples = std::mem::replace(&mut self.sampled, next).samples;
        self.started = Instant::now();
        let axes = cell.split(',').filter_map(|axis| axis.split_once('='));
        self.cells.push(Cell {
            experiment: experiment.to_owned(),
            cell: cell.to_owned(),
            axes: axes.map(|(name, value)| (name.to_owned(), value.into())).collect(),
            pipeline: experiment.to_owned(),
            scene: "none".to_owned(),
            stand_ins: Vec::new(),
            sources: Default::default(),
            params: Default::default(),
            outcome: self.outcome(&samples),
        });
        Ok(&self.cells[self.cells.len() - 1])
    }

    fn outcome(&self, samples: &Samples) -> Outcome {
        if let Some(reason) = samples.verdict_on_rejections() {
            return Outcome::Failed { reason };
        }
        if samples.pairs() == 0 {
            return Outcome::Failed { reason: "no pair of frames was sampled".to_owned() };
        }
        let frame = frame_record(samples);
        let record =
            |(index, stage): (usize, &StageTime)| stage_record(samples, index, &stage.stage);
        Outcome::Measured(Box::new(Measured {
            stages: samples.stages().iter().enumerate().map(record).collect(),
            notes: sampling_notes(samples),
            frame,
            warm_up_frames: samples.warm_up_frames,
            rejected: samples.rejected_frames(),
            ..Measured::default()
        }))
    }

    /// Cells that have ended.
    pub fn cells(&self) -> &[Cell] {
        &self.cells
    }

    /// Writes the records of all ended cells to `records.jsonl` in a folder, which is made where there is none.
    ///
    /// # Errors
    /// The folder holds records already, another process writes to it, or it cannot be written to.
    pub fn write(&self, folder: &Path) -> Result<(), ClockError> {
        let locked = LockedFolder::lock_free(folder).map_err(|error| match error {
            OutputError::Occupied { path } => ClockError::Occupied { path },
            other => other.into(),
        })?;
        let mut folder_lock = locked.open(FolderKind::Run)?;
        let cells = self.cells.iter().map(|cell| Record::Cell(Box::new(cell.clone())));
        let records = std::iter::once(Record::Run(Box::new(self.run())))
            .chain(cells)
            .chain([Record::End(self.end())])
            .collect_vec();
        Ok(folder_lock.writer.write_all(&records).map_err(OutputError::from)?)
    }

    fn run(&self) -> Run {
        let (plan, gpu) = (&self.audit.plan, &self.gpu);
        let missing = (FEATURES - gpu.features).iter_names().map(|(name, _)| name).join(", ");
        let missing = (!missing.is_empty()).then(|| {
            let text = format!("the device was opened without {missing}");
            Note::new(NoteKind::Adapter, text)
        });
        let order = "timed and untimed frames alternate, in an order that is the same in each run";
        Run {
            schema: SCHEMA,
            fathom_version: env!("CARGO_PKG_VERSION").to_owned(),
            started_at: self.totals.started_at.clone(),
            command: private::command(),
            adapter: gpu.adapter.clone(),
            shader_checks: ShaderChecks::Checked,
            conditions: Conditions::detect(),
            clocks: PassKind::TIMED.map(|kind| (kind, plan.clock(kind))).into(),
            audit: self.audit.rows.clone(),
            submit_cost_ns: PassKind::TIMED.map(|kind| (kind, plan.submit_cost.ns(kind))).into(),
            notes: missing.into_iter().chain([Note::new(NoteKind::Order, order)]).collect(),
            ..Run::default()
        }
    }

    fn end(&self) -> End {
        let totals = &self.totals;
        End {
            measuring_wall_s: totals.started.elapsed().as_secs_f64() - totals.audit_s,
            measured_gpu_s: totals.frames_ns * 1e-9,
            set_up_s: totals.audit_s,
            set_up_parts_s: [(SetUp::Audit, totals.audit_s)].into(),
            peak_memory_bytes: None,
            interrupted: false,
        }
    }
}
