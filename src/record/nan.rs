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

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use serde::{Deserialize, Serialize};

    #[derive(Serialize, Deserialize)]
    struct NanFigures {
        #[serde(default, deserialize_with = "super::map")]
        errors: BTreeMap<String, f64>,
        #[serde(deserialize_with = "super::number")]
        measured: f64,
    }

    #[test]
    fn what_is_no_number_survives_its_line() {
        let figures = NanFigures {
            errors: BTreeMap::from([("a".into(), 0.25), ("b".into(), f64::NAN)]),
            measured: f64::INFINITY,
        };
        let line = serde_json::to_string(&figures).unwrap();
        assert_eq!(line, r#"{"errors":{"a":0.25,"b":null},"measured":null}"#);
        let read: NanFigures = serde_json::from_str(&line).unwrap();
        assert_eq!(read.errors["a"], 0.25);
        assert!(read.errors["b"].is_nan() && read.measured.is_nan());
        let empty: NanFigures = serde_json::from_str(r#"{"measured":1}"#).unwrap();
        assert!(empty.errors.is_empty() && empty.measured == 1.0);
    }
}
