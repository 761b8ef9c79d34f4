//! JSON Schema (draft 2020-12) of the lines that are written, made from their types. The comments of the types are its descriptions.
//!
//! It describes what this build reads: a field that a reader may lack is not required, and fields that no type names are allowed.

use schemars::generate::SchemaSettings;
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde_json::Value;

use super::Record;
use super::protocol::Exchange;

/// A kind of line that has a schema.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum LineKind {
    /// Lines of `records.jsonl`
    #[default]
    Record,
    /// Lines between `fathom compare` and a worker: `$defs` has `WorkerRequest` and `Reply`
    Worker,
}

impl LineKind {
    /// The schema of such a line.
    pub fn schema(self) -> Value {
        match self {
            Self::Record => schema_of::<Record>("Record of fathom"),
            Self::Worker => schema_of::<Exchange>("Worker protocol of fathom"),
        }
    }

    /// The schema as a file has it.
    pub fn text(self) -> String {
        format!("{:#}\n", self.schema())
    }
}

fn schema_of<T: JsonSchema>(title: &str) -> Value {
    let mut schema = SchemaSettings::draft2020_12().into_generator().into_root_schema_for::<T>();
    schema.insert("title".to_owned(), title.into());
    schema.into()
}

/// Schema of a map whose keys are names of `K`: `#[schemars(schema_with = "schema::map::<K, V>")]`.
pub(super) fn map<K: JsonSchema, V: JsonSchema>(generator: &mut SchemaGenerator) -> Schema {
    let (keys, values) = (generator.subschema_for::<K>(), generator.subschema_for::<V>());
    json_schema!({ "type": "object", "propertyNames": keys, "additionalProperties": values })
}
