//! `docs/scenes.md`: tables of keys are written from their declarations, by `FATHOM_BLESS=1`; of types that are no settings
//! the keys are checked.

use serde::Serialize;
use serde_json::{Value, json};

use super::{Camera, Light, Material, ObjectFile, SceneFile, Transform, VolumeFile, Water, Wave};
use fathom_base::parameter::{self, Allowed, ParamField, names_of};

const PATH: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/scenes.md");
/// Resolved while a file is read: they never reach the type.
const RESOLVED: [&str; 2] = ["base", "without"];

/// The keys of the table under a heading.
fn documented<'d>(docs: &'d str, heading: &str) -> Vec<&'d str> {
    let (_, section) = docs.split_once(&format!("\n## {heading}\n")).expect(heading);
    let section = section.split("\n## ").next().unwrap_or_default();
    let rows = section.lines().filter_map(|line| line.strip_prefix("| `"));
    let keys = rows.filter_map(|row| Some(row.split_once('`')?.0));
    keys.filter(|key| !RESOLVED.contains(key)).collect()
}

/// A group's rows. What has no default is required.
fn rows(fields: Vec<ParamField>, defaults: &impl Serialize) -> String {
    // By text, so that 32-bit floats are as short as they are written.
    let text = serde_json::to_string(defaults).expect("plain values");
    let defaults: Value = serde_json::from_str(&text).expect("what was written");
    let row = |ParamField { path, allowed, unit, about }: ParamField| {
        let range = match allowed {
            Allowed::Numbers(range) => format!("{} to {}", range.low, range.high),
            Allowed::Names(names) => format!("`{}`", names.join("`, `")),
            Allowed::Flag => "`true`, `false`".to_owned(),
            Allowed::Free => String::new(),
        };
        let default = defaults.get(&path);
        let default = default.map_or("required".to_owned(), |value| format!("`{value}`"));
        format!("| `{path}` | {unit} | {range} | {default} | {} |\n", about.replace('|', "\\|"))
    };
    fields.into_iter().map(row).collect()
}

/// The text with these rows in the table under a heading.
fn with_rows(docs: &str, heading: &str, rows: &str) -> String {
    const HEADER: &str = "| key | unit | range | default | meaning |\n|---|---|---|---|---|\n";
    let section = docs.find(&format!("\n## {heading}\n")).expect(heading);
    let first = section + docs[section..].find(HEADER).expect("a table") + HEADER.len();
    let end = docs[first..].find("\n\n").map_or(docs.len(), |end| first + end + 1);
    format!("{}{rows}{}", &docs[..first], &docs[end..])
}

#[test]
fn keys_are_documented_as_they_are_declared() {
    let found = std::fs::read_to_string(PATH).unwrap();
    let up = json!({ "up": Camera::new([0.0; 3], [1.0; 3], 60.0, [0.1, 1.0]).up });
    let tables = [
        ("`[camera]`", rows(parameter::fields::<Camera>(), &up)),
        ("`[light]`", rows(parameter::fields::<Light>(), &Light::default())),
        ("`[water]`", rows(parameter::fields::<Water>(), &Water::default())),
        ("`[[water.waves]]`", rows(parameter::fields::<Wave>(), &json!({ "phase_rad": 0.0 }))),
        ("`[object.transform]`", rows(parameter::fields::<Transform>(), &Transform::default())),
        ("`[object.material]`", rows(parameter::fields::<Material>(), &Material::default())),
    ];
    let mut expected = found.clone();
    for (heading, rows) in &tables {
        expected = with_rows(&expected, heading, rows);
    }
    if std::env::var_os("FATHOM_BLESS").is_some() {
        std::fs::write(PATH, &expected).unwrap();
    }
    let differs = found.lines().zip(expected.lines()).find(|(found, expected)| found != expected);
    assert_eq!(differs, None, "docs/scenes.md: FATHOM_BLESS=1 writes it");
    assert_eq!(found, expected, "docs/scenes.md: FATHOM_BLESS=1 writes it");
    let keys = [
        ("Top level", names_of::<SceneFile>()),
        ("`[[object]]`", names_of::<ObjectFile>()),
        ("`[volume]`", names_of::<VolumeFile>()),
    ];
    for (heading, keys) in keys {
        assert_eq!(documented(&found, heading), keys, "{heading}");
    }
    let sections = tables.len() + 3 + 1;
    assert_eq!(found.matches("\n## ").count(), sections, "a section that no type stands for");
}
