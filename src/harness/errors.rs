//! Errors of a measured cell against its reference, by the kind of its pipeline.

use std::collections::BTreeMap;

use thiserror::Error;

use super::landing::{self, LandingError};
use super::occlusion::{self, FILTERED, OcclusionError, RAW};
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

/// What errors of a name judge. Adding a reference adds a line.
struct Judged {
    /// How their names begin.
    prefix: &'static str,
    /// Stages that leave what they judge; a pipeline has one of them.
    stages: &'static [&'static str],
    /// How the names begin of the same errors of what that stage starts from.
    before: Option<&'static str>,
}

/// The longer of two prefixes comes first.
const JUDGED: [Judged; 4] = [
    Judged {
        prefix: "caustics_",
        stages: &["caustics/trace"],
        before: None,
    },
    Judged {
        prefix: "godrays_",
        stages: &["godrays/trace"],
        before: None,
    },
    Judged {
        prefix: "ao_filtered_",
        stages: &FILTERED,
        before: Some("ao_"),
    },
    Judged {
        prefix: "ao_",
        stages: &RAW,
        before: None,
    },
];

/// The stages, of which a pipeline has one, whose output an error judges; none for a name that is not known.
pub fn judged_stages(error: &str) -> &'static [&'static str] {
    let judged = JUDGED
        .iter()
        .find(|judged| error.starts_with(judged.prefix));
    judged.map_or(&[], |judged| judged.stages)
}

/// Name of the same error before the stage whose output `error` judges, if it is judged there too: what grew there already is
/// not this stage's.
pub fn error_before(error: &str) -> Option<String> {
    let mut judged = JUDGED.iter();
    judged.find_map(|judged| {
        let rest = error.strip_prefix(judged.prefix)?;
        Some(judged.before?.to_owned() + rest)
    })
}

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_judges_registered_stages_and_what_it_starts_from() {
        assert_eq!(
            judged_stages("caustics_photon_miss_rate"),
            ["caustics/trace"]
        );
        assert_eq!(judged_stages("ao_bias"), RAW);
        assert_eq!(judged_stages("ao_filtered_bias"), FILTERED);
        assert!(judged_stages("compose_rmse").is_empty());
        assert_eq!(error_before("ao_filtered_bias").unwrap(), "ao_bias");
        assert_eq!(error_before("ao_bias"), None);
        let known = |name: &&str| {
            let mut registered = crate::stages::REGISTRY.iter();
            registered.any(|stage| stage.name == *name)
        };
        let mut stages = JUDGED.iter().flat_map(|judged| judged.stages);
        assert!(stages.all(known));
    }
}
