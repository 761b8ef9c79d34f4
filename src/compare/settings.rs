//! What a comparison or a search was begun with, in its folder. One that is resumed must be asked for the same.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, Result, bail};
use itertools::Itertools;
use serde_json::{Map, Value, json};

use super::cells::Gates;
use fathom_base::{folder, input};
use fathom_record::comparison::GateSettings;

/// Name of the file.
pub const SETTINGS: &str = "settings.json";
/// Differences that a refusal names, and characters of a value that it shows.
const MAX_NAMED: usize = 3;
const MAX_SHOWN: usize = 60;

/// The rules and the cells, with the options that are not of both.
pub fn collect(settings: &GateSettings, gates: &Gates, more: Value) -> Value {
    let cells: BTreeMap<_, _> = gates
        .configurations
        .iter()
        .map(|own| (&own.id, json!({ "configuration": own, "stages": own.stages })))
        .collect();
    let common =
        json!({ "fathom": env!("CARGO_PKG_VERSION"), "control": gates.control, "cells": cells });
    let parts = [json!(settings), common, more].into_iter();
    Value::Object(parts.filter_map(|part| part.as_object().cloned()).flatten().collect())
}

/// Stores the settings of what is begun in a folder.
pub fn store(folder: &Path, settings: &Value) -> Result<()> {
    let path = folder.join(SETTINGS);
    let text = serde_json::to_string_pretty(settings)? + "\n";
    let made = std::fs::create_dir_all(folder);
    let written = made.and_then(|()| folder::write(&path, text.as_bytes()));
    written.with_context(|| format!("cannot write {}", path.display()))
}

pub fn load(folder: &Path) -> Result<Value> {
    let path = folder.join(SETTINGS);
    let text = input::text(&path, input::MAX_TEXT).with_context(|| {
        let missing = "what this was begun with is not known, so it cannot be resumed";
        format!("{}: {missing}; choose another folder with --out", path.display())
    })?;
    serde_json::from_str(&text).with_context(|| path.display().to_string())
}

/// Refuses settings other than those that a folder was begun with, by name.
pub fn check(folder: &Path, asked: &Value) -> Result<()> {
    let before = load(folder)?;
    let [before, asked] = [&before, asked].map(|all| {
        let mut leaves = BTreeMap::new();
        flatten("", all, &mut leaves);
        leaves
    });
    let names = before.keys().chain(asked.keys()).sorted().dedup();
    let different = names.filter(|name| before.get(*name) != asked.get(*name)).map(|name| {
        let [then, now] = [&before, &asked].map(|of| format_value(of.get(name)));
        format!("`{name}` was {then} and is now {now}")
    });
    let all = different.collect_vec();
    if all.is_empty() {
        return Ok(());
    }
    let more = all.len().saturating_sub(MAX_NAMED);
    let more = if more > 0 { format!("; and {more} more") } else { String::new() };
    let named = all.iter().take(MAX_NAMED).join("; ");
    bail!(
        "{} was begun with other settings: {named}{more}: resume with the same, or choose another folder with --out",
        folder.display()
    )
}

/// Values by their dotted paths. A list is one value.
fn flatten(path: &str, value: &Value, leaves: &mut BTreeMap<String, Value>) {
    match value {
        Value::Object(fields) if *fields != Map::new() => {
            fields.iter().for_each(|(name, field)| {
                let dot = if path.is_empty() { "" } else { "." };
                flatten(&format!("{path}{dot}{name}"), field, leaves);
            })
        }
        Value::Null => {}
        leaf => drop(leaves.insert(path.to_owned(), leaf.clone())),
    }
}

fn format_value(value: Option<&Value>) -> String {
    let text = value.map_or("absent".to_owned(), Value::to_string);
    let short: String = text.chars().take(MAX_SHOWN).collect();
    if short == text { text } else { format!("{short}…") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whatever_differs_is_refused_by_name_with_both_values() {
        let folder = tempfile::tempdir().unwrap();
        let plain = json!({ "threshold": 0.02, "seed": u64::MAX, "cells": { "a": { "params": { "n": 1 } } }, "none": null });
        assert!(check(folder.path(), &plain).is_err(), "there are none");
        store(folder.path(), &plain).unwrap();
        check(folder.path(), &plain).unwrap();
        let differs = |pointer: &str, value: Value, expected: &str| {
            let mut other = plain.clone();
            *other.pointer_mut(pointer).unwrap() = value;
            let error = check(folder.path(), &other).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        };
        differs("/threshold", json!(0.05), "`threshold` was 0.02 and is now 0.05");
        differs("/cells/a/params", json!({}), "`cells.a.params.n` was 1 and is now absent");
        differs("/cells/a/params/n", json!(2), "`cells.a.params.n` was 1 and is now 2");
        differs("/none", json!("x"), "`none` was absent and is now \"x\"");
    }
}
