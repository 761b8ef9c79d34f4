//! `fathom sweep`: a pipeline, a scene and one or two axes as an experiment, which is run as any other.

use std::iter::once;

use anyhow::{Result, bail, ensure};
use itertools::Itertools as _;
use serde_json::{Map, Value, json};

use super::catalog::Catalog;
use super::subject::{Subject, Subjects};
use fathom_base::{parameter, text};
use fathom_experiments::{Experiment, parse_set};
use fathom_record::Profile;
use fathom_scene::Camera;

/// The `source` of an experiment that a sweep made.
pub const SOURCE: &str = "fathom sweep";
/// Share of a frame from which a stage counts as costly, unless told otherwise.
pub const KNEE_SHARE: f64 = 0.5;
/// The view on a software driver, whose frames at the pipelines' own sizes take seconds.
const QUICK_VIEW: [(&str, u32); 2] = [("view.width", 120), ("view.height", 90)];
/// Parameters that an error names, of a pipeline that may have a hundred.
const EXAMPLES: usize = 6;

/// What is to be swept.
#[derive(Clone, Debug, Default)]
pub struct SweepRequest {
    pub pipeline: String,
    /// Name of a scene, or path of a scene file or a mesh.
    pub scene: String,
    /// Paths of parameters and their values.
    pub axes: Vec<(String, Vec<String>)>,
    /// Parameters of every cell.
    pub sets: Vec<(String, Value)>,
    /// Azimuth and elevation in degrees, or position and target in metres.
    pub camera: Option<Vec<f64>>,
    pub knee_share: f64,
    /// The command line, for the file.
    pub command: String,
}

impl SweepRequest {
    /// The experiment that it stands for. Each value of each axis is checked; nothing is measured.
    ///
    /// # Errors
    /// One line that says what is missing, and what to write.
    pub fn experiment(&self, catalog: &Catalog) -> Result<Experiment> {
        let kind = catalog.kind(&self.pipeline)?;
        let mut subjects = Subjects::new(catalog).silent();
        let base = subjects.params(kind, &self.scene, &self.sets)?;
        self.check_axes(&base)?;
        let subject = subjects.subject(&self.pipeline, &self.scene, &self.sets)?;
        let text = self.toml(&subject, &self.parsed_axes(&base)?)?;
        let experiment = Experiment::parse("sweep", &text)?;
        for cell in experiment.cells(Profile::Quick, &[], &[])? {
            subjects.params(kind, &self.scene, &cell.overrides)?;
        }
        Ok(experiment)
    }

    fn check_axes(&self, params: &Value) -> Result<()> {
        let share = self.knee_share;
        ensure!(share > 0.0 && share < 1.0, "--share {share} must lie between 0 and 1");
        let is_size = |path: &String| {
            let value = parameter::get(params, path);
            value.is_some_and(Value::is_u64) && !path.contains("seed")
        };
        let sizes = parameter::leaves(params).into_iter().filter(is_size).take(EXAMPLES).join(", ");
        let pipeline = &self.pipeline;
        ensure!(
            !self.axes.is_empty(),
            "give an axis: --axis PARAM=V1,V2,…; sizes of {pipeline} are {sizes}; `fathom list parameters --pipeline {pipeline}` has all"
        );
        ensure!(self.axes.len() <= 2, "{} axes: at most two are swept at once", self.axes.len());
        for (number, (path, values)) in self.axes.iter().enumerate() {
            let again = self.axes[..number].iter().any(|(other, _)| other == path);
            ensure!(!again, "axis `{path}` is there twice: give all its values in one --axis");
            let is_of = |set: &str| set == path || set.starts_with(&format!("{path}."));
            let set = self.sets.iter().find(|(set, _)| is_of(set));
            ensure!(set.is_none(), "`{path}` is swept: leave --set {path} out");
            if let Some(value) = values.iter().duplicates().next() {
                bail!("axis `{path}` has the value {value} twice");
            }
            ensure!(
                values.len() > 1,
                "axis `{path}` has one value: a sweep needs two, and an exponent three: --axis {path}={},…",
                values.join(",")
            );
        }
        Ok(())
    }

    /// As experiments have them. A pair such as `1280x720` is given to the two parameters of a table, or to a list.
    fn parsed_axes(&self, params: &Value) -> Result<Vec<Value>> {
        let axis = |(path, texts): &(String, Vec<String>)| {
            let swept = parameter::get(params, path);
            let table = swept.filter(|value| value.is_object());
            let sides = table.map_or_else(Vec::new, parameter::leaves).into_iter();
            let paths = sides.map(|side| format!("{path}.{side}")).collect_vec();
            let is_pair = table.is_some() || swept.is_some_and(Value::is_array);
            let value = |text: &String| {
                let numbers = || text.split('x').map(|side| Some(json!(side.parse::<u32>().ok()?)));
                match numbers().collect::<Option<Vec<Value>>>().filter(|_| is_pair) {
                    Some(pair) if pair.len() == 2 => Ok(pair.into()),
                    _ if table.is_none() => Ok(parse_set(&format!("{path}={text}"))?.1),
                    _ => bail!(
                        "`{path}` is {}: give pairs, as in 1280x720, not {text}",
                        paths.join(" and ")
                    ),
                }
            };
            let values = texts.iter().map(value).collect::<Result<Vec<Value>>>()?;
            Ok(json!({ "name": path, "sets": paths, "values": values }))
        };
        self.axes.iter().map(axis).collect()
    }

