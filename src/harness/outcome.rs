//! From samples to the figures of a record.

use std::collections::BTreeMap;
use std::fmt::Display;

use fathom_clock::{Samples, frame_record, sampling_notes, stage_record};
use fathom_gpu::StageCounters;
use fathom_pipelines::AnyPipeline;
use fathom_record::ceilings::Reads;
use fathom_record::{ErrorFigure, HostCosts, Measured, Note, NoteKind, Picture, StageRecord};

/// What is found out about a cell after its last frame, and what could not be.
#[derive(Clone, Default)]
pub struct CellFindings {
    pub quantities: BTreeMap<String, f64>,
    /// See [`Measured::repeated`].
    pub repeated: BTreeMap<String, Vec<f64>>,
    pub errors: Vec<ErrorFigure>,
    /// By stage, see [`StageRecord::reads`].
    pub reads: BTreeMap<String, Reads>,
    pub notes: Vec<Note>,
    pub pictures: Vec<Picture>,
    pub host: Option<HostCosts>,
}

/// Notes that follow from the samples alone.
const SAMPLE_NOTES: [NoteKind; 5] = [
    NoteKind::Resumed,
    NoteKind::Unsteady,
    NoteKind::Imprecise,
    NoteKind::Outliers,
    NoteKind::Throttled,
];

impl CellFindings {
    /// Those that an earlier run left in a record.
    pub fn recorded(measured: &Measured) -> Self {
        let Measured { stages, quantities, repeated, errors, mut notes, pictures, host, .. } =
            measured.clone();
        notes.retain(|note| !SAMPLE_NOTES.contains(&note.kind));
        let reads = stages.into_iter().filter_map(|stage| Some((stage.stage, stage.reads?)));
        Self { quantities, repeated, errors, reads: reads.collect(), notes, pictures, host }
    }

    /// Those of a cell that is still sampled.
    pub fn unfinished() -> Self {
        let text = "written while it was measured, before its figures other than times were read";
        Self { notes: vec![Note::new(NoteKind::Unfinished, text)], ..Self::default() }
    }

    /// Puts them into a record, in place of those that it has. Quantities that are not finite are left out and noted.
    pub fn add_to(self, measured: &mut Measured) {
        let Self { mut quantities, repeated, mut errors, reads, mut notes, pictures, host } = self;
        measured.notes.retain(|note| SAMPLE_NOTES.contains(&note.kind));
        notes.append(&mut measured.notes);
        let mut is_finite = |name: &str, value: f64| {
            let left_out = || format!("{name} left out: it is not a finite number");
            notes.extend((!value.is_finite()).then(|| Note::new(NoteKind::NotFinite, left_out())));
            value.is_finite()
        };
        quantities.retain(|name, value| is_finite(name, *value));
        errors.retain(|error| is_finite(&error.name, error.value));
        let mut stages = std::mem::take(&mut measured.stages);
        stages.iter_mut().for_each(|of| of.reads = reads.get(&of.stage).copied());
        let of_samples = std::mem::take(measured);
        *measured =
            Measured { stages, quantities, repeated, errors, notes, pictures, host, ..of_samples };
    }
}

impl CellFindings {
    /// What was found; why it was not is noted.
    pub fn noted<T>(
        &mut self,
        kind: NoteKind,
        failure: &str,
        found: Result<T, impl Display>,
    ) -> Option<T> {
        let note = |error| Note::new(kind, format!("{failure}: {error}"));
        found.map_err(|error| self.notes.push(note(error))).ok()
    }

    pub fn add(
        &mut self,
        failure: &str,
        found: Result<impl IntoIterator<Item = (String, f64)>, impl Display>,
    ) {
        let found = self.noted(NoteKind::NotComputed, failure, found);
        self.quantities.extend(found.into_iter().flatten());
    }
}

/// The record of a measured cell.
pub fn build_record(
    samples: &Samples,
    pipeline: &AnyPipeline,
    counters: &[StageCounters],
    found: CellFindings,
) -> Measured {
    let mut measured = Measured {
        stages: stage_records(samples, pipeline, counters),
        frame: frame_record(samples),
        allocated_bytes: pipeline.allocated_bytes(),
        warm_up_frames: samples.warm_up_frames,
        rejected: samples.rejected_frames(),
        notes: sampling_notes(samples),
        ..Measured::default()
    };
    found.add_to(&mut measured);
    measured
}

fn stage_records(
    samples: &Samples,
    pipeline: &AnyPipeline,
    counters: &[StageCounters],
) -> Vec<StageRecord> {
    let stages = pipeline.stages();
    let mut names: Vec<&str> = samples.stages().iter().map(|stage| stage.stage.as_str()).collect();
    if names.is_empty() {
        // Nothing was timed: what is known of its stages is their work.
        names = stages.iter().map(|stage| stage.name()).collect();
    }
    let record = |(index, name): (usize, &str)| {
        let stage = stages.iter().find(|stage| stage.name() == name);
        let (work, min_work) = stage.map(|stage| (stage.work, stage.min_work)).unwrap_or_default();
        let counted = counters.iter().find(|stage| stage.name == name).cloned();
        let StageCounters { counters, passes, targets, .. } = counted.unwrap_or_default();
        StageRecord {
            work,
            least_work: (min_work != work).then_some(min_work),
            counters,
            passes: passes.into_iter().collect(),
            targets: targets.into_iter().collect(),
            ..stage_record(samples, index, name)
        }
    };
    names.into_iter().enumerate().map(record).collect()
}
