//! What is compared: gate cells, each one stage of one cell of an experiment that lists its `stages`.

use std::path::Path;

use anyhow::{Result, bail};

use super::protocol::GateConfiguration;
use fathom_base::text::{did_you_mean, families};
use fathom_experiments::{CellPlan, Experiment, ExperimentError};
use fathom_record::Profile;
use fathom_record::comparison::{CellId, CellSubject};

/// Gates are small at every profile.
const PROFILE: Profile = Profile::Quick;

/// The configurations of a comparison, in the file's order.
#[derive(Clone, Debug, PartialEq)]
pub struct Gates {
    /// A cell that is measured once more with one build on both sides; it must show no difference.
    pub control: CellId,
    pub configurations: Vec<GateConfiguration>,
}

impl Gates {
    /// Those of an experiment's file, or else those of a catalogue: their name and text.
    pub fn load(path: Option<&Path>, catalogued: (&str, &str)) -> Result<Self> {
        match path {
            None => Self::parse(catalogued.0, catalogued.1),
            Some(path) => Self::from_experiment(&Experiment::read(path)?),
        }
    }

    /// Those of an experiment's text.
    pub fn parse(name: &str, text: &str) -> Result<Self> {
        Self::from_experiment(&Experiment::parse(name, text)?)
    }

    fn from_experiment(experiment: &Experiment) -> Result<Self> {
        let invalid = |fault: String| ExperimentError::new(&experiment.id, &fault);
        let plans = experiment.cells(PROFILE, &[], &[])?;
        let configurations: Vec<_> =
            plans.into_iter().map(|plan| with_all_encoded(configuration(plan))).collect();
        if let Some(cell) = configurations.iter().find(|cell| cell.stages.is_empty()) {
            return Err(invalid(format!("cell `{}` lists no `stages` to compare", cell.id)).into());
        }
        let mut stages = configurations.iter().flat_map(|cell| &cell.stages);
        if let Some(stage) = stages.find(|stage| stage.contains(char::is_whitespace)) {
            return Err(invalid(format!("the name of stage `{stage}` must hold no space")).into());
        }
        let asked = experiment.control.as_deref();
        let control = configurations
            .iter()
            .flat_map(GateConfiguration::cells)
            .find(|cell| asked.is_none_or(|asked| asked == cell.as_str()));
        let control = control
            .ok_or_else(|| invalid(format!("the control `{}` is no cell", asked.unwrap_or(""))))?;
        Ok(Self { control, configurations })
    }

    pub fn cells(&self) -> Vec<CellId> {
        self.configurations.iter().flat_map(GateConfiguration::cells).collect()
    }