    fn toml(&self, subject: &Subject, axes: &[Value]) -> Result<String> {
        let paths = self.axes.iter().map(|(path, _)| path.as_str()).collect_vec();
        let (first, over) = (paths[0], paths.join(" and "));
        let mut params: Map<String, Value> = self.sets.iter().cloned().collect();
        params.extend(self.camera(subject)?);
        let is_free = |path: &str| {
            let is_swept =
                paths.iter().any(|axis| path == *axis || path.starts_with(&format!("{axis}.")));
            let is_chosen = params.contains_key(path) || is_swept;
            !is_chosen && parameter::get(&subject.params, path).is_some()
        };
        let quick = QUICK_VIEW.into_iter().filter(|(path, _)| is_free(path));
        let quick: Map<String, Value> =
            quick.map(|(path, px)| (path.to_owned(), px.into())).collect();
        let stages = subject.plan()?.stages;
        let stages = stages.iter().map(|stage| format!("stage:{}", stage.name)).unique();
        let is_category = axes[0]["values"]
            .as_array()
            .into_iter()
            .flatten()
            .any(|v| v.is_string() || v.is_boolean());
        let times = if is_category {
            json!({ "title": format!("Frame time by {first}"), "kind": "bars", "over": first, "y": ["frame"] })
        } else {
            let y = once("frame".to_owned()).chain(stages).collect_vec();
            let x = format!("axis:{first}");
            json!({ "title": format!("Times over {first}"), "kind": "scaling", "over": first, "x": x, "y": y })
        };
        let plots = vec![times, json!({ "title": "Stages of a frame", "kind": "stacked" })];
        let experiment = json!({
            "id": format!("sweep-{}", self.pipeline.replace('_', "-")),
            "title": format!("{} over {over}", self.pipeline),
            "source": SOURCE,
            "about": subject.scene.description,
            "pipeline": self.pipeline,
            "scene": self.scene,
            "knee_share": self.knee_share,
            "pictures": "all",
            "error_picture": true,
            "params": params,
            "profile": { "quick": { "params": quick } },
            "sweep": [{ "axis": axes }],
            "plot": plots,
        });
        let text = toml::to_string(&experiment)?;
        let command = text::line(&self.command);
        Ok(format!("# What `{command}` measures. `fathom run FILE` measures it again.\n\n{text}"))
    }

