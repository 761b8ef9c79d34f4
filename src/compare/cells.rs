//! What is compared: gate cells, each one stage of one configuration, listed in `benches/gates.toml`.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use thiserror::Error;

use super::protocol;
use crate::experiments::{flatten, nearest};
use crate::input::{self, one_line};
use crate::record::comparison::CellId;
use crate::text;

#[derive(Debug, Error)]
pub enum CellsError {
    #[error("cannot read the gates' configurations {}: {source}", path.display())]
    Read { path: PathBuf, source: std::io::Error },
    #[error("{origin}: {}", one_line(.message))]
    Invalid { origin: String, message: String },
    #[error("no gate cell matches `{filter}`{}", match nearest { Some(name) => format!("; did you mean `{name}`?"), None => String::new() })]
    NoMatch { filter: String, nearest: Option<String> },
}

/// A pipeline on a scene at small sizes, and the stages of it that are compared.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Configuration {
    /// Lower-case letters, digits and `-`.
    pub id: String,
    pub pipeline: String,
    pub scene: String,
    /// Parameters by their dotted paths or nested, as in an experiment's file.
    #[serde(default)]
    pub params: Map<String, Value>,
    /// Stages whose time at these sizes suits the gates, in frame order.
    pub stages: Vec<String>,
}

impl Configuration {
    /// Parameters to set: dotted path and value.
    pub fn overrides(&self) -> Vec<(String, Value)> {
        flatten(&self.params)
    }

    pub fn cells(&self) -> impl Iterator<Item = CellId> + '_ {
        let cell = |stage: &String| CellId::new(&self.id, stage);
        self.stages.iter().map(cell)
    }
}

impl From<&Configuration> for protocol::Configuration {
    fn from(configuration: &Configuration) -> Self {
        Self {
            id: configuration.id.clone(),
            pipeline: configuration.pipeline.clone(),
            scene: configuration.scene.clone(),
            params: configuration.overrides().into_iter().collect(),
        }
    }
}

/// The configurations of a comparison, in the file's order.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Gates {
    /// A cell that is measured once more with the base on both sides; it must show no difference.
    pub control: CellId,
    #[serde(rename = "configuration")]
    pub configurations: Vec<Configuration>,
}

impl Gates {
    /// Those of a file, or else those of a catalogue: their name and text.
    pub fn load(path: Option<&Path>, catalogued: (&str, &str)) -> Result<Self, CellsError> {
        match path {
            None => Self::parse(catalogued.0, catalogued.1),
            Some(path) => {
                let text = input::text(path, input::MAX_TEXT)
                    .map_err(|source| CellsError::Read { path: path.to_owned(), source })?;
                Self::parse(&path.display().to_string(), &text)
            }
        }
    }

    fn parse(origin: &str, text: &str) -> Result<Self, CellsError> {
        let invalid = |message: String| CellsError::Invalid { origin: origin.to_owned(), message };
        let gates: Self =
            toml::from_str(text).map_err(|error| invalid(error.to_string().trim().to_owned()))?;
        gates.check().map_err(invalid)?;
        Ok(gates)
    }

    fn check(&self) -> Result<(), String> {
        let mut seen = Vec::new();
        for configuration in &self.configurations {
            let id = &configuration.id;
            text::check_id(id).map_err(|fault| format!("configuration {fault}"))?;
            if seen.contains(&id) {
                return Err(format!("configuration `{id}` is there twice"));
            }
            seen.push(id);
            let mut stages = configuration.stages.clone();
            stages.sort();
            stages.dedup();
            if stages.len() != configuration.stages.len() || stages.is_empty() {
                return Err(format!("configuration `{id}` must list stages, and each once"));
            }
        }
        match self.cells().contains(&self.control) {
            true => Ok(()),
            false => Err(format!("the control `{}` is no cell", self.control)),
        }
    }

    pub fn cells(&self) -> Vec<CellId> {
        let configurations = self.configurations.iter();
        configurations.flat_map(Configuration::cells).collect()
    }

