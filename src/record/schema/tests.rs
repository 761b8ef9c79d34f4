use std::path::{Path, PathBuf};

use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::{Value, json};

use fathom_record::Record;
use fathom_record::protocol::{Reply, WorkerRequest};
use fathom_record::schema::*;

fn root() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
}

const KINDS: [LineKind; 2] = [LineKind::Record, LineKind::Worker];

fn committed(kind: LineKind) -> PathBuf {
    let name = match kind {
        LineKind::Record => "record",
        LineKind::Worker => "worker-protocol",
    };
    root().join(format!("docs/{name}.schema.json"))
}

/// `FATHOM_BLESS=1` writes them.
#[test]
fn the_committed_schemas_are_those_of_the_types() {
    for kind in KINDS {
        let made = kind.text();
        if std::env::var_os("FATHOM_BLESS").is_some() {
            std::fs::write(committed(kind), &made).unwrap();
        }
        let found = std::fs::read_to_string(committed(kind)).unwrap();
        assert!(found == made, "{}: write it again", committed(kind).display());
        assert_eq!(kind.schema()["$schema"], "https://json-schema.org/draft/2020-12/schema");
    }
}

/// Every property says what it is, or its type does.
#[test]
fn every_field_is_described_for_readers_without_the_code() {
    fn undescribed(path: &str, schema: &Value, root: &Value, found: &mut Vec<String>) {
        let Some(members) = schema.as_object() else { return };
        for (name, property) in schema["properties"].as_object().into_iter().flatten() {
            let of_type = property["$ref"].as_str().and_then(|r| root.pointer(&r[1..]));
            let described = [Some(property), of_type].into_iter().flatten();
            let tag = property.get("const").is_some();
            if !tag && described.clone().all(|s| s.get("description").is_none()) {
                found.push(format!("{path}/{name}"));
            }
        }
        for (name, inner) in members {
            let of_lists = inner.as_array().into_iter().flatten();
            for schema in of_lists.chain([inner]) {
                undescribed(&format!("{path}/{name}"), schema, root, found);
            }
        }
    }
    for kind in KINDS {
        let schema = kind.schema();
        let mut found = Vec::new();
        undescribed("", &schema, &schema, &mut found);
        assert_eq!(found, Vec::<String>::new());
        assert!(!schema.to_string().contains("[`"), "a link means nothing outside the code");
    }
}

/// Of each kind a line with every optional part, stored: what is read and written again has the same keys and values.
/// `FATHOM_BLESS=1` writes them as this build does. `make test-all` validates them with the schemas.
#[test]
fn stored_lines_are_written_as_they_were_read() {
    fn again<T: DeserializeOwned + Serialize>(line: &Value) -> Value {
        let read = T::deserialize(line).unwrap_or_else(|error| panic!("{error}: {line}"));
        serde_json::to_value(read).unwrap()
    }
    let exchange = |line: &Value| {
        let [request, reply] = [&line["request"], &line["reply"]];
        json!({"request": again::<WorkerRequest>(request), "reply": again::<Option<Reply>>(reply)})
    };
    type Again<'a> = &'a dyn Fn(&Value) -> Value;
    let kinds: [(&str, Again<'_>); 2] = [("record", &again::<Record>), ("worker", &exchange)];
    for (kind, again) in kinds {
        let path = root().join(format!("tests/golden/lines/{kind}.jsonl"));
        let text = std::fs::read_to_string(&path).unwrap();
        let lines: Vec<Value> =
            text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
        let written: Vec<Value> = lines.iter().map(again).collect();
        if std::env::var_os("FATHOM_BLESS").is_some() {
            let text: String = written.iter().map(|line| format!("{line}\n")).collect();
            std::fs::write(&path, text).unwrap();
        }
        assert_eq!(written, lines);
    }
}
