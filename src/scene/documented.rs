//! `docs/scenes.md` names every key of a scene file with its default and its range, and no other.

use serde_json::{Value, json};

use super::generators::{self, Param, fields};
use super::{Camera, Light, Material, ObjectFile, SceneFile, Transform, VolumeFile, Water, Wave};
use fathom_base::parameter::{self, Allowed, Field, Range, names_of};

const DOCS: &str = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/scenes.md"));

/// A row of a table of keys.
struct DocumentedRow {
    key: &'static str,
    range: &'static str,
    default: &'static str,
}

/// The rows of the section under a heading.
fn rows(heading: &str) -> Vec<DocumentedRow> {
    let (_, section) = DOCS
        .split_once(&format!("\n## {heading}\n"))
        .unwrap_or_else(|| panic!("no section {heading}"));
    let section = section.split("\n## ").next().unwrap_or_default();
    let lines = section.lines().filter_map(|line| line.strip_prefix("| `"));
    lines
        .map(|line| {
            let cells: Vec<&'static str> = line.split(" | ").collect();
            assert!(cells.len() >= 4, "{line}");
            let meaning = cells.last().expect("a cell").trim_end_matches(" |");
            assert!(!meaning.is_empty(), "{line}");
            let offset = usize::from(cells.len() == 4);
            DocumentedRow {
                key: cells[0].trim_end_matches('`'),
                range: cells[2 - offset].trim_matches(['|', ' ']),
                default: cells[3 - offset].trim_matches(['|', ' ']),
            }
        })
        .collect()
}

/// A scene with nothing but what must be there.
fn minimal() -> Value {
    json!({
        "name": "a", "description": "b", "floor_depth_m": 2.0,
        "camera": {"position_m": [0.0, 1.0, 5.0], "target_m": [0.0, 0.0, 0.0], "fov_y_deg": 60.0, "z_near_m": 0.1, "z_far_m": 9.0},
        "object": [{"name": "floor", "generator": "plane"}],
    })
}

