//! What of a record is published: each text that a record can hold, what it tells, and what becomes of it in a public copy. A
//! test holds the list against the schema, so a new field with a text must be added here.

use itertools::Itertools;
use serde_json::Value;

use super::command::{OF_CELLS, parted};
use super::output::picture_path;
use super::{FrameRecord, Measured, Record};
use fathom_base::private;

/// What a text of a record tells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Text {
    /// A name, unit or version of the program, a time of day, or a digest: it stays.
    Program,
    /// What driver and system say of the device: it stays.
    Device,
    /// What an experiment says, or a sentence of the program: it stays, and the paths in it lose their folders.
    Words,
    /// A path or revision that the user named: its last part stays.
    Path,
    /// The machine: it becomes `machine-1`, `machine-2` in the order in which they appear.
    Machine,
    /// The command line: the program's name and the options that cells depend on stay.
    Command,
    /// Environment variables: their names stay.
    Variables,
    /// What else the user asked for: it is left out.
    Request,
}

/// Every text of a record by the names of the fields that lead to it. An item of a list has the place of its list. All that lies
/// beneath a place belongs to it.
const TEXTS: &[(Text, &[&str])] = &[
    (
        Text::Program,
        &[
            "run/fathom_version",
            "run/started_at",
            "run/build/commit",
            "run/audit/reason",
            "run/shard/plan",
            "run/adapter/mask/like",
            "experiment/id",
            "cell/experiment",
            "cell/pipeline",
            "cell/outcome/stages/stage",
            "cell/outcome/stages/counters",
            "cell/outcome/host/stages/stage",
            "cell/outcome/frame/machine/throttle",
            "cell/outcome/quantities",
            "cell/outcome/repeated",
            "cell/outcome/errors/name",
            "cell/outcome/errors/unit",
            "cell/outcome/errors/stage",
            "cell/outcome/errors/before",
            "cell/outcome/rejected/stage",
            "cell/outcome/pictures/path",
            "comparison/fathom_version",
            "comparison/adapter/mask/like",
            "comparison/base_adapter/mask/like",
            "comparison/base/version",
            "comparison/base/digest",
            "comparison/base/environment/driver/digest",
            "comparison/base/environment/values_digest",
            "comparison/head/version",
            "comparison/head/digest",
            "comparison/head/environment/driver/digest",
            "comparison/head/environment/values_digest",
            "comparison/cells",
            "comparison/configuration",
            "comparison/errors",
            "comparison/judged/name",
            "comparison/judged/unit",
            "comparison/judged/stage",
            "comparison/judged/before",
            "comparison/quantities",
            "comparison/cell",
            "comparison/counters",
            "comparison/stage",
            "comparison/what",
            "comparison/unit",
            "comparison/machine/base/throttle",
            "comparison/machine/head/throttle",
        ],
    ),
    (
        Text::Device,
        &[
            "run/adapter/name",
            "run/adapter/backend",
            "run/adapter/device_type",
            "run/adapter/driver",
            "run/adapter/driver_info",
            "run/conditions/rasterizer_threads",
            "run/conditions/machine/cpu",
            "run/conditions/machine/kernel",
            "run/conditions/machine/governor",
            "comparison/adapter/name",
            "comparison/adapter/backend",
            "comparison/adapter/device_type",
            "comparison/adapter/driver",
            "comparison/adapter/driver_info",
            "comparison/base_adapter/name",
            "comparison/base_adapter/backend",
            "comparison/base_adapter/device_type",
            "comparison/base_adapter/driver",
            "comparison/base_adapter/driver_info",
        ],
    ),
    (
        Text::Words,
        &[
            "run/notes/text",
            "experiment/toml",
            "cell/cell",
            "cell/axes",
            "cell/stand_ins",
            "cell/outcome/notes/text",
            "cell/outcome/reason",
            "comparison/skipped/reason",
            "comparison/notes",
            "comparison/reason",
        ],
    ),
    (
        Text::Path,
        &[
            "cell/scene",
            "cell/params",
            "comparison/base/label",
            "comparison/base/environment/driver/manifest",
            "comparison/base/environment/driver/library",
            "comparison/head/label",
            "comparison/head/environment/driver/manifest",
            "comparison/head/environment/driver/library",
        ],
    ),
    (Text::Machine, &["run/conditions/host"]),
    (Text::Command, &["run/command"]),
    (
        Text::Variables,
        &["comparison/base/environment/variables", "comparison/head/environment/variables"],
    ),
    (
        Text::Request,
        &["run/shard/selection/axes", "run/shard/selection/sets", "run/shard/selection/cells"],
    ),
];

