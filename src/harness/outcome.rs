//! From samples to the figures of a record.

use std::collections::BTreeMap;

use fathom_clock::{Samples, frame_record, sampling_notes, stage_record};
use fathom_gpu::StageCounters;
use fathom_pipelines::AnyPipeline;
use fathom_record::{Cell, ErrorFigure, Measured, Note, NoteKind, Outcome, Picture, StageRecord};

/// What is found out about a cell after its last frame, and what could not be.
#[derive(Clone, Default)]
pub struct Findings {
    pub quantities: BTreeMap<String, f64>,
    /// See [`Measured::repeated`].
    pub repeated: BTreeMap<String, Vec<f64>>,
    pub errors: Vec<ErrorFigure>,
    pub notes: Vec<Note>,
    pub pictures: Vec<Picture>,
}

/// Cells by what became of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    pub measured: usize,
    pub skipped: usize,
    pub failed: usize,
}

impl Counts {
    pub fn of<'a>(cells: impl IntoIterator<Item = &'a Cell>) -> Self {
        let mut counts = Self::default();
        for cell in cells {
            *match cell.outcome {
                Outcome::Measured(_) => &mut counts.measured,
                Outcome::Skipped { .. } => &mut counts.skipped,
                Outcome::Failed { .. } => &mut counts.failed,
            } += 1;
        }
        counts
    }
}

/// The record of a measured cell, whose frame time was to have this precision. Quantities that are not finite are left out and noted.
pub fn measured(
    samples: &Samples,
    pipeline: &AnyPipeline,
    counters: &[StageCounters],
    found: Findings,
    precision: f64,
) -> Measured {
    let frame = frame_record(samples);
    let Findings { quantities, repeated, errors, mut notes, pictures } = found;
    notes.extend(sampling_notes(samples, &frame.untimed, precision));
    let (quantities, unusable): (BTreeMap<_, _>, BTreeMap<_, _>) =
        quantities.into_iter().partition(|(_, value)| value.is_finite());
    let (errors, unusable_errors): (Vec<_>, Vec<_>) =
        errors.into_iter().partition(|error| error.value.is_finite());
    let unusable =
        unusable.into_keys().chain(unusable_errors.into_iter().map(|error| error.name.to_string()));
    notes.extend(unusable.map(|name| {
        Note::new(NoteKind::NotFinite, format!("{name} left out: it is not a finite number"))
    }));
    Measured {
        stages: stage_records(samples, pipeline, counters),
        frame,
        allocated_bytes: pipeline.allocated_bytes(),
        quantities: quantities.into(),
        repeated,
        errors,
        warm_up_frames: samples.warm_up_frames,
        rejected: samples.rejected_frames(),
        notes,
        pictures,
    }
}

fn stage_records(
    samples: &Samples,
    pipeline: &AnyPipeline,
    counters: &[StageCounters],
) -> Vec<StageRecord> {
    let stages = pipeline.stages();
    let work = |name: &str| {
        let found = stages.iter().find(|stage| stage.name() == name);
        found.map(|stage| (stage.work, stage.least_work)).unwrap_or_default()
    };
    let counted = |name: &str| {
        let found = counters.iter().find(|stage| stage.name == name);
        found.map(|stage| stage.counters.clone()).unwrap_or_default()
    };
    let mut names: Vec<&str> = samples.stages().iter().map(|stage| stage.stage.as_str()).collect();
    if names.is_empty() {
        // Nothing was timed: what is known of its stages is their work.
        names = stages.iter().map(|stage| stage.name()).collect();
    }
    let record =
        |stage: (usize, &str)| stage_record(samples, stage, work(stage.1), counted(stage.1));
    names.into_iter().enumerate().map(record).collect()
}
