//! What commands work on, by name: pipelines, shaders, scenes, experiments, checks and gate cells. A crate of one's own hands in
//! a catalogue of its own.

use super::subject::SubjectError;
use super::verify::{self, Case};
use crate::embedded::{EXPERIMENTS, Folder, Folders, SCENES, SHADERS};
use crate::experiments::nearest;
use crate::gpu::StageInfo;
use crate::pipelines::{KINDS, Kind, Pipeline};
use crate::stages;

/// Everything that the commands know by name.
#[derive(Clone, Debug)]
pub struct Catalog {
    pub kinds: Vec<Kind>,
    /// In frame order.
    pub stages: Vec<&'static StageInfo>,
    pub shaders: Folders,
    pub scenes: Folders,
    pub experiments: Folders,
    checks: Vec<fn() -> Vec<Case>>,
    /// Name and text of the gates' cells.
    pub gates: (&'static str, &'static str),
}

impl Default for Catalog {
    fn default() -> Self {
        Self::builtin()
    }
}

impl Catalog {
    /// What fathom brings.
    pub fn builtin() -> Self {
        Self {
            kinds: KINDS.to_vec(),
            stages: stages::REGISTRY.iter().collect(),
            shaders: Folders::of(SHADERS),
            scenes: Folders::of(SCENES),
            experiments: Folders::of(EXPERIMENTS),
            checks: vec![verify::cases],
            gates: ("benches/gates.toml", include_str!("../../benches/gates.toml")),
        }
    }

    /// Adds a pipeline. Its stages are listed with those that are known.
    #[must_use]
    pub fn pipeline<P: Pipeline>(mut self) -> Self {
        let kind = Kind::of::<P>();
        for stage in kind.stages() {
            if !self.stages.iter().any(|known| known.name == stage.name) {
                self.stages.push(stage);
            }
        }
        self.kinds.push(kind);
        self
    }

    /// Adds stages that no pipeline's frame runs.
    #[must_use]
    pub fn stages(mut self, stages: &'static [StageInfo]) -> Self {
        self.stages.extend(stages);
        self
    }

    /// Adds shaders. They may import the modules `fathom::…`.
    #[must_use]
    pub fn shaders(self, folder: Folder) -> Self {
        Self { shaders: self.shaders.and(folder), ..self }
    }

    /// Adds scene files.
    #[must_use]
    pub fn scenes(self, folder: Folder) -> Self {
        Self { scenes: self.scenes.and(folder), ..self }
    }

    /// Adds experiments.
    #[must_use]
    pub fn experiments(self, folder: Folder) -> Self {
        Self { experiments: self.experiments.and(folder), ..self }
    }

    /// Runs these experiments in place of fathom's own.
    #[must_use]
    pub fn only_experiments(self, folder: Folder) -> Self {
        Self { experiments: Folders::of(folder), ..self }
    }

    /// Adds checks.
    #[must_use]
    pub fn checks(mut self, cases: fn() -> Vec<Case>) -> Self {
        self.checks.push(cases);
        self
    }

    /// Compares these gate cells in place of fathom's own. `name` is for messages.
    #[must_use]
    pub fn gates(self, name: &'static str, text: &'static str) -> Self {
        Self { gates: (name, text), ..self }
    }

    /// The kind of pipeline of a name.
    ///
    /// # Errors
    /// There is none, with the name that is most like it.
    pub fn kind(&self, name: &str) -> Result<Kind, SubjectError> {
        let found = self.kinds.iter().find(|kind| kind.name == name);
        found.copied().ok_or_else(|| SubjectError::UnknownPipeline {
            name: name.to_owned(),
            nearest: nearest(name, self.kinds.iter().map(|kind| kind.name)),
        })
    }

    /// Every check, in frame order.
    pub fn cases(&self) -> Vec<Case> {
        self.checks.iter().flat_map(|cases| cases()).collect()
    }
}