/// A section's heading, the keys that serde takes there, where it lies in a scene, what declares its ranges, and a scene that has it.
type Section = (&'static str, &'static [&'static str], &'static str, Vec<Field>, Value);

fn sections() -> impl Iterator<Item = Section> {
    let wave = json!({"direction": [1.0, 0.0], "wavelength_m": 2.0, "amplitude_m": 0.1});
    let waves = json!({"water": {"model": "waves", "waves": [wave]}});
    let smoke = json!({"volume": {"generator": "smoke"}});
    let plain = || json!({});
    let sections = [
        ("Top level", names_of::<SceneFile>(), "", Vec::new(), plain()),
        ("`[camera]`", names_of::<Camera>(), "/camera", parameter::fields::<Camera>(), plain()),
        ("`[light]`", names_of::<Light>(), "/light", parameter::fields::<Light>(), plain()),
        ("`[water]`", names_of::<Water>(), "/water", parameter::fields::<Water>(), plain()),
        (
            "`[[water.waves]]`",
            names_of::<Wave>(),
            "/water/waves/0",
            parameter::fields::<Wave>(),
            waves,
        ),
        ("`[[object]]`", names_of::<ObjectFile>(), "/object/0", Vec::new(), plain()),
        (
            "`[object.transform]`",
            names_of::<Transform>(),
            "/object/0/transform",
            parameter::fields::<Transform>(),
            plain(),
        ),
        (
            "`[object.material]`",
            names_of::<Material>(),
            "/object/0/material",
            parameter::fields::<Material>(),
            plain(),
        ),
        (
            "`[volume]`",
            names_of::<VolumeFile>(),
            "/volume",
            parameter::fields::<VolumeFile>(),
            smoke,
        ),
    ];
    sections.into_iter().map(|(heading, keys, place, fields, changes)| {
        let mut scene = minimal();
        scene.as_object_mut().unwrap().extend(changes.as_object().unwrap().clone());
        let file: SceneFile = serde_json::from_value(scene).unwrap();
        (heading, keys, place, fields, serde_json::to_value(file).unwrap())
    })
}

#[test]
fn every_key_is_documented_and_every_documented_key_is_one() {
    for (heading, keys, ..) in sections() {
        assert!(!keys.is_empty(), "{heading}");
        let mut documented: Vec<&str> = rows(heading).iter().map(|row| row.key).collect();
        // Resolved while the file is read: they never reach the type.
        if heading == "Top level" {
            documented.retain(|key| !["base", "without"].contains(key));
        }
        assert_eq!(documented, keys, "{heading}");
    }
    let count = DOCS.matches("\n## ").count();
    assert_eq!(count, sections().count() + 2, "a section that no type stands for");
}

#[test]
fn documented_defaults_are_those_of_the_program() {
    for (heading, _, place, _, scene) in sections() {
        let tree = scene.pointer(place).unwrap();
        for row in rows(heading) {
            let Some(literal) = row.default.strip_prefix('`').and_then(|d| d.strip_suffix('`'))
            else {
                let known = ["required", "its defaults", "none"].contains(&row.default);
                assert!(known, "{heading} {}: default {}", row.key, row.default);
                continue;
            };
            let table: toml::Table = format!("v = {literal}").parse().unwrap();
            let value = &tree[row.key];
            if value == "smoke" || row.key == "object" {
                continue;
            }
            let expected = serde_json::to_value(&table["v"]).unwrap();
            let numbers = |v: &Value| -> Option<Vec<f64>> {
                v.as_array().map_or_else(
                    || Some(vec![v.as_f64()?]),
                    |all| all.iter().map(Value::as_f64).collect(),
                )
            };
            let near = |(a, b): (&f64, &f64)| (a - b).abs() < 1e-6;
            let same = match (numbers(value), numbers(&expected)) {
                (Some(a), Some(b)) => a.len() == b.len() && a.iter().zip(&b).all(near),
                _ => *value == expected,
            };
            assert!(same, "{heading} {}: {value} is documented as {literal}", row.key);
        }
    }
}

/// `1e-3 to 100000`, where a range is of that form.
fn bounds(range: &str) -> Option<[f64; 2]> {
    let (low, high) = range.split_once(" to ")?;
    Some([low.parse().ok()?, high.parse().ok()?])
}

#[test]
fn documented_ranges_and_choices_are_those_of_the_program() {
    let mut judged = 0;
    for (heading, _, _, fields, _) in sections() {
        for row in rows(heading) {
            let field = fields.iter().find(|field| field.path == row.key);
            match (field.map(|field| field.allowed), bounds(row.range)) {
                (Some(Allowed::Numbers(Range { low, high })), Some(documented)) => {
                    assert_eq!(documented, [low, high], "{heading} {}", row.key);
                    judged += 1;
                }
                (Some(Allowed::Names(names)), _) => {
                    let names: Vec<String> = names.iter().map(|name| format!("`{name}`")).collect();
                    assert_eq!(row.range, names.join(", "), "{heading} {}", row.key);
                    judged += 1;
                }
                _ => {}
            }
        }
    }
    assert!(judged > 30, "{judged}");
}

/// The sections on generators as the program's own declarations have them.
fn generator_sections() -> String {
    let header = "| generator | parameter | range | default | meaning |\n|---|---|---|---|---|\n";
    let objects: String =
        generators::all().map(|g| generator_rows(g.name, g.about, g.params)).collect();
    let row = |g: &fields::FieldGenerator| format!("| `{}` | {} |\n", g.name, g.about);
    let volumes: String = fields::all().map(row).collect();
    format!(
        "## Generators of objects\n\nOf an `[[object]]`; units are in the names.\n\n{header}{objects}\n\
         ## Generators of volumes\n\nOf a `[volume]`; each is a field over a box whose longest edge is 1.\n\n\
         | generator | meaning |\n|---|---|\n{volumes}"
    )
}

fn generator_rows(name: &str, about: &str, params: &[Param]) -> String {
    let row = |p: &Param| {
        format!("| | `{}` | {} to {} | `{}` | {} |\n", p.name, p.low, p.high, p.default, p.about)
    };
    let rows: String = params.iter().map(row).collect();
    format!("| `{name}` | | | | {about} |\n{rows}")
}

#[test]
fn generators_are_documented_as_they_are_declared() {
    let expected = generator_sections();
    let found = DOCS.find("## Generators of objects").map_or("", |at| &DOCS[at..]);
    for (expected, found) in expected.lines().zip(found.lines()) {
        assert_eq!(found, expected, "docs/scenes.md");
    }
    assert!(found.trim_end() == expected.trim_end(), "docs/scenes.md should end with:\n{expected}");
}
