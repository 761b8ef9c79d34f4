//! `docs/scenes.md` names every key of a scene file and every generator, and no other.

use super::generators::{self, Param, fields};
use super::{Camera, Light, Material, ObjectFile, SceneFile, Transform, VolumeFile, Water, Wave};
use fathom_base::parameter::names_of;

const DOCS: &str = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/scenes.md"));

/// The keys of the table under a heading.
fn documented(heading: &str) -> Vec<&'static str> {
    let (_, section) = DOCS
        .split_once(&format!("\n## {heading}\n"))
        .unwrap_or_else(|| panic!("no section {heading}"));
    let section = section.split("\n## ").next().unwrap_or_default();
    let rows = section.lines().filter_map(|line| line.strip_prefix("| `"));
    rows.filter_map(|row| Some(row.split_once('`')?.0)).collect()
}

#[test]
fn every_key_is_documented_and_every_documented_key_is_one() {
    let sections = [
        ("Top level", names_of::<SceneFile>()),
        ("`[camera]`", names_of::<Camera>()),
        ("`[light]`", names_of::<Light>()),
        ("`[water]`", names_of::<Water>()),
        ("`[[water.waves]]`", names_of::<Wave>()),
        ("`[[object]]`", names_of::<ObjectFile>()),
        ("`[object.transform]`", names_of::<Transform>()),
        ("`[object.material]`", names_of::<Material>()),
        ("`[volume]`", names_of::<VolumeFile>()),
    ];
    for (heading, keys) in sections {
        let mut documented = documented(heading);
        // Resolved while the file is read: they never reach the type.
        if heading == "Top level" {
            documented.retain(|key| !["base", "without"].contains(key));
        }
        assert_eq!(documented, keys, "{heading}");
    }
    let count = DOCS.matches("\n## ").count();
    assert_eq!(count, sections.len() + 2, "a section that no type stands for");
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
