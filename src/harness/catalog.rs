//! What commands work on, by name: pipelines, shaders, scenes, experiments, checks and gate cells. A program of another crate passes
//! its own catalogue.

use std::fs::File;
use std::io::{self, Read};

use serde_json::Value;
use thiserror::Error;

use fathom_base::BUILT_WITH;
use fathom_base::embedded::{EXPERIMENTS, FIGURES, Folder, Folders, SCENES, SHADERS};
use fathom_base::input;
use fathom_base::parameter::{self, Allowed, ParamError, ParamField};
use fathom_base::text::did_you_mean;
use fathom_gpu::StageInfo;
use fathom_pipelines as pipelines;
use fathom_pipelines::{KINDS, Pipeline, PipelineKind};
use fathom_record::Build;
use fathom_scene::{Scene, SceneError, SceneFile};
use fathom_stages as stages;
use fathom_verify as verify;
use fathom_verify::Case;

/// What cargo calls a program: `cargo build -p PACKAGE --bin BINARY`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CargoTarget {
    pub package: &'static str,
    pub binary: &'static str,
}

impl CargoTarget {
    pub const FATHOM: Self = Self { package: "fathom", binary: "fathom" };
}

/// Why a pipeline, a scene and parameters do not go together. Each message says what to do.
#[derive(Debug, Error)]
pub enum SubjectError {
    #[error("unknown pipeline `{name}`{hint}")]
    UnknownPipeline { name: String, hint: String },
    #[error("pipeline {pipeline} has no parameter `{path}`, which is one of {}", .owners.join(", "))]
    OfAnother { pipeline: &'static str, path: String, owners: Vec<&'static str> },
    #[error(transparent)]
    Scene(#[from] SceneError),
    #[error(transparent)]
    Param(#[from] ParamError),
    #[error("{0}")]
    Invalid(String),
}

/// Everything that the commands know by name.
#[derive(Clone, Debug)]
pub struct Catalog {
    /// The program itself: `compare --base REV` builds it of that revision.
    pub program: CargoTarget,
    /// Hash of the commit that the program was built of, with `-dirty` behind it where files differed; empty outside a repository.
    revision: &'static str,
    /// Digest of all code that the program runs on the host; empty where it does not know.
    pub host_code: &'static str,
    pub kinds: Vec<PipelineKind>,
    pub shaders: Folders,
    pub scenes: Folders,
    pub experiments: Folders,
    pub figures: Folders,
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
    pub fn builtin() -> Self {
        Self {
            program: CargoTarget::FATHOM,
            revision: "",
            host_code: "",
            kinds: KINDS.to_vec(),
            shaders: Folders::new(SHADERS),
            scenes: Folders::new(SCENES),
            experiments: Folders::new(EXPERIMENTS),
            figures: Folders::new(FIGURES),
            checks: vec![verify::cases],
            gates: ("benches/gates.toml", include_str!("../../benches/gates.toml")),
        }
    }

    /// What the program was built of, as records hold it.
    pub fn build(&self) -> Build {
        let with = BUILT_WITH.map(|(name, value)| (name.to_owned(), value.to_owned()));
        Build { with: with.into(), ..Build::described(self.revision) }
    }

    /// Digest of this program's file and of the shaders, which a development build reads from its checkout.
    pub fn digest(&self) -> io::Result<String> {
        let program = File::open(std::env::current_exe()?)?;
        let shaders: String = self.shaders.texts(".wgsl").into_iter().map(|of| of.1).collect();
        input::digest(program.chain(shaders.as_bytes()))
    }

    /// Names the revision, as `git describe --always --dirty=-dirty --abbrev=40 --exclude='*'` gives it.
    #[must_use]
    pub fn with_revision(self, revision: &'static str) -> Self {
        Self { revision, ..self }
    }

    /// Names by a digest all sources and libraries that the program was compiled of.
    #[must_use]
    pub fn with_host_code(self, host_code: &'static str) -> Self {
        Self { host_code, ..self }
    }

    /// Names the program, for `compare --base REV`: `env!("CARGO_PKG_NAME")` and `env!("CARGO_BIN_NAME")`.
    #[must_use]
    pub fn program(self, package: &'static str, binary: &'static str) -> Self {
        Self { program: CargoTarget { package, binary }, ..self }
    }

    /// Adds a pipeline.
    #[must_use]
    pub fn pipeline<P: Pipeline>(mut self) -> Self {
        self.kinds.push(PipelineKind::new::<P>());
        self
    }

    /// Adds shaders. They may import the modules `fathom::…`.
    #[must_use]
    pub fn shaders(self, folder: Folder) -> Self {
        Self { shaders: self.shaders.with(folder), ..self }
    }

    /// Adds scene files.
    #[must_use]
    pub fn scenes(self, folder: Folder) -> Self {
        Self { scenes: self.scenes.with(folder), ..self }
    }

    /// Adds experiments.
    #[must_use]
    pub fn experiments(self, folder: Folder) -> Self {
        Self { experiments: self.experiments.with(folder), ..self }
    }

    /// Adds figures.
    #[must_use]
    pub fn figures(self, folder: Folder) -> Self {
        Self { figures: self.figures.with(folder), ..self }
    }

    /// Runs these experiments in place of fathom's own.
    #[must_use]
    pub fn only_experiments(self, folder: Folder) -> Self {
        Self { experiments: Folders::new(folder), ..self }
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

    /// The kind of pipeline of a name; an error names the name that is most like it.
    pub fn kind(&self, name: &str) -> Result<PipelineKind, SubjectError> {
        let found = self.kinds.iter().find(|kind| kind.name == name);
        found.copied().ok_or_else(|| SubjectError::UnknownPipeline {
            name: name.to_owned(),
            hint: did_you_mean(name, self.kinds.iter().map(|kind| kind.name)),
        })
    }

    /// An error of an unknown parameter that some other pipeline has names those that do.
    pub(super) fn explained(&self, error: ParamError, of: PipelineKind) -> SubjectError {
        let ParamError::Unknown { path, hint } = error else { return error.into() };
        let has_it = |kind: &&PipelineKind| (kind.fields)().iter().any(|field| field.path == path);
        let owners: Vec<_> = self.kinds.iter().filter(has_it).map(|kind| kind.name).collect();
        if owners.is_empty() {
            return ParamError::Unknown { path, hint }.into();
        }
        SubjectError::OfAnother { pipeline: of.name, path, owners }
    }

    /// The stages that a pipeline's frame holds by some of its parameters, in frame order: found by planning it with each of the
    /// choices that a parameter has, one parameter at a time. A pipeline that no scene suits is an error.
    pub fn stages_of(&self, pipeline: &str) -> Result<Vec<&'static StageInfo>, SubjectError> {
        let kind = self.kind(pipeline)?;
        let suitable = LISTED.into_iter().map(str::to_owned);
        let mut scenes = suitable.chain(self.scenes.stems(".toml"));
        let planned = |scene: String| {
            let file = pipelines::smallest(SceneFile::load_from(&self.scenes, &scene).ok()?);
            let tree = (kind.defaults)(&file);
            Some((planned_stages(kind, &file, &tree)?, file, tree))
        };
        let (mut found, file, tree) = scenes.find_map(planned).ok_or_else(|| {
            SubjectError::Invalid(format!("no scene suits pipeline `{pipeline}`"))
        })?;
        for (path, value) in (kind.fields)().iter().flat_map(choices) {
            let mut tree = tree.clone();
            let set = parameter::set(&mut tree, &path, value).ok();
            let frame = set.and_then(|()| planned_stages(kind, &file, &tree));
            merge(&mut found, frame.unwrap_or_default());
        }
        if let Some((frame, ..)) = planned(TRANSPARENT.to_owned()) {
            merge(&mut found, frame);
        }
        Ok(found)
    }

    /// Every stage: those of fathom, and those of the pipelines that were added to its own.
    pub fn stages(&self) -> Vec<&'static StageInfo> {
        let mut all: Vec<&'static StageInfo> = stages::REGISTRY.iter().collect();
        let is_own =
            |kind: &&PipelineKind| pipelines::KINDS.iter().any(|own| own.name == kind.name);
        let added = self.kinds.iter().filter(|kind| !is_own(kind));
        for stage in added.flat_map(|kind| self.stages_of(kind.name).unwrap_or_default()) {
            if !all.iter().any(|known| known.name == stage.name) {
                all.push(stage);
            }
        }
        all
    }

    /// Every check, in frame order.
    pub fn cases(&self) -> Vec<Case> {
        self.checks.iter().flat_map(|cases| cases()).collect()
    }
}

/// Scenes that pipelines are listed with, where they suit: of objects, of a volume, of glass. All are quickly made.
const LISTED: [&str; 3] = ["plane", "smoke", "glass_teapot_small"];
/// A scene that more stages are made for than for those.
const TRANSPARENT: &str = "glass";

/// What a parameter may be, where that is a few names.
fn choices(field: &ParamField) -> Vec<(String, Value)> {
    let values = match field.allowed {
        Allowed::Names(names) => names.iter().map(|name| Value::from(*name)).collect(),
        Allowed::Flag => vec![Value::from(true), Value::from(false)],
        Allowed::Numbers(_) | Allowed::Free => Vec::new(),
    };
    values.into_iter().map(|value| (field.path.clone(), value)).collect()
}

/// The stages of a frame by these parameters; none where they or the scene do not suit.
fn planned_stages(
    kind: PipelineKind,
    file: &SceneFile,
    tree: &Value,
) -> Option<Vec<&'static StageInfo>> {
    let tree = (kind.checked)(tree).ok()?;
    let scene = Scene::build(&fathom_pipelines::apply(&tree, file).ok()?).ok()?;
    Some((kind.plan)(&tree, &scene).ok()?.stages)
}

/// Adds what a frame runs to what others run: each stage once, behind the one that it follows in its frame.
fn merge(all: &mut Vec<&'static StageInfo>, frame: Vec<&'static StageInfo>) {
    let mut next = 0;
    for stage in frame {
        match all.iter().position(|known| known.name == stage.name) {
            Some(place) => next = place + 1,
            None => {
                all.insert(next, stage);
                next += 1;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stages_of_a_pipeline_stand_in_frame_order() {
        let stages = Catalog::builtin().stages_of("hsao").unwrap();
        let names: Vec<&str> = stages.into_iter().map(|stage| stage.name).collect();
        let hsao = "uniforms scene/deform shadow/depth scene/gbuffer hsao/march hsao/filter ao/compose ao/glass";
        assert_eq!(names.join(" "), hsao);
    }
}