fn text_at(place: &str) -> Option<Text> {
    TEXTS.iter().find(|(_, places)| places.contains(&place)).map(|(text, _)| *text)
}

/// Makes public copies of the records of one folder.
#[derive(Debug, Default)]
pub struct PublicCopy {
    /// Keeps raw samples.
    pub samples: bool,
    /// Names of machines that were met.
    machines: Vec<String>,
}

impl PublicCopy {
    pub fn new(samples: bool) -> Self {
        Self { samples, machines: Vec::new() }
    }

    /// The copy of a record; the next one of the same folder follows.
    pub fn of(&mut self, record: &Record) -> serde_json::Result<Record> {
        let mut value = serde_json::to_value(record)?;
        let kind = value["record"].as_str().unwrap_or_default().to_owned();
        self.reduce(&kind, &mut value);
        let mut copy: Record = serde_json::from_value(value)?;
        if let Record::Cell(cell) = &mut copy {
            let (experiment, name) = (cell.experiment.clone(), cell.cell.clone());
            if let Some(measured) = cell.measured_mut() {
                // The name of its file tells what the cell's name no longer tells.
                measured.pictures.retain(|p| p.path == picture_path(&experiment, &name, p.shows));
                if !self.samples {
                    drop_samples(measured);
                }
            }
        }
        Ok(copy)
    }

    fn reduce(&mut self, place: &str, value: &mut Value) {
        match (text_at(place), value) {
            (Some(text), value) => self.told(text, value),
            (None, Value::Object(fields)) => {
                fields.iter_mut().for_each(|(name, v)| self.reduce(&format!("{place}/{name}"), v));
            }
            (None, Value::Array(items)) => items.iter_mut().for_each(|v| self.reduce(place, v)),
            (None, _) => {}
        }
    }

    fn told(&mut self, text: Text, value: &mut Value) {
        match text {
            Text::Program | Text::Device => {}
            Text::Words => each_text(value, &mut |words| *words = private::words(words)),
            Text::Path => each_text(value, &mut |path| *path = last_parts(path)),
            Text::Machine => each_text(value, &mut |name| *name = self.numbered(name)),
            Text::Command => *value = command(value).into(),
            Text::Variables => {
                value.as_object_mut().into_iter().flatten().for_each(|(_, v)| *v = Value::Null);
            }
            Text::Request => *value = Value::Array(Vec::new()),
        }
    }

    fn numbered(&mut self, name: &str) -> String {
        let known = self.machines.iter().position(|known| known == name);
        let index = known.unwrap_or_else(|| {
            self.machines.push(name.to_owned());
            self.machines.len() - 1
        });
        format!("machine-{}", index + 1)
    }
}

/// All texts of a value; not the names of its fields.
fn each_text(value: &mut Value, change: &mut impl FnMut(&mut String)) {
    match value {
        Value::String(text) => change(text),
        Value::Array(items) => items.iter_mut().for_each(|item| each_text(item, change)),
        Value::Object(fields) => fields.iter_mut().for_each(|(_, field)| each_text(field, change)),
        Value::Null | Value::Bool(_) | Value::Number(_) => {}
    }
}

/// Of each path its last part, also behind `=` and `,`.
fn last_parts(text: &str) -> String {
    let pieces = text.split_inclusive(['=', ',']);
    pieces.map(|piece| piece.rsplit(['/', '\\']).next().unwrap_or_default()).join("")
}

