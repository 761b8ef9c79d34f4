//! From the text of a scene file to its value: bases, and errors that name line and nearest key.

use std::path::Path;

use serde::de::DeserializeOwned;
use toml::{Table, Value};

use super::{SceneError, check};
use fathom_base::embedded::Folders;
use fathom_base::{input, text};

/// How far a chain of `base` scenes may go.
const MAX_BASES: usize = 4;

/// Keys that are resolved here and do not reach the scene's file.
const BASE: &str = "base";
const WITHOUT: &str = "without";

/// The text of a scene of these folders, or of a path, and where it is from.
pub fn find(folders: &Folders, name_or_path: &str) -> Result<(String, String), SceneError> {
    let file = format!("{name_or_path}.toml");
    if let Some((folder, text)) = folders.text(&file) {
        return Ok((format!("{folder}/{file}"), text));
    }
    let path = Path::new(name_or_path);
    if path.extension().is_none() && (path.is_dir() || !path.exists()) {
        let scenes = folders.texts(".toml");
        return Err(SceneError::Unknown {
            name: name_or_path.to_owned(),
            hint: check::hint(name_or_path, scenes.iter().map(|(name, _)| name.as_str())),
        });
    }
    if path.extension().is_some_and(|ending| !ending.eq_ignore_ascii_case("toml")) {
        return Err(SceneError::NoScene { path: path.to_owned() });
    }
    let text = input::text(path, input::MAX_TEXT)
        .map_err(|source| SceneError::Read { path: path.to_owned(), source })?;
    Ok((name_or_path.to_owned(), text))
}

/// Reads a scene file's text, with what it takes from its base; and all that these say, without comments.
pub fn read<T: DeserializeOwned>(
    folders: &Folders,
    origin: &str,
    text: &str,
) -> Result<(T, String), SceneError> {
    let table = parse(origin, text)?;
    if !table.contains_key(BASE) && !table.contains_key(WITHOUT) {
        let read = toml::from_str(text).map_err(|e| fault(origin, text, &e))?;
        return Ok((read, table.to_string()));
    }
    let merged = with_base(folders, origin, table, MAX_BASES)?.to_string();
    // As text again: reading a table as well as a text would compile every scene type twice.
    Ok((toml::from_str(&merged).map_err(|e| fault(origin, "", &e))?, merged))
}

fn parse(origin: &str, text: &str) -> Result<Table, SceneError> {
    text.parse().map_err(|e| fault(origin, text, &e))
}

/// The table on top of its base's.
fn with_base(
    folders: &Folders,
    origin: &str,
    mut table: Table,
    left: usize,
) -> Result<Table, SceneError> {
    let wrong =
        |message: &str| SceneError::Parse { origin: origin.into(), message: message.into() };
    let without = names(table.remove(WITHOUT))
        .ok_or_else(|| wrong("`without` must be a list of names of the base's objects"))?;
    let base = match table.remove(BASE) {
        None if without.is_empty() => return Ok(table),
        Some(Value::String(name)) => name,
        _ => return Err(wrong("`base` must be the name or path of a scene")),
    };
    if left == 0 {
        return Err(wrong(&format!("more than {MAX_BASES} bases in a chain")));
    }
    let (base_origin, text) = find(folders, &beside(origin, &base))?;
    let base = parse(&base_origin, &text)?;
    let mut merged = with_base(folders, &base_origin, base, left - 1)?;
    remove_objects(&mut merged, &without).map_err(|message| wrong(&message))?;
    overlay(&mut merged, table);
    Ok(merged)
}

/// A base given by path is relative to the file that names it.
fn beside(origin: &str, base: &str) -> String {
    let named = Path::new(base).extension().is_none();
    let folder = Path::new(origin).parent().filter(|_| !named);
    folder.map_or_else(|| base.to_owned(), |f| f.join(base).to_string_lossy().into_owned())
}

fn names(value: Option<Value>) -> Option<Vec<String>> {
    match value {
        None => Some(Vec::new()),
        Some(value) => {
            value.as_array()?.iter().map(|item| Some(item.as_str()?.to_owned())).collect()
        }
    }
}

fn remove_objects(table: &mut Table, without: &[String]) -> Result<(), String> {
    let Some(Value::Array(objects)) = table.get_mut("object") else {
        return Ok(());
    };
    let name_of = |v: &Value| v.get("name").and_then(Value::as_str).unwrap_or("").to_owned();
    let names: Vec<String> = objects.iter().map(name_of).collect();
    if let Some(unknown) = without.iter().find(|name| !names.contains(name)) {
        let hint = check::hint(unknown, names.iter().map(String::as_str));
        return Err(format!("`without`: the base has no object `{unknown}`: {hint}"));
    }
    objects.retain(|object| !without.contains(&name_of(object)));
    Ok(())
}

