//! Runs that lack a figure: no report prints what is not finite.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use fathom::exporters;
use fathom::judge::files::RunFile;
use fathom::record::{self, Record};
use fathom::report::changes::RunChanges;
use fathom::report::{OF_RUNS, Timing};
use rayon::prelude::*;
use serde_json::{Map, Value};

use super::common::{Place, reference_of, write_records};

/// Cells of a plot with an exponent, of the committed run.
const CELLS: usize = 4;
const WORDS: [&str; 3] = ["nan", "inf", "infinity"];

/// Paths of what is a number, or a list of numbers; places in other lists are left out.
fn paths(path: &str, value: &Value, found: &mut BTreeSet<String>) {
    let is_list = |items: &Vec<Value>| items.first().is_some_and(Value::is_number);
    match value {
        Value::Object(fields) => {
            fields.iter().for_each(|(name, field)| paths(&format!("{path}/{name}"), field, found));
        }
        Value::Array(items) if !is_list(items) => {
            items.iter().for_each(|item| paths(path, item, found))
        }
        Value::Number(_) | Value::Array(_) => drop(found.insert(path.to_owned())),
        _ => {}
    }
}

/// Does something to the figure of a path, wherever it is.
fn change(path: &[&str], value: &mut Value, by: &dyn Fn(&mut Map<String, Value>, &str)) {
    match (value, path) {
        (Value::Array(items), _) => items.iter_mut().for_each(|item| change(path, item, by)),
        (Value::Object(fields), [name]) if fields.contains_key(*name) => {
            by(fields, name);
        }
        (Value::Object(fields), [name, rest @ ..]) => {
            if let Some(field) = fields.get_mut(*name) {
                change(rest, field, by);
            }
        }
        _ => {}
    }
}

/// The ways in which a figure may lack: it is not there, it is null, there are no samples; or it is zero.
type Lacking = fn(&mut Map<String, Value>, &str);
const LACKING: [Lacking; 3] = [
    |fields, name| drop(fields.remove(name)),
    |fields, name| fields[name] = Value::Null,
    |fields, name| fields[name] = Value::Array(Vec::new()),
];
const ZERO: fn(&mut Map<String, Value>, &str) = |fields, name| match &mut fields[name] {
    Value::Array(items) => items.iter_mut().for_each(|item| *item = 0.into()),
    number => *number = 0.into(),
};

/// How often each file of each report, and what changed since the whole run, holds such a word.
fn words(base: &Path, folder: &Path) -> BTreeMap<String, usize> {
    let reading = || record::read(&folder.join("records.jsonl")).unwrap();
    let mut files: Vec<(String, Vec<u8>)> = Vec::new();
    for exporter in OF_RUNS.iter().filter(|exporter| exporter.written == Timing::OnRequest) {
        let exported = exporters::export(exporter.name, folder, reading());
        files.extend(
            exported.into_iter().flat_map(|it| it.files()).map(|file| (file.name, file.bytes)),
        );
    }
    files.extend(exporters::write(folder, reading(), None).unwrap().into_iter().map(|path| {
        (path.file_name().unwrap().to_string_lossy().into_owned(), std::fs::read(&path).unwrap())
    }));
    let changes = [base, folder].map(|of| RunFile::read(&of.join("records.jsonl")).unwrap());
    let changes =
        RunChanges::from_files([&changes[0], &changes[1]], &[]).map(RunChanges::into_text);
    files.extend(changes.into_iter().map(|text| ("changes".to_owned(), text.into_bytes())));
    let count = |bytes: &[u8]| {
        let text = String::from_utf8_lossy(bytes).to_lowercase();
        text.split(|c: char| !c.is_alphanumeric()).filter(|word| WORDS.contains(word)).count()
    };
    files.into_iter().map(|(name, bytes)| (name, count(&bytes))).collect()
}

#[test]
fn no_report_prints_what_is_not_finite_whichever_figure_lacks() {
    let mut left = 0..CELLS;
    let mut records = reference_of("uw-photons");
    records.retain(|record| record.try_as_cell_ref().is_none_or(|_| left.next().is_some()));
    let place = Place::new();
    write_records(&place.path("whole"), &records);
    // What a page's own script says.
    let whole = words(&place.path("whole"), &place.path("whole"));
    assert!(whole.len() > OF_RUNS.len() && whole["summary.md"] == 0, "{whole:?}");
    let lines: Vec<Value> =
        records.iter().map(|record| serde_json::to_value(record).unwrap()).collect();
    let mut found = BTreeSet::new();
    lines.iter().for_each(|line| paths("", line, &mut found));
    // Parameters and the version of the format are no figures.
    let found: Vec<String> =
        found.into_iter().filter(|path| !path.contains("/params/") && path != "/schema").collect();
    // Each figure in one of both ways; `make test-all` tries each in both.
    let is_whole = std::env::var_os("FATHOM_DRAWS").is_some();
    let tried = found.par_iter().enumerate().map(|(number, path)| {
        let path: Vec<&str> = path.split('/').skip(1).collect();
        let mut tried = Vec::new();
        let changed = |by: &dyn Fn(&mut Map<String, Value>, &str)| -> Option<Vec<Record>> {
            let mut lines = lines.clone();
            lines.iter_mut().for_each(|line| change(&path, line, by));
            lines.into_iter().map(|line| serde_json::from_value(line).ok()).collect()
        };
        let lacking = LACKING.iter().find_map(|by| changed(by));
        let ways = [lacking, changed(&ZERO)].into_iter().enumerate();
        for (way, changed) in ways.filter(|(way, _)| is_whole || number % 2 == *way) {
            let Some(changed) = changed else { continue };
            let folder = place.path(format!("{number}-{way}"));
            write_records(&folder, &changed);
            let words = words(&place.path("whole"), &folder).into_iter();
            let more = words.filter(|(name, count)| count > whole.get(name).unwrap_or(&0));
            let named = more.map(|(name, _)| format!("{}, way {way}: {name}", path.join(" ")));
            tried.push(named.collect::<Vec<_>>());
            std::fs::remove_dir_all(&folder).unwrap();
        }
        tried
    });
    let tried: Vec<Vec<String>> = tried.flatten().collect();
    assert!(tried.len() > 30, "{} of {} figures", tried.len(), found.len());
    assert_eq!(tried.concat(), Vec::<String>::new());
}