fn command(words: &Value) -> Vec<String> {
    let words = words.as_array().into_iter().flatten().filter_map(Value::as_str);
    let words = words.map(str::to_owned).collect_vec();
    let program = words.first().map(|program| last_parts(program));
    let command = words.get(1).filter(|word| *word == "run").cloned();
    let (options, _) = parted(&words, &OF_CELLS);
    program.into_iter().chain(command).chain(options.iter().map(|word| last_parts(word))).collect()
}

/// Leaves the figures that were computed from them.
fn drop_samples(measured: &mut Measured) {
    for stage in &mut measured.stages {
        stage.samples_ns.clear();
        if let Some(fenced) = &mut stage.fenced {
            fenced.wall_samples_ns.clear();
            fenced.submit_cost_samples_ns.clear();
        }
    }
    let FrameRecord { accounting_error, untimed, timing_cost, .. } = measured.frame;
    measured.frame =
        FrameRecord { accounting_error, untimed, timing_cost, ..FrameRecord::default() };
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use serde_json::json;

    use super::*;
    use crate::schema::LineKind;

    /// Places of texts in a schema, of maps with names that no type knows, and of values of any kind.
    fn places(schema: &Value, place: &str, root: &Value, found: &mut BTreeSet<String>) {
        let is_text = schema["type"] == "string" || schema["type"] == json!(["string", "null"]);
        let is_fixed = ["const", "enum"].iter().any(|fixed| schema.get(fixed).is_some());
        let names = schema.get("additionalProperties").filter(|names| **names != json!(false));
        let has_names = names.is_some() && schema.get("propertyNames").is_none();
        if is_text && !is_fixed || has_names || schema == &json!(true) {
            found.insert(place.to_owned());
        }
        if let Some(name) = schema["$ref"].as_str() {
            places(root.pointer(&name[1..]).unwrap(), place, root, found);
        }
        for (name, field) in schema["properties"].as_object().into_iter().flatten() {
            places(field, &format!("{place}/{name}"), root, found);
        }
        let lists = ["oneOf", "anyOf", "prefixItems"].map(|list| schema[list].as_array());
        let items = [names, schema.get("items")];
        for inner in lists.into_iter().flatten().flatten().chain(items.into_iter().flatten()) {
            places(inner, place, root, found);
        }
    }

    #[test]
    fn every_text_of_a_record_is_listed_once() {
        let schema = LineKind::Record.schema();
        let mut found = BTreeSet::new();
        for kind in schema["oneOf"].as_array().unwrap() {
            let name = kind["properties"]["record"]["const"].as_str().unwrap();
            places(kind, name, &schema, &mut found);
        }
        let listed = TEXTS.iter().flat_map(|(_, places)| *places).map(|place| place.to_string());
        let listed = listed.sorted().collect_vec();
        assert_eq!(listed, found.into_iter().collect_vec());
    }

    /// Every text that is there is one that must not stay.
    #[test]
    fn what_the_machine_and_the_user_told_goes() {
        let run = json!({
            "host": "machine-0123", "command": ["/home/jo/fathom", "run", "secret", "--out", "jo",
                "--set", "water.file=/home/jo/x.png", "--seed=3"],
            "axes": [["a", ["jo"]]], "words": "cannot read /home/jo/x.obj", "path": "jo/x.toml",
            "variables": {"A": "jo", "B": null},
        });
        let mut copy = PublicCopy::default();
        let mut reduced = |text, name: &str| {
            let mut value = run[name].clone();
            copy.told(text, &mut value);
            value
        };
        assert_eq!(reduced(Text::Machine, "host"), "machine-1");
        let command = json!(["fathom", "run", "--set", "water.file=x.png"]);
        assert_eq!(reduced(Text::Command, "command"), command);
        assert_eq!(reduced(Text::Request, "axes"), json!([]));
        assert_eq!(reduced(Text::Words, "words"), "cannot read x.obj");
        assert_eq!(reduced(Text::Path, "path"), "x.toml");
        assert_eq!(reduced(Text::Variables, "variables"), json!({"A": null, "B": null}));
        assert_eq!(copy.numbered("another"), "machine-2");
        assert_eq!(copy.numbered("machine-0123"), "machine-1");
    }
}