    /// The parameters of the camera that was asked for.
    fn camera(&self, subject: &Subject) -> Result<Vec<(String, Value)>> {
        let Some(numbers) = &self.camera else { return Ok(Vec::new()) };
        let [azimuth, elevation] = numbers[..] else {
            bail!(
                "--camera takes AZIMUTH,ELEVATION in degrees; --set camera.position_m and camera.target_m set any other"
            );
        };
        ensure!(
            azimuth.abs() <= 360.0 && elevation.abs() <= 90.0,
            "--camera {azimuth},{elevation}: an azimuth lies within −360 … 360 degrees, an elevation within −90 … 90"
        );
        let camera = Camera::around(&subject.scene.solid_bounds(), [azimuth, elevation]);
        camera.validate().map_err(anyhow::Error::msg)?;
        let tree = parameter::tree(&camera);
        let leaves = parameter::leaves(&tree).into_iter();
        Ok(leaves.map(|leaf| (format!("camera.{leaf}"), tree[&leaf].clone())).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fathom_experiments::{CellPlan, Measure, parse_axis};
    use fathom_record::{Cell, Measured};

    /// Of `PIPELINE SCENE AXIS…`.
    fn request(words: &str) -> SweepRequest {
        let words: Vec<&str> = words.split(' ').collect();
        SweepRequest {
            pipeline: words[0].to_owned(),
            scene: words[1].to_owned(),
            axes: words[2..].iter().map(|word| parse_axis(word).unwrap()).collect(),
            knee_share: KNEE_SHARE,
            ..SweepRequest::default()
        }
    }

    /// Each in one line that says what to write.
    #[test]
    fn wrong_calls_say_what_to_write() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        std::fs::write(path("notes.txt"), "v 0 0 0").unwrap();
        std::fs::write(path("broken.obj"), "v 0 0 0\nf 1 2 3\n").unwrap();
        let told = |request: SweepRequest, expected: &str| {
            let message = request.experiment(&Catalog::builtin()).expect_err(expected);
            let message = format!("{message:#}");
            assert!(
                message.contains(expected) && message.lines().count() == 1,
                "{expected}: {message}"
            );
        };
        for (words, expected) in [
            ("qqq plane a=1,2", "; there are underwater, voxelize, volume_ao, hsao, "),
            ("volume_ao plane", "--axis PARAM=V1,V2,…; sizes of volume_ao are "),
            ("volume_ao plane voxel.resolutoin=32,64", "did you mean `voxel.resolution`?"),
            ("volume_ao plane caustics.grid=32,64", "which is one of underwater"),
            ("underwater plane caustics.buffer=32,64", "such as `[64, 64]`, not 32"),
            ("volume_ao plane view=640x480,32", "give pairs, as in 1280x720, not 32"),
            ("volume_ao plane view=640x480,0x32", "view.width is 0: it must lie within "),
            ("volume_ao plane voxel.resolution=32", "has one value: a sweep needs two"),
            ("volume_ao plane voxel.resolution=32,32", "has the value 32 twice"),
            ("volume_ao plane voxel.resolution=32,9999", "is 9999: it must lie within "),
            ("volume_ao plane voxel.resolution=32,few", "takes a whole number"),
            ("volume_ao plane ao.rays=1,2 ao.rays=3,4", "is there twice"),
            ("volume_ao plane ao.rays=1,2 ao.samples=1,2 view.width=1,2", "at most two"),
            ("volume_ao NOTES ao.rays=1,2", "a scene's file ends in .toml, a mesh in .obj, .ply, "),
            ("volume_ao BROKEN ao.rays=1,2", "out of bounds"),
            ("volume_ao no/such.glb ao.rays=1,2", "cannot read the mesh no/such.glb"),
        ] {
            let files = [("NOTES", "notes.txt"), ("BROKEN", "broken.obj")];
            let words = files.into_iter().fold(words.to_owned(), |words, (word, name)| {
                words.replace(word, &path(name).display().to_string())
            });
            told(request(&words), expected);
        }
        let good = || request("volume_ao plane ao.rays=1,2");
        let sets = vec![("ao.rays".to_owned(), 8.into())];
        told(SweepRequest { sets, ..good() }, "leave --set ao.rays out");
        let camera = Some(vec![1.0]);
        told(SweepRequest { camera, ..good() }, "--camera takes AZIMUTH,ELEVATION");
        let camera = Some(vec![400.0, 95.0]);
        told(SweepRequest { camera, ..good() }, "an elevation within −90 … 90");
        told(SweepRequest { knee_share: f64::NAN, ..good() }, "must lie between 0 and 1");
    }

    /// Of a table of two parameters and of a list of two numbers.
    #[test]
    fn pairs_set_both_sides_and_are_read_as_their_area() {
        for (words, path, set) in [
            ("volume_ao plane view=64x48,128x96", "view", ("view.height", json!(96))),
            (
                "underwater plane caustics.buffer=64x48,128x96",
                "caustics.buffer",
                ("caustics.buffer", json!([128, 96])),
            ),
        ] {
            let experiment = request(words).experiment(&Catalog::builtin()).unwrap();
            let CellPlan { cell, axes, overrides, .. } =
                experiment.cells(Profile::Quick, &[], &[]).unwrap().remove(1);
            assert_eq!(cell, format!("{path}=128x96"));
            assert!(overrides.contains(&(set.0.to_owned(), set.1)), "{overrides:?}");
            let x: Measure = format!("axis:{path}").parse().unwrap();
            let area = x.read(&Cell { axes, ..Cell::default() }, &Measured::default()).unwrap();
            assert_eq!(area.median(), 128.0 * 96.0);
        }
    }

    #[test]
    fn a_sweep_is_an_experiment_that_its_file_gives_again() {
        let axes = "volume_ao plane voxel.resolution=32,64,128 voxel.method=overlap,slicemap";
        let sets = vec![("view.width".to_owned(), 64.into())];
        let request = SweepRequest { camera: Some(vec![30.0, -20.0]), sets, ..request(axes) };
        let experiment = request.experiment(&Catalog::builtin()).unwrap();
        let cells = experiment.cells(Profile::Quick, &[], &[]).unwrap();
        assert_eq!(
            (cells.len(), &*cells[1].cell),
            (6, "voxel.resolution=32,voxel.method=slicemap")
        );
        let mut subjects = Subjects::default();
        for cell in &cells {
            let subject = subjects.subject(&cell.pipeline, &cell.scene, &cell.overrides).unwrap();
            assert_eq!(
                subject.params["view"],
                json!({ "width": 64, "height": 90 }),
                "{}",
                cell.cell
            );
        }
        assert_eq!(Experiment::parse("again", &experiment.text).unwrap(), experiment);
        assert!(experiment.plot[0].y.len() > 3, "{:?}", experiment.plot[0]);
    }
}
