//! Errors of a cell, and whose output each judges.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::nan;

/// An error of a cell's last frame against a reference: the further from 0, the worse.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ErrorFigure {
    /// What differs, the unit in the name.
    pub name: String,
    /// In `unit`; null where it is no number.
    #[serde(deserialize_with = "nan::number")]
    #[schemars(schema_with = "nan::number_schema")]
    pub value: f64,
    /// Of `value`.
    pub unit: String,
    /// The stage whose output it judges.
    pub stage: String,
    /// Name of the same error before that stage, where it is known: what grew there already is not this stage's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub before: Option<String>,
}

impl ErrorFigure {
    pub fn new(name: impl Into<String>, value: f64, unit: &str, stage: &str) -> Self {
        let (unit, stage) = (unit.into(), stage.into());
        Self { name: name.into(), value, unit, stage, before: None }
    }

    /// The same, known before the stage under another name.
    #[must_use]
    pub fn with_prefix(self, before: &str) -> Self {
        Self { before: Some(before.into()), ..self }
    }
}