/// Puts `top` over `table`: tables are merged, lists of objects joined, all else replaced.
fn overlay(table: &mut Table, top: Table) {
    for (key, value) in top {
        match (table.get_mut(&key), value) {
            (Some(Value::Table(below)), Value::Table(above)) => overlay(below, above),
            (Some(Value::Array(below)), Value::Array(above)) if key == "object" => {
                below.extend(above);
            }
            (_, value) => {
                table.insert(key, value);
            }
        }
    }
}

/// One line: the place, what is wrong, and for an unknown key the nearest valid one.
fn fault(origin: &str, text: &str, error: &toml::de::Error) -> SceneError {
    let line = error
        .span()
        .and_then(|span| text.get(..span.start))
        .map(|before| format!("line {}: ", before.matches('\n').count() + 1));
    let key =
        error.span().and_then(|span| text.get(span)).filter(|_| error.message() == "duplicate key");
    let key = key.map_or_else(String::new, |key| format!(" `{key}`"));
    let message = format!("{}{}{key}", line.unwrap_or_default(), named(error.message()));
    SceneError::Parse { origin: origin.to_owned(), message }
}

/// `unknown field`, followed by the nearest of the fields that serde lists.
fn named(message: &str) -> String {
    let quoted: Vec<&str> = message.split('`').skip(1).step_by(2).collect();
    match (message.starts_with("unknown "), quoted.split_first()) {
        (true, Some((unknown, valid))) => {
            let hint = check::hint(unknown, valid.iter().copied());
            let kind = message.split('`').next().unwrap_or_default().trim().replace("field", "key");
            format!("{kind} `{}`: {hint}", text::excerpt(unknown))
        }
        _ => text::fault(message),
    }
}

#[cfg(test)]
mod tests {
    use super::super::SceneFile;
    use super::*;
    use fathom_base::embedded::SCENES;

    const MINIMAL: &str = r#"
name = "test"
description = "test"
floor_depth_m = 2.0
[camera]
position_m = [0, -1, 3]
target_m = [0, -1, 0]
fov_y_deg = 60
z_near_m = 0.1
z_far_m = 9
[[object]]
name = "floor"
generator = "plane"
"#;

    fn read_here(text: &str) -> Result<SceneFile, SceneError> {
        read(&Folders::new(SCENES), "test.toml", text).map(|(file, _)| file)
    }

    #[test]
    fn faults_are_told_in_a_line_with_their_place_and_the_nearest_key() {
        let with = |from: &str, to: &str| MINIMAL.replace(from, to);
        let cases: [(String, &[&str]); 10] = [
            (with("fov_y_deg", "fov_deg"), &["line 8", "`fov_y_deg`"]),
            (format!("{MINIMAL}genrator = \"plane\"\n"), &["`generator`"]),
            (with("[camera]", "[camara]"), &["`camera`"]),
            ("name = ".into(), &["line 1"]),
            (with("60", "\"wide\""), &["line 8"]),
            ("name = \"x\"".into(), &["missing field"]),
            ("base = 3".into(), &["`base` must be"]),
            ("without = [\"a\"]".into(), &["`base` must be"]),
            ("base = \"tank\"\nwithout = 1".into(), &["`without` must be"]),
            ("base = \"tank\"\nwithout = [\"statu\"]".into(), &["`statue`"]),
        ];
        for (text, parts) in cases {
            let error = read_here(&text).unwrap_err().to_string();
            assert_eq!(error.lines().count(), 1, "{error}");
            for part in [&["test.toml"], parts].concat() {
                assert!(error.contains(part), "{error}");
            }
        }
        let error = read_here("base = \"tnak\"").unwrap_err();
        assert!(error.to_string().contains("`tank`"), "{error}");
    }

    #[test]
    fn a_base_gives_what_is_not_said() {
        let text = r#"
base = "tank"
without = ["statue"]
name = "mine"
[water]
amplitude_m = 0.2
[[object]]
name = "ball"
generator = "sphere"
"#;
        let tank = SceneFile::load("tank").expect("tank");
        let mine = read_here(text).expect("mine");
        assert_eq!(mine.camera, tank.camera);
        assert_eq!(mine.water.amplitude_m, 0.2);
        assert_eq!(mine.water.wavelength_m, tank.water.wavelength_m);
        assert_eq!(mine.objects.len(), tank.objects.len());
        assert_eq!(mine.objects.last().expect("ball").name, "ball");
    }

    #[test]
    fn a_base_that_is_its_own_base_ends() {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("loop.toml");
        std::fs::write(&path, "base = \"loop.toml\"").expect("written");
        let error = SceneFile::load(&path.to_string_lossy()).unwrap_err();
        assert!(error.to_string().contains("bases in a chain"), "{error}");
    }
}
