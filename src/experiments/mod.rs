//! Experiments as data: a pipeline, a scene, base parameters, sweeps over axes, what was published, and the
//! claims to test. The built-in ones (`benches/experiments/*.toml`) and a user's own file have the
//! same format, described in [`schema`].

mod claims;
pub mod defaults;
mod expand;
#[cfg(any(test, feature = "fixtures"))]
pub mod fixtures;
mod measure;
pub mod schema;
#[cfg(test)]
mod tests;
mod units;
pub mod words;

use std::path::Path;

use fathom_base::embedded::{EXPERIMENTS, Folders};
use fathom_base::input;
use fathom_base::text::{did_you_mean, line};

pub use claims::{
    CHANCE, ClaimOrigin, NO_VISIT, RuledFigure, Ruling, Scaling, SizeRatios, Verdict,
    claimed_cells, groups, scaling, thin_out,
};
pub use expand::{
    CellPlan, MAX_CELLS, ReferencePlan, RepetitionPlan, flatten, label_text, parse_axis, parse_set,
};
pub use measure::{Measure, Quantity, RoundSample, StageName, fits, fps, same};
pub use schema::{Experiment, Fault};

/// What is wrong with an experiment, or with what was asked of it: one line.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct ExperimentError(String);

impl ExperimentError {
    /// A fault of the experiment of this name, or in this file.
    pub fn new(name: &str, fault: &str) -> Self {
        Self(format!("experiment `{name}`: {}", line(fault)))
    }
}

impl Experiment {
    /// Names of the built-in experiments, in alphabetical order.
    pub fn builtin_ids() -> Vec<String> {
        Experiment::ids(&Folders::new(EXPERIMENTS))
    }

    pub fn builtin_text(id: &str) -> Option<String> {
        Some(schema::with_method(&EXPERIMENTS.text(&format!("{id}.toml"))?))
    }

    /// Loads a built-in experiment by its id, or a file by its path (a name that ends in `.toml` or holds a separator).
    pub fn load(id_or_path: &str) -> Result<Experiment, ExperimentError> {
        Experiment::load_from(&Folders::new(EXPERIMENTS), id_or_path)
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
            let near = did_you_mean(id_or_path, ids.iter().map(String::as_str));
            let list = if near.is_empty() { "; see `fathom list experiments`" } else { "" };
            return Err(ExperimentError(format!("unknown experiment `{id_or_path}`{near}{list}")));
        }
        Experiment::read(path)
    }

    pub fn read(path: &Path) -> Result<Experiment, ExperimentError> {
        let name = path.display().to_string();
        let unread = |fault| ExperimentError(format!("cannot read the experiment {name}: {fault}"));
        Experiment::parse(&name, &input::text(path, input::MAX_TEXT).map_err(unread)?)
    }
}
