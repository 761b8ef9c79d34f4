//! Errors of a measured cell against its reference, by the kind of its pipeline.

use std::collections::BTreeMap;

use thiserror::Error;

use super::landing::{self, LandingError};
use super::occlusion::{self, OcclusionError};
use super::subject::Subject;
use crate::gpu::Gpu;
use crate::pipelines::Pipeline;

#[derive(Debug, Error)]
pub enum CellError {
    #[error(transparent)]
    Landing(#[from] LandingError),
    #[error(transparent)]
    Occlusion(#[from] OcclusionError),
}

/// Answers of references that several cells share.
#[derive(Default)]
pub struct Known {
    pub occlusion: occlusion::Known,
}

type Judge =
    fn(&Gpu, &Subject, &dyn Pipeline, &mut Known) -> Result<BTreeMap<String, f64>, CellError>;

/// What judges the cells of a kind of pipeline. Adding a reference adds a line.
const JUDGES: &[(&str, Judge)] = &[
    ("underwater", |gpu, subject, pipeline, _| {
        Ok(landing::cell_errors(gpu, subject, pipeline)?)
    }),
    ("volume_ao", |gpu, subject, pipeline, known| {
        Ok(known.occlusion.cell_errors(gpu, subject, pipeline)?)
    }),
    ("hsao", |gpu, subject, pipeline, known| {
        Ok(known.occlusion.cell_errors(gpu, subject, pipeline)?)
    }),
];

/// Errors of the cell's last frame as quantities, the unit in the name; none for a kind that nothing judges.
pub fn cell_errors(
    gpu: &Gpu,
    subject: &Subject,
    pipeline: &dyn Pipeline,
    known: &mut Known,
) -> Result<BTreeMap<String, f64>, CellError> {
    let judge = JUDGES.iter().find(|(kind, _)| *kind == subject.kind.name);
    judge.map_or(Ok(BTreeMap::new()), |(_, judge)| {
        judge(gpu, subject, pipeline, known)
    })
}
