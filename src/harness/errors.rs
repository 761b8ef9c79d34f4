//! Errors of a measured cell against its reference, by the kind of its pipeline.

use std::collections::BTreeMap;

use thiserror::Error;

use super::landing::{self, LandingError};
use super::occlusion::{self, FILTERED, OcclusionError, RAW};
use super::subject::Subject;
use crate::gpu::Gpu;
use crate::pipelines::AnyPipeline;

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
    fn(&Gpu, &Subject, &dyn AnyPipeline, &mut Known) -> Result<BTreeMap<String, f64>, CellError>;

/// What judges the cells of a kind of pipeline. Adding a reference adds a line.
const JUDGES: &[(&str, Judge)] = &[
    ("underwater", |gpu, subject, pipeline, _| Ok(landing::cell_errors(gpu, subject, pipeline)?)),
    ("volume_ao", |gpu, subject, pipeline, known| {
        Ok(known.occlusion.cell_errors(gpu, subject, pipeline)?)
    }),
    ("hsao", |gpu, subject, pipeline, known| {
        Ok(known.occlusion.cell_errors(gpu, subject, pipeline)?)
    }),
];

/// How the names of errors begin, the longer of two beginnings first, and the stages whose output they judge. Adding a reference
/// adds a line.
const JUDGED: &[(&str, &[&str])] = &[
    ("caustics_photon_", &["caustics/trace"]),
    ("caustics_unconverged_", &["caustics/trace"]),
    ("godrays_photon_", &["godrays/trace"]),
    ("godrays_unconverged_", &["godrays/trace"]),
    (AO_FILTERED, &FILTERED),
    (AO, &RAW),
];
const AO_FILTERED: &str = "ao_filtered_";
const AO: &str = "ao_";

/// The stages, of which a pipeline has one, whose output an error judges; none for a name that is not known.
pub fn judged_stages(error: &str) -> &'static [&'static str] {
    let mut judged = JUDGED.iter();
    let known = judged.find(|(beginning, _)| error.starts_with(beginning));
    known.map_or(&[], |(_, stages)| stages)
}

/// Name of the same error before the stage whose output `error` judges, if it is judged there too: what grew there already is
/// not this stage's.
pub fn error_before(error: &str) -> Option<String> {
    Some(AO.to_owned() + error.strip_prefix(AO_FILTERED)?)
}

/// Errors of the cell's last frame as quantities, the unit in the name; none for a kind that nothing judges.
pub fn cell_errors(
    gpu: &Gpu,
    subject: &Subject,
    pipeline: &dyn AnyPipeline,
    known: &mut Known,
) -> Result<BTreeMap<String, f64>, CellError> {
    let judge = JUDGES.iter().find(|(kind, _)| *kind == subject.kind.name);
    judge.map_or(Ok(BTreeMap::new()), |(_, judge)| judge(gpu, subject, pipeline, known))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_judges_registered_stages_and_what_it_starts_from() {
        assert_eq!(judged_stages("caustics_photon_miss_rate"), ["caustics/trace"]);
        assert_eq!(judged_stages("ao_bias"), RAW);
        assert_eq!(judged_stages("ao_filtered_bias"), FILTERED);
        assert!(judged_stages("caustics_error_rms").is_empty());
        assert_eq!(error_before("ao_filtered_bias").unwrap(), "ao_bias");
        assert_eq!(error_before("ao_bias"), None);
        let known = |name: &&str| {
            let mut registered = crate::stages::REGISTRY.iter();
            registered.any(|stage| stage.name == *name)
        };
        let mut stages = JUDGED.iter().flat_map(|(_, stages)| *stages);
        assert!(stages.all(known));
    }
}
