//! Figures that may be no number. JSON has no NaN and no infinity, and writes both as `null`; here `null` reads back as NaN.

use std::collections::BTreeMap;

use schemars::{Schema, SchemaGenerator, json_schema};
use serde::{Deserialize, Deserializer};

/// For fields of the kind `BTreeMap<String, f64>`: `#[serde(deserialize_with = "nan::map")]`.
pub fn map<'de, D: Deserializer<'de>>(deserializer: D) -> Result<BTreeMap<String, f64>, D::Error> {
    let figures = BTreeMap::<String, Option<f64>>::deserialize(deserializer)?;
    let number = |(name, figure): (String, Option<f64>)| (name, figure.unwrap_or(f64::NAN));
    Ok(figures.into_iter().map(number).collect())
}

/// For fields of the kind `f64`: `#[serde(deserialize_with = "nan::number")]`.
pub fn number<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Ok(Option::<f64>::deserialize(deserializer)?.unwrap_or(f64::NAN))
}

/// Schema of what [`number`] reads.
pub fn number_schema(_: &mut SchemaGenerator) -> Schema {
    json_schema!({ "type": ["number", "null"], "format": "double" })
}

/// Schema of what [`map`] reads.
pub fn map_schema(generator: &mut SchemaGenerator) -> Schema {
    json_schema!({ "type": "object", "additionalProperties": number_schema(generator) })
}