    pub fn configuration(&self, id: &str) -> Option<&Configuration> {
        self.configurations.iter().find(|known| known.id == id)
    }

    /// Only the cells whose names contain `filter`. The control stays one of them.
    pub fn filtered(mut self, filter: &str) -> Result<Self, CellsError> {
        let all = self.cells();
        for configuration in &mut self.configurations {
            let id = configuration.id.clone();
            let keep = |stage: &String| CellId::new(&id, stage).as_str().contains(filter);
            configuration.stages.retain(keep);
        }
        self.configurations.retain(|configuration| !configuration.stages.is_empty());
        let left = self.cells();
        match left.first() {
            None => Err(CellsError::NoMatch {
                filter: filter.to_owned(),
                nearest: nearest(filter, all.iter().map(CellId::as_str)),
            }),
            Some(first) => {
                if !left.contains(&self.control) {
                    self.control = first.clone();
                }
                Ok(self)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::harness::catalog::Catalog;

    #[test]
    fn names_are_configuration_and_stage() {
        let cell = CellId::new("tank-fine", "caustics/trace");
        assert_eq!(cell.to_string(), "tank-fine caustics/trace");
        assert_eq!(cell.configuration(), "tank-fine");
        assert_eq!(cell.stage(), "caustics/trace");
        assert_eq!(serde_json::to_string(&cell).unwrap(), "\"tank-fine caustics/trace\"");
    }

    #[test]
    fn the_built_in_configurations_make_at_least_forty_cells_of_known_stages() {
        let gates = Gates::load(None, Catalog::builtin().gates).unwrap();
        let cells = gates.cells();
        assert!(cells.len() >= 40, "{}", cells.len());
        for cell in &cells {
            let known = crate::stages::REGISTRY.iter().any(|stage| stage.name == cell.stage());
            assert!(known, "{cell}");
        }
    }

    /// A stage of the host, one that is too short, and two that no frame holds; everything else is compared somewhere.
    #[test]
    fn every_stage_that_can_be_compared_is_in_a_gate() {
        let apart = ["frame", "voxel/clear", "voxel/view", "ao/query", "photons/query"];
        let cells = Gates::load(None, Catalog::builtin().gates).unwrap().cells();
        for stage in crate::stages::REGISTRY {
            let compared = cells.iter().any(|cell| cell.stage() == stage.name);
            assert!(compared != apart.contains(&stage.name), "{}", stage.name);
        }
    }

    #[test]
    fn filters_keep_what_they_name_and_a_control() {
        let gates = Gates::load(None, Catalog::builtin().gates).unwrap();
        let few = gates.clone().filtered("splat").unwrap();
        assert!(few.cells().iter().all(|cell| cell.stage().contains("splat")));
        assert!(few.cells().contains(&few.control));
        let error = gates.filtered("caustics/splt").unwrap_err().to_string();
        assert!(error.contains("did you mean"), "{error}");
    }

    #[test]
    fn faults_of_a_file_are_one_line() {
        let fault = |text: &str| {
            let error = Gates::parse("my.toml", text).unwrap_err().to_string();
            assert_eq!(error.lines().count(), 1, "{error}");
            assert!(error.starts_with("my.toml: "), "{error}");
            error
        };
        let one = |id: &str, stages: &str| {
            format!(
                "[[configuration]]\nid = \"{id}\"\npipeline = \"p\"\nscene = \"s\"\nstages = {stages}\n"
            )
        };
        let control = "control = \"a x\"\n";
        assert!(fault("").contains("control"));
        assert!(fault(&format!("{control}{}", one("A b", "[\"x\"]"))).contains("lower-case"));
        assert!(fault(&format!("{control}{}", one("a", "[]"))).contains("must list stages"));
        assert!(fault(&format!("{control}{}", one("a", "[\"y\"]"))).contains("`a x` is no cell"));
        let twice = one("a", "[\"x\"]").repeat(2);
        assert!(fault(&format!("{control}{twice}")).contains("twice"));
    }
}
