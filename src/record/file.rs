//! Records on disk, and which of them need no second measurement.

use std::collections::BTreeSet;
use std::path::Path;

use serde_json::Value;

use super::lines::{Damage, Line, LineWriter, RecordError, read_lines};
use super::{Cell, Outcome, Record, Run, SCHEMA};
use crate::text;

impl Line for Record {
    const SCHEMA: u32 = SCHEMA;
    const NAME: &'static str = "record";

    /// An experiment's id names files of the report.
    fn check(&self) -> Result<(), String> {
        let id = match self {
            Record::Experiment(definition) => &definition.id,
            Record::Cell(cell) => &cell.experiment,
            Record::Run(_) | Record::End(_) => return Ok(()),
        };
        text::check_id(id).map_err(|fault| format!("experiment {fault}"))
    }
}

pub type Writer = LineWriter<Record>;

/// What a file of records held.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Reading {
    pub records: Vec<Record>,
    pub damaged: Vec<Damage>,
}

/// See [`read_lines`].
pub fn read(path: &Path) -> Result<Reading, RecordError> {
    let read = read_lines(path)?;
    Ok(Reading {
        records: read.lines,
        damaged: read.damaged,
    })
}

/// Identity of a cell for `--resume`: a cell with another scene, stand-in or parameter is another cell.
pub fn resume_key(
    experiment: &str,
    cell: &str,
    pipeline: &str,
    scene: &str,
    stand_ins: &[String],
    params: &Value,
) -> String {
    let sorted = sort_keys(params);
    serde_json::json!([experiment, cell, pipeline, scene, stand_ins, sorted]).to_string()
}

fn sort_keys(value: &Value) -> Value {
    match value {
        Value::Object(map) => {
            let mut entries: Vec<_> = map.iter().collect();
            entries.sort_by_key(|(name, _)| *name);
            let sorted = entries
                .into_iter()
                .map(|(name, inner)| (name.clone(), sort_keys(inner)));
            Value::Object(sorted.collect())
        }
        other => other.clone(),
    }
}

impl Cell {
    /// See [`resume_key`].
    pub fn resume_key(&self) -> String {
        resume_key(
            &self.experiment,
            &self.cell,
            &self.pipeline,
            &self.scene,
            &self.stand_ins,
            &self.params,
        )
    }
}

/// Resume keys of the cells that need no second measurement: those measured or skipped under the
/// conditions of `run` (same adapter, profile and shader checks). Failed cells are tried again.
pub fn finished(records: &[Record], run: &Run) -> BTreeSet<String> {
    let mut same_conditions = false;
    let mut keys = BTreeSet::new();
    for record in records {
        match record {
            Record::Run(earlier) => {
                same_conditions = earlier.adapter == run.adapter
                    && earlier.profile == run.profile
                    && earlier.shader_checks == run.shader_checks;
            }
            Record::Cell(cell)
                if same_conditions && !matches!(cell.outcome, Outcome::Failed { .. }) =>
            {
                keys.insert(cell.resume_key());
            }
            _ => {}
        }
    }
    keys
}
