//! Parameters: each stands once, with its default, range, unit and description beside the field.
//!
//! [`settings!`](crate::settings) declares a group of them, [`choices!`](crate::choices) makes an enum one. A pipeline's parameters
//! are a tree whose leaves are named by dotted paths, such as `caustics.grid`.

use std::collections::BTreeMap;

use serde::de::{self, DeserializeOwned, Deserializer, Visitor};
use serde::{Serialize, de::value::Error as Nothing};
use serde_json::Value;
use thiserror::Error;

use crate::text::{did_you_mean, excerpt};

/// What is wrong with a parameter. One line each.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum ParamError {
    #[error("unknown parameter `{path}`{hint}")]
    Unknown { path: String, hint: String },
    #[error("parameter `{path}` takes {expected}, not {given}")]
    Type { path: String, expected: String, given: String },
    #[error("{path} is {value}: it must lie within {low} … {high}")]
    Range { path: String, value: f64, low: f64, high: f64 },
    /// Parameters that do not go together, or with the scene; the text names them.
    #[error("{0}")]
    Unfit(String),
}

impl From<String> for ParamError {
    fn from(text: String) -> Self {
        Self::Unfit(text)
    }
}

/// Numbers that a parameter may take, ends included.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    pub low: f64,
    pub high: f64,
}

/// What a parameter may be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Allowed {
    Numbers(Range),
    /// One of these names.
    Names(&'static [&'static str]),
    /// True or false.
    Flag,
    /// A name or a table that the parameter's reader judges.
    Free,
}

/// A parameter, for listings.
#[derive(Clone, Debug, PartialEq)]
pub struct ParamField {
    /// Dotted.
    pub path: String,
    pub allowed: Allowed,
    /// `1` for plain numbers, empty for what is no number.
    pub unit: &'static str,
    pub about: String,
}

/// What stands beside a field.
#[derive(Clone, Copy, Debug, Default)]
pub struct FieldMeta<'a> {
    pub path: &'a str,
    pub range: Option<Range>,
    pub unit: &'static str,
    pub about: &'a str,
}

impl<'a> FieldMeta<'a> {
    pub fn new(path: &'a str, about: &'a str) -> Self {
        Self { path, about, ..Self::default() }
    }

    #[must_use]
    pub fn with_range(self, low: f64, high: f64, unit: &'static str) -> Self {
        Self { range: Some(Range { low, high }), unit, ..self }
    }
}

/// A value of a parameter, or a group of parameters.
pub trait Setting {
    /// An error names the first value out of its range. Where there is no range, all pass.
    fn check(&self, _: FieldMeta<'_>) -> Result<(), ParamError> {
        Ok(())
    }

    /// Lists the parameter, or those of the group.
    fn describe(beside: FieldMeta<'_>, fields: &mut Vec<ParamField>);
}

/// An entry of a list that is one parameter: a free table that its reader judges.
pub trait TableEntry: Sized {
    fn check(all: &[Self]) -> Result<(), ParamError>;
}

impl<T: TableEntry> Setting for Vec<T> {
    fn check(&self, _: FieldMeta<'_>) -> Result<(), ParamError> {
        T::check(self)
    }

    fn describe(beside: FieldMeta<'_>, fields: &mut Vec<ParamField>) {
        list(beside, Allowed::Free, fields);
    }
}

/// What may be left out, and what is read from a file, is no parameter.
impl<T> Setting for Option<T> {
    fn describe(_: FieldMeta<'_>, _: &mut Vec<ParamField>) {}
}

/// Neither is a table of any names.
impl<T> Setting for BTreeMap<String, T> {
    fn describe(_: FieldMeta<'_>, _: &mut Vec<ParamField>) {}
}

/// Refuses a number out of the range, and what is no number.
pub fn check_range(path: &str, value: f64, low: f64, high: f64) -> Result<(), ParamError> {
    if (low..=high).contains(&value) {
        return Ok(());
    }
    Err(ParamError::Range { path: path.to_owned(), value, low, high })
}

/// Lists a single parameter.
pub fn list(beside: FieldMeta<'_>, allowed: Allowed, fields: &mut Vec<ParamField>) {
    let about = beside.about.split_whitespace().collect::<Vec<_>>().join(" ");
    fields.push(ParamField { path: beside.path.to_owned(), allowed, unit: beside.unit, about });
}

macro_rules! numbers {
    ($($type:ty: $each:expr),* $(,)?) => {
        $(impl Setting for $type {
            fn check(&self, beside: FieldMeta<'_>) -> Result<(), ParamError> {
                let each: fn(&$type) -> Vec<f64> = $each;
                let Some(Range { low, high }) = beside.range else { return Ok(()) };
                let values = each(self);
                if let [value] = values[..] {
                    return check_range(beside.path, value, low, high);
                }
                values.into_iter().enumerate().try_for_each(|(i, value)| {
                    check_range(&format!("{}[{i}]", beside.path), value, low, high)
                })
            }

            fn describe(beside: FieldMeta<'_>, fields: &mut Vec<ParamField>) {
                list(beside, beside.range.map_or(Allowed::Free, Allowed::Numbers), fields);
            }
        })*
    };
}

numbers! {
    u32: |n| vec![f64::from(*n)],
    f32: |x| vec![f64::from(*x)],
    f64: |x| vec![*x],
    [u32; 2]: |a| a.iter().map(|n| f64::from(*n)).collect(),
    [u32; 3]: |a| a.iter().map(|n| f64::from(*n)).collect(),
    [f32; 3]: |a| a.iter().map(|x| f64::from(*x)).collect(),
    [f64; 2]: |a| a.to_vec(),
    [f64; 3]: |a| a.to_vec(),
}

impl Setting for bool {
    fn describe(beside: FieldMeta<'_>, fields: &mut Vec<ParamField>) {
        list(beside, Allowed::Flag, fields);
    }
}

impl Setting for String {
    fn describe(beside: FieldMeta<'_>, fields: &mut Vec<ParamField>) {
        list(beside, Allowed::Free, fields);
    }
}

/// The names that an enum is read from, or the keys of a table.
pub fn names_of<T: DeserializeOwned>() -> &'static [&'static str] {
    let mut names: &[&str] = &[];
    // It asks for its names, is given nothing, and fails.
    let _ = T::deserialize(NameProbe(&mut names));
    names
}

/// Tells which names or keys a type asks for, and gives it nothing.
struct NameProbe<'a>(&'a mut &'static [&'static str]);

