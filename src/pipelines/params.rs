//! A pipeline's parameters as a tree whose leaves are named by dotted paths, such as `caustics.grid`.

use serde_json::Value;
use thiserror::Error;

#[derive(Debug, Error, PartialEq, Eq)]
pub enum ParamError {
    #[error("unknown parameter `{path}`{}", hint(.nearest))]
    Unknown { path: String, nearest: Option<String> },
    #[error("parameter `{path}` takes {expected}, not {given}")]
    Type { path: String, expected: String, given: String },
}

fn hint(nearest: &Option<String>) -> String {
    match nearest {
        Some(name) => format!("; did you mean `{name}`?"),
        None => String::new(),
    }
}

/// Dotted paths of all leaves, in order. Arrays are leaves.
pub fn leaves(tree: &Value) -> Vec<String> {
    let mut paths = Vec::new();
    collect(tree, "", &mut paths);
    paths
}

fn collect(tree: &Value, prefix: &str, paths: &mut Vec<String>) {
    match tree {
        Value::Object(map) => {
            for (key, value) in map {
                let path = if prefix.is_empty() { key.clone() } else { format!("{prefix}.{key}") };
                collect(value, &path, paths);
            }
        }
        _ => paths.push(prefix.to_owned()),
    }
}

/// Value of a leaf.
pub fn get<'t>(tree: &'t Value, path: &str) -> Option<&'t Value> {
    path.split('.').try_fold(tree, |node, key| node.get(key))
}

/// Puts a value at a leaf. The value must be of the kind that stands there; whole numbers pass for reals.
///
/// # Errors
/// An unknown path, with the nearest valid one, and a value of another kind.
pub fn set(tree: &mut Value, path: &str, value: Value) -> Result<(), ParamError> {
    let all = leaves(tree);
    if !all.iter().any(|leaf| leaf == path) {
        return Err(ParamError::Unknown { path: path.to_owned(), nearest: nearest(path, &all) });
    }
    let leaf = path
        .split('.')
        .try_fold(tree, |node, key| node.get_mut(key))
        .expect("the path is one of the tree's leaves");
    *leaf = fitting(leaf, value).map_err(|given| ParamError::Type {
        path: path.to_owned(),
        expected: kind(leaf),
        given: given.to_string(),
    })?;
    Ok(())
}

/// The leaf closest in spelling, if any is close at all.
fn nearest(path: &str, all: &[String]) -> Option<String> {
    let last = |p: &str| p.rsplit('.').next().unwrap_or(p).to_owned();
    all.iter()
        .map(|leaf| {
            let whole = strsim::jaro_winkler(path, leaf);
            let tail = strsim::jaro_winkler(&last(path), &last(leaf));
            (whole.max(0.95 * tail), leaf)
        })
        .filter(|(score, _)| *score > 0.7)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, leaf)| leaf.clone())
}

fn fitting(present: &Value, given: Value) -> Result<Value, Value> {
    match (present, &given) {
        (Value::Bool(_), Value::Bool(_)) | (Value::String(_), Value::String(_)) => Ok(given),
        (Value::Number(p), Value::Number(g)) => match (p.is_f64(), g.as_f64()) {
            (true, Some(real)) => Ok(Value::from(real)),
            (false, Some(real)) if real.fract() == 0.0 && real.abs() < 9e15 => {
                Ok(Value::from(real as i64))
            }
            _ => Err(given),
        },
        (Value::Array(p), Value::Array(g)) if are_tables(p) && are_tables(g) => Ok(given),
        (Value::Array(p), Value::Array(g)) if p.len() == g.len() => p
            .iter()
            .zip(g)
            .map(|(p, g)| fitting(p, g.clone()))
            .collect::<Result<Vec<_>, _>>()
            .map(Value::Array)
            .map_err(|_| given.clone()),
        _ => Err(given),
    }
}

/// Lists of tables, such as `water.waves`, may have any length; empty ones count among them.
fn are_tables(items: &[Value]) -> bool {
    items.iter().all(Value::is_object)
}

fn kind(value: &Value) -> String {
    match value {
        Value::Bool(_) => "true or false".into(),
        Value::Number(n) if n.is_f64() => "a number".into(),
        Value::Number(_) => "a whole number".into(),
        Value::Array(items) if are_tables(items) => "a list of tables".into(),
        Value::Array(items) => format!("a list of {} numbers", items.len()),
        _ => "a name".into(),
    }
}

/// Reads a value as written on the command line: JSON where it parses as such, else a name.
pub fn parse_value(text: &str) -> Value {
    serde_json::from_str(text).unwrap_or_else(|_| Value::String(text.to_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn tree() -> Value {
        json!({"caustics": {"grid": 200, "filter": true, "buffer": [0, 0]}, "water": {"amplitude_m": 0.1}, "mode": "paper"})
    }

    #[test]
    fn leaves_are_dotted_paths() {
        let expected =
            ["caustics.grid", "caustics.filter", "caustics.buffer", "water.amplitude_m", "mode"];
        assert_eq!(leaves(&tree()), expected);
    }

    #[test]
    fn whole_numbers_pass_for_reals_but_not_the_reverse() {
        let mut tree = tree();
        set(&mut tree, "water.amplitude_m", json!(2)).unwrap();
        assert_eq!(tree["water"]["amplitude_m"], json!(2.0));
        set(&mut tree, "caustics.grid", json!(100.0)).unwrap();
        assert_eq!(tree["caustics"]["grid"], json!(100));
        assert!(set(&mut tree, "caustics.grid", json!(1.5)).is_err());
    }

    #[test]
    fn lists_of_tables_may_have_any_length() {
        let mut tree = json!({"waves": [], "buffer": [0, 0]});
        let waves = json!([{"amplitude_m": 1.0}, {"amplitude_m": 2.0}]);
        set(&mut tree, "waves", waves.clone()).unwrap();
        assert_eq!(tree["waves"], waves);
        set(&mut tree, "waves", json!([])).unwrap();
        let error = set(&mut tree, "waves", json!([1.0])).unwrap_err().to_string();
        assert!(error.contains("takes a list of tables"), "{error}");
        assert!(set(&mut tree, "buffer", json!([{}, {}])).is_err());
        assert!(set(&mut tree, "buffer", json!([])).is_err());
    }

    #[test]
    fn unknown_paths_name_the_nearest_leaf() {
        let error = set(&mut tree(), "caustics.gird", json!(1)).unwrap_err();
        assert_eq!(
            error.to_string(),
            "unknown parameter `caustics.gird`; did you mean `caustics.grid`?"
        );
        let error = set(&mut tree(), "amplitude", json!(1)).unwrap_err();
        assert!(error.to_string().contains("water.amplitude_m"), "{error}");
    }

    #[test]
    fn wrong_kinds_say_what_is_taken() {
        let error = set(&mut tree(), "caustics.filter", json!("yes")).unwrap_err();
        assert_eq!(
            error.to_string(),
            "parameter `caustics.filter` takes true or false, not \"yes\""
        );
        assert!(set(&mut tree(), "caustics.buffer", json!([1, 2, 3])).is_err());
        assert!(set(&mut tree(), "mode", json!(3)).is_err());
        assert!(set(&mut tree(), "caustics", json!({})).is_err());
    }
}
