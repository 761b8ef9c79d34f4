//! Experiments as data: a pipeline, a scene, base parameters, sweeps over axes, what was published, and the
//! claims to test. The built-in ones (`benches/experiments/*.toml`) and a user's own file have the
//! same format, described in [`schema`].

mod claims;
mod expand;
#[cfg(any(test, feature = "fixtures"))]
pub mod fixtures;
mod measure;
pub mod schema;
#[cfg(test)]
mod tests;
mod units;
pub mod words;

use std::path::{Path, PathBuf};

use fathom_base::input;
use fathom_base::text::{did_you_mean, line, nearest};
use fathom_embedded::{EXPERIMENTS, Folders};

pub use claims::{
    CHANCE, LOOKS, RuledFigure, Ruling, Scaling, Verdict, concerned, groups, least_samples, scaling,
};
pub use expand::{
    CellPlan, MAX_CELLS, MAX_PLAN_BYTES, ReferencePlan, RepetitionPlan, flatten, label_text,
    parse_axis, parse_set,
};
pub use measure::{Measure, Reading, Sample, StageName, fits, fps, lookup, same};
pub use schema::Experiment;

#[derive(Debug, thiserror::Error)]
pub enum ExperimentError {
    #[error("unknown experiment `{name}`{}", did_you_mean(nearest))]
    Unknown { name: String, nearest: Option<String> },
    #[error("cannot read the experiment {}: {source}", path.display())]
    Read { path: PathBuf, source: std::io::Error },
    #[error("experiment `{name}`: {}", line(.message))]
    Invalid { name: String, message: String },
    #[error("experiment `{experiment}` has no axis `{axis}`{}", did_you_mean(nearest))]
    UnknownAxis { experiment: String, axis: String, nearest: Option<String> },
    #[error("axis `{}` of `{experiment}`: {}", line(.axis), line(.message))]
    AxisValue { experiment: String, axis: String, message: String },
    #[error(
        "`{path}` is swept by the axis `{axis}` of `{experiment}`: choose its values with --axis {axis}=…"
    )]
    SetOnAxis { experiment: String, axis: String, path: String },
    #[error(
        "experiment `{experiment}` has {cells} cells, references and views counted too: at most {MAX_CELLS} are planned at once"
    )]
    TooManyCells { experiment: String, cells: u64 },
    #[error(
        "experiment `{experiment}`: its cells, each with its parameters, take {} MiB: at most {} MiB are planned at once",
        bytes >> 20,
        MAX_PLAN_BYTES >> 20
    )]
    TooLarge { experiment: String, bytes: u64 },
    #[error("`{text}` is not of the form {form}")]
    Assignment { text: String, form: &'static str },
}

impl Experiment {
    /// Names of the built-in experiments, in alphabetical order.
    pub fn builtin_ids() -> Vec<String> {
        Experiment::ids(&Folders::of(EXPERIMENTS))
    }

    pub fn builtin_text(id: &str) -> Option<String> {
        EXPERIMENTS.text(&format!("{id}.toml"))
    }

    /// Loads a built-in experiment by its id, or a file by its path (a name that ends in `.toml` or holds a separator).
    pub fn load(id_or_path: &str) -> Result<Experiment, ExperimentError> {
        Experiment::load_from(&Folders::of(EXPERIMENTS), id_or_path)
    }

    /// Names of the experiments in these folders, in alphabetical order.
    pub fn ids(folders: &Folders) -> Vec<String> {
        folders.stems(".toml").collect()
    }

    /// Loads an experiment of these folders by its id, or a file by its path.
    pub fn load_from(folders: &Folders, id_or_path: &str) -> Result<Experiment, ExperimentError> {
        if let Some((_, text)) = folders.text(&format!("{id_or_path}.toml")) {
            return Experiment::parse(id_or_path, &text);
        }
        let path = Path::new(id_or_path);
        let is_path = id_or_path.ends_with(".toml") || path.components().count() > 1;
        if !is_path {
            let ids = Experiment::ids(folders);
            return Err(ExperimentError::Unknown {
                name: id_or_path.to_owned(),
                nearest: nearest(id_or_path, ids.iter().map(String::as_str)),
            });
        }
        Experiment::read(path)
    }

    pub fn read(path: &Path) -> Result<Experiment, ExperimentError> {
        let text = input::text(path, input::MAX_TEXT)
            .map_err(|source| ExperimentError::Read { path: path.to_owned(), source })?;
        Experiment::parse(&path.display().to_string(), &text)
    }
}
