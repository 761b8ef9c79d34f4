//! Keeps the dependency rule that `src/lib.rs` states, within the crate `fathom`. Cargo keeps it between crates.

use std::fs;
use std::path::{Path, PathBuf};

/// Module → the crate's modules that it may import, itself apart.
const RULE: &[(&str, &str)] = &[
    ("words", ""),
    ("record", ""),
    ("gpu", "record"),
    ("stages", "gpu record"),
    ("pipelines", "gpu record stages"),
    ("experiments", "pipelines record words"),
    ("report", "experiments record words"),
    ("harness", "experiments gpu pipelines record stages"),
    ("compare", "experiments gpu harness pipelines record report stages"),
    ("history", "record report words"),
    ("bench", "compare gpu harness record"),
    ("fleet", "harness record"),
    ("exporters", "compare harness record report"),
];

/// Stage families may not import each other; what they share lies beside them.
const FAMILIES: &[&str] = &[
    "ao", "caustics", "godrays", "hsao", "photons", "post", "scalar", "scene", "shadow", "voxel",
    "water",
];

fn source() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("src")
}

fn rust_files(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let files = entries.flat_map(|path| if path.is_dir() { rust_files(&path) } else { vec![path] });
    let elsewhere = |path: &PathBuf| {
        path.ends_with("tests.rs")
            || path.ends_with("build.rs") && !path.ends_with("compare/build.rs")
    };
    let is_code = |path: &PathBuf| path.extension().is_some_and(|e| e == "rs") && !elsewhere(path);
    files.filter(is_code).collect()
}

/// Names after each `crate::`, tests and comments left out.
fn imports(text: &str) -> Vec<String> {
    let code = text.split("#[cfg(test)]").next().unwrap_or_default();
    code.lines()
        .filter(|line| !line.trim_start().starts_with("//"))
        .flat_map(|line| line.split("crate::").skip(1))
        .map(|rest| rest.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect())
        .collect()
}

#[test]
fn modules_import_only_what_the_rule_allows() {
    for file in rust_files(&source()) {
        let inside = file.strip_prefix(source()).unwrap();
        let module = inside.iter().next().unwrap().to_str().unwrap().trim_end_matches(".rs");
        let Some((_, allowed)) = RULE.iter().find(|(name, _)| *name == module) else {
            let crates = ["base", "scene", "reference"];
            let free = ["lib", "main", "cli"].contains(&module) || crates.contains(&module);
            assert!(free, "{} is in no module of the rule", inside.display());
            continue;
        };
        for import in imports(&fs::read_to_string(&file).unwrap()) {
            let known = RULE.iter().any(|(name, _)| *name == import);
            assert!(
                !known || import == module || allowed.split(' ').any(|name| name == import),
                "{} imports `{import}`, which `{module}` may not",
                inside.display()
            );
        }
    }
}

#[test]
fn stages_import_no_sibling_stage() {
    for family in FAMILIES {
        for file in rust_files(&source().join("stages").join(family)) {
            let text = fs::read_to_string(&file).unwrap();
            for other in FAMILIES {
                assert!(
                    !text.contains(&format!("stages::{other}::")),
                    "{} imports from the family `{other}`",
                    file.display()
                );
            }
        }
    }
}

/// Calls that print by themselves, and so panic when the output cannot be written.
const PRINTING: [&str; 5] = ["println!(", "eprintln!(", "print!(", "eprint!(", "dbg!("];

fn prints(text: &str) -> bool {
    let code = text.split("#[cfg(test)]").next().unwrap_or_default();
    let mut lines = code.lines().filter(|line| !line.trim_start().starts_with("//"));
    lines.any(|line| PRINTING.iter().any(|call| line.contains(call)))
}

#[test]
fn everything_is_printed_by_the_module_tell() {
    for file in rust_files(&source()) {
        let text = fs::read_to_string(&file).unwrap();
        assert!(!prints(&text), "{} prints by itself; use fathom::tell", file.display());
    }
    assert!(prints("fn f() {\n    eprintln!(\"x\");\n}\n"));
    assert!(!prints("// println!(x)\nfn f() {}\n"));
}

#[test]
fn the_import_reader_sees_imports() {
    assert_eq!(imports("use crate::gpu::Gpu;\n// crate::report\n"), ["gpu"]);
}