impl<'de> Deserializer<'de> for NameProbe<'_> {
    type Error = Nothing;

    fn deserialize_any<V: Visitor<'de>>(self, _: V) -> Result<V::Value, Nothing> {
        Err(de::Error::custom("nothing is given"))
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        _: &'static str,
        variants: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Nothing> {
        *self.0 = variants;
        self.deserialize_any(visitor)
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Nothing> {
        *self.0 = fields;
        self.deserialize_any(visitor)
    }

    serde::forward_to_deserialize_any! {
        bool i8 i16 i32 i64 u8 u16 u32 u64 f32 f64 char str string bytes byte_buf option unit unit_struct newtype_struct
        seq tuple tuple_struct map identifier ignored_any
    }
}

/// A dotted path one step longer.
pub fn join_path(path: &str, field: &str) -> String {
    if path.is_empty() { field.to_owned() } else { format!("{path}.{field}") }
}

/// Makes enums that serde reads parameters: `choices!(Method, Update)`.
#[macro_export]
macro_rules! choices {
    ($($name:ty),* $(,)?) => {
        $(impl $crate::parameter::Setting for $name {
            fn describe(
                beside: $crate::parameter::FieldMeta<'_>,
                fields: &mut Vec<$crate::parameter::ParamField>,
            ) {
                let names = $crate::parameter::names_of::<$name>();
                $crate::parameter::list(beside, $crate::parameter::Allowed::Names(names), fields);
            }
        })*
    };
}