    /// Keeps the stages that are wanted, and the configurations that have any.
    pub fn retain(&mut self, wanted: impl Fn(CellSubject<'_>) -> bool) {
        for configuration in &mut self.configurations {
            configuration.stages.retain(|name| wanted(CellSubject::parse(name)));
        }
        self.configurations.retain(|configuration| !configuration.stages.is_empty());
    }

    /// Only the cells whose names contain `filter`, if there is one. The control stays one of them.
    pub fn filtered(mut self, filter: Option<&str>) -> Result<Self> {
        let Some(filter) = filter else { return Ok(self) };
        let all = self.cells();
        for configuration in &mut self.configurations {
            let id = configuration.id.clone();
            let keep = |stage: &String| CellId::new(&id, stage).as_str().contains(filter);
            configuration.stages.retain(keep);
        }
        self.configurations.retain(|configuration| !configuration.stages.is_empty());
        let remaining = self.cells();
        let Some(first) = remaining.first() else {
            let families = families(all.iter().map(CellId::stage)).join(", ");
            let meant = did_you_mean(filter, all.iter().map(CellId::as_str));
            bail!("no gate cell matches `{filter}`{meant}; there are cells of {families}");
        };
        if !remaining.contains(&self.control) {
            self.control = first.clone();
        }
        Ok(self)
    }
}

/// `encode:*` stands for the encoding of each stage that is listed.
fn with_all_encoded(mut configuration: GateConfiguration) -> GateConfiguration {
    let all = CellSubject::Encode("*").to_string();
    if configuration.stages.contains(&all) {
        configuration.stages.retain(|name| *name != all);
        let stages = configuration.stages.iter().filter(|name| CellSubject::parse(name).is_stage());
        let encoded =
            stages.map(|stage| CellSubject::Encode(stage).to_string()).collect::<Vec<_>>();
        // What makes pipelines leaves another heap behind: it is counted last.
        let create = CellSubject::Create.to_string();
        let creates = configuration.stages.contains(&create);
        configuration.stages.retain(|name| *name != create);
        configuration.stages.extend(encoded);
        configuration.stages.extend(creates.then_some(create));
    }
    configuration
}

fn configuration(plan: CellPlan) -> GateConfiguration {
    GateConfiguration {
        id: plan.cell,
        pipeline: plan.pipeline,
        scene: plan.scene,
        params: plan.overrides.into_iter().collect(),
        stages: plan.stages,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fathom_harness::catalog::Catalog;

    #[test]
    fn encoding_of_all_stages_stands_before_the_making_of_pipelines() {
        let stages = ["a/x", "encode:*", "create", "a/y"].map(str::to_owned).to_vec();
        let expanded = with_all_encoded(GateConfiguration { stages, ..Default::default() });
        assert_eq!(expanded.stages, ["a/x", "a/y", "encode:a/x", "encode:a/y", "create"]);
        for (name, subject) in [
            ("a/x", CellSubject::Stage("a/x")),
            ("encode:a/x", CellSubject::Encode("a/x")),
            ("create", CellSubject::Create),
        ] {
            assert_eq!((CellSubject::parse(name), subject.to_string()), (subject, name.to_owned()));
        }
    }

    /// All but a stage of the host, one that is too short, and those that no frame holds.
    #[test]
    fn the_built_in_gates_compare_every_stage_that_can_be() {
        let apart = ["uniforms", "voxel/clear", "voxel/view", "ao/query"];
        let cells = Gates::load(None, Catalog::builtin().gates).unwrap().cells();
        assert!(cells.len() >= 40, "{}", cells.len());
        for cell in &cells {
            let (CellSubject::Stage(name) | CellSubject::Encode(name)) = cell.subject() else {
                continue;
            };
            assert!(fathom_stages::REGISTRY.iter().any(|stage| stage.name == name), "{cell}");
            let encoded = |other: &CellId| other.subject() == CellSubject::Encode(name);
            assert!(cells.iter().any(encoded), "{name} is in no configuration with `encode:*`");
        }
        let creating = cells.iter().filter(|cell| cell.subject() == CellSubject::Create);
        assert_eq!(creating.count(), fathom_pipelines::KINDS.len(), "one `create` per pipeline");
        for stage in fathom_stages::REGISTRY {
            let compared = cells.iter().any(|cell| cell.stage() == stage.name);
            assert!(
                compared != apart.contains(&stage.name),
                "{} has no gate cell: add it to a configuration of benches/gates.toml, or it has one and is listed in `apart`",
                stage.name
            );
        }
    }

    #[test]
    fn filters_keep_what_they_name_and_a_control() {
        let gates = Gates::load(None, Catalog::builtin().gates).unwrap();
        let few = gates.clone().filtered(Some("splat")).unwrap();
        assert!(few.cells().iter().all(|cell| cell.stage().contains("splat")));
        assert!(few.cells().contains(&few.control));
        let error = gates.filtered(Some("caustics/splt")).unwrap_err().to_string();
        assert!(error.contains("did you mean"), "{error}");
    }

    fn parsed(rest: &str) -> Result<Gates> {
        let head = "id = \"own\"\ntitle = \"t\"\nsource = \"s\"\npipeline = \"p\"\nscene = \"s\"\n";
        Gates::from_experiment(&Experiment::parse("own", &format!("{head}{rest}"))?)
    }

    #[test]
    fn cells_are_those_of_the_experiment_and_stages_are_inherited() {
        let axis = "[[sweep.axis]]\nname = \"view.width\"\nvalues = [16, 32]\n";
        let rest = format!(
            "stages = [\"x\"]\n[[sweep]]\nid = \"a\"\nstages = [\"y\", \"z\"]\n[[sweep]]\n{axis}"
        );
        let gates = parsed(&rest).unwrap();
        let cells: Vec<String> = gates.cells().iter().map(CellId::to_string).collect();
        assert_eq!(cells, ["a y", "a z", "view.width=16 x", "view.width=32 x"]);
        assert_eq!(gates.control.as_str(), "a y");
        assert_eq!(gates.configurations[2].params["view.width"], 32);
    }

    #[test]
    fn faults_of_a_file_are_one_line() {
        let one = |id: &str, stages: &str| format!("[[sweep]]\nid = \"{id}\"\nstages = {stages}\n");
        let twice = one("a", "[\"x\"]").repeat(2);
        for (rest, expected) in [
            ("", "lists no `stages`"),
            (&one("A b", "[\"x\"]"), "lower-case"),
            (&one("a", "[]"), "cell `a` lists no `stages`"),
            (&one("a", "[\"x µ|1\"]"), "stage `x µ|1` must hold no space"),
            (&one("a", "[\"x\", \"x\"]"), "stage `x` is listed twice"),
            ("stages = [\"x\"]\n[[sweep]]\n", "a sweep needs an `axis` or an `id`"),
            (&format!("control = \"a y\"\n{}", one("a", "[\"x\"]")), "`a y` is no cell"),
            (&twice, "twice"),
        ] {
            let error = parsed(rest).unwrap_err().to_string();
            assert_eq!(error.lines().count(), 1, "{error}");
            assert!(error.starts_with("experiment `own`: "), "{error}");
            assert!(error.contains(expected), "{error}");
        }
    }
}