/// Declares a group of parameters. A field is `NAME: TYPE = DEFAULT => LOW ..= HIGH, "UNIT";` below its description; range and
/// unit are left out where there are none. A field is a [`Setting`]: a number or an array of them, `bool`, an enum of
/// [`choices!`](crate::choices), or a group.
///
/// `struct NAME from FILE: TYPE { … }` has defaults that depend on a file, and is `From<&TYPE>` in place of `Default`.
/// Fields of `struct NAME required { … }` have no defaults. Behind a plain `struct NAME { … }` others may follow.
#[macro_export]
macro_rules! settings {
    () => {};
    ($(#[doc = $about:literal])* $visibility:vis struct $name:ident { $($fields:tt)* } $($more:tt)*) => {
        impl Default for $name {
            fn default() -> Self {
                $crate::settings!(@defaults { $($fields)* })
            }
        }

        $crate::settings!(
            @group [$(#[doc = $about])* #[serde(default, deny_unknown_fields)]] $visibility $name { $($fields)* }
        );
        $crate::settings!($($more)*);
    };
    (
        $(#[doc = $about:literal])*
        $visibility:vis struct $name:ident from $file:ident: $file_type:ty { $($fields:tt)* }
    ) => {
        impl From<&$file_type> for $name {
            /// Defaults, with what the file says.
            fn from($file: &$file_type) -> Self {
                $crate::settings!(@defaults { $($fields)* })
            }
        }

        $crate::settings!($(#[doc = $about])* $visibility struct $name required { $($fields)* });
    };
    ($(#[doc = $about:literal])* $visibility:vis struct $name:ident required { $($fields:tt)* }) => {
        $crate::settings!(
            @group [$(#[doc = $about])* #[serde(deny_unknown_fields)]] $visibility $name { $($fields)* }
        );
    };
    (@defaults {
        $(
            $(#[$about:meta])*
            $field:ident: $type:ty = $default:expr $(=> $low:literal ..= $high:literal, $unit:literal)?;
        )*
    }) => {
        Self { $($field: $default,)* }
    };
    (@group [$($group:tt)*] $visibility:vis $name:ident {
        $(
            $(#[doc = $about:literal])*
            $(#[serde $serde:tt])?
            $field:ident: $type:ty $(= $default:expr)? $(=> $low:literal ..= $high:literal, $unit:literal)?;
        )*
    }) => {
        #[derive(Clone, Debug, PartialEq, ::serde::Serialize, ::serde::Deserialize)]
        $($group)*
        $visibility struct $name {
            $($(#[doc = $about])* $(#[serde $serde])? pub $field: $type,)*
        }

        impl $crate::parameter::Setting for $name {
            fn check(
                &self,
                beside: $crate::parameter::FieldMeta<'_>,
            ) -> Result<(), $crate::parameter::ParamError> {
                $({
                    let path = $crate::parameter::join_path(beside.path, stringify!($field));
                    let beside = $crate::parameter::FieldMeta::new(&path, concat!($($about, "\n"),*))
                        $(.with_range($low as f64, $high as f64, $unit))?;
                    $crate::parameter::Setting::check(&self.$field, beside)?;
                })*
                Ok(())
            }

            fn describe(
                beside: $crate::parameter::FieldMeta<'_>,
                fields: &mut Vec<$crate::parameter::ParamField>,
            ) {
                $({
                    let path = $crate::parameter::join_path(beside.path, stringify!($field));
                    let beside = $crate::parameter::FieldMeta::new(&path, concat!($($about, "\n"),*))
                        $(.with_range($low as f64, $high as f64, $unit))?;
                    <$type as $crate::parameter::Setting>::describe(beside, fields);
                })*
            }
        }
    };
}

/// The parameters of a tree, read once. Values of the wrong kind or out of their range are errors.
pub fn read<T: Setting + DeserializeOwned>(tree: &Value) -> Result<T, ParamError> {
    let parsed: T = serde_path_to_error::deserialize(tree)
        .map_err(|error| ParamError::Unfit(format!("{}: {}", error.path(), error.inner())))?;
    parsed.check(FieldMeta::default())?;
    Ok(parsed)
}

/// Every parameter of a group.
pub fn fields<T: Setting>() -> Vec<ParamField> {
    let mut fields = Vec::new();
    T::describe(FieldMeta::default(), &mut fields);
    fields
}

/// Parameters as a tree.
pub fn tree<T: Serialize>(parameters: &T) -> Value {
    serde_json::to_value(parameters).expect("parameters are plain numbers and names")
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
                collect(value, &join_path(prefix, key), paths);
            }
        }
        _ => paths.push(prefix.to_owned()),
    }
}

/// Value of a leaf.
pub fn get<'t>(tree: &'t Value, path: &str) -> Option<&'t Value> {
    path.split('.').try_fold(tree, |node, key| node.get(key))
}

/// Puts a value at a leaf. The value must be of the kind that stands there; whole numbers pass for reals. The error about an
/// unknown path names the nearest valid one.
pub fn set(tree: &mut Value, path: &str, value: Value) -> Result<(), ParamError> {
    let all = leaves(tree);
    if !all.iter().any(|leaf| leaf == path) {
        let hint = did_you_mean(path, all.iter().map(String::as_str));
        return Err(ParamError::Unknown { path: path.to_owned(), hint });
    }
    let leaf = path
        .split('.')
        .try_fold(tree, |node, key| node.get_mut(key))
        .expect("the path is one of the tree's leaves");
    *leaf = fitting(leaf, value).map_err(|given| ParamError::Type {
        path: path.to_owned(),
        expected: kind(leaf),
        given: excerpt(&given.to_string()),
    })?;
    Ok(())
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
        Value::Array(items) => {
            let (count, example) = (items.len(), vec!["64"; items.len()].join(", "));
            format!("a list of {count} numbers, such as `[{example}]`")
        }
        _ => "a name".into(),
    }
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
    fn whole_numbers_pass_for_reals() {
        let mut tree = tree();
        set(&mut tree, "water.amplitude_m", json!(2)).unwrap();
        assert_eq!(tree["water"]["amplitude_m"], json!(2.0));
        set(&mut tree, "caustics.grid", json!(100.0)).unwrap();
        assert_eq!(tree["caustics"]["grid"], json!(100));
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
    fn values_that_do_not_fit_are_refused() {
        let error = |path, value| set(&mut tree(), path, value).unwrap_err().to_string();
        let unknown = "unknown parameter `caustics.gird`; did you mean `caustics.grid`?";
        assert_eq!(error("caustics.gird", json!(1)), unknown);
        let unknown = error("amplitude", json!(1));
        assert!(unknown.contains("water.amplitude_m"), "{unknown}");
        let kind = "parameter `caustics.filter` takes true or false, not \"yes\"";
        assert_eq!(error("caustics.filter", json!("yes")), kind);
        let others = [("caustics.grid", json!(1.5)), ("caustics.buffer", json!([1, 2, 3]))];
        for (path, value) in others.into_iter().chain([("mode", json!(3)), ("caustics", json!({}))])
        {
            assert!(set(&mut tree(), path, value).is_err(), "{path}");
        }
    }
}
