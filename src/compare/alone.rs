//! One worker measured by itself, as a run for a history: a program that is not fathom has no other records.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Result, anyhow};

use super::cells::Gates;
use super::launch::{Quiet, Waiting, WorkerFault, WorkerProcess, WorkerStart, allowed_cores};
use super::protocol::{GateConfiguration, Greeting, Reply, WorkerRequest};
use fathom_base::private;
use fathom_base::statistics::{estimate, median};
use fathom_experiments::Experiment;
use fathom_record::calendar;
use fathom_record::comparison::CellId;
use fathom_record::{Cell, FrameRecord, Measured, Outcome, Record, Run, SCHEMA};

/// Frames of a sample. One such sample goes before, and is not kept.
const FRAMES: u32 = 5;

/// Medians by cell, of a launch each.
type Medians = BTreeMap<CellId, Vec<f64>>;

/// The records of a run: for each cell of a file the medians of launches of this command, as the times of its frames.
pub fn measure(
    command: &str,
    cells_file: &Path,
    launches: u32,
    waiting: Waiting<'_>,
) -> Result<Vec<Record>> {
    let gates = Gates::load(Some(cells_file), ("", ""))?;
    let experiment = Experiment::read(cells_file)?.id;
    let start = WorkerStart { quiet: Some(Quiet::default()), ..WorkerStart::of_command(command) };
    let mut run = Run {
        schema: SCHEMA,
        started_at: calendar::now(),
        command: private::command(),
        ..Run::default()
    };
    let mut medians = Medians::new();
    for number in 0..launches {
        let greeting = launch(&start, &gates, &mut medians, waiting);
        let greeting = greeting.map_err(|fault| anyhow!("{}: {fault}", private::words(command)))?;
        run.fathom_version = greeting.fathom_version;
        run.adapter = greeting.adapter;
        (waiting.tell)(&format!("{} of {launches} launches", number + 1));
    }
    let cells = gates.configurations.iter().flat_map(|configuration| {
        configuration.cells().map(|cell| record(&experiment, configuration, cell, &medians))
    });
    Ok(std::iter::once(Record::Run(Box::new(run))).chain(cells).collect())
}

/// One process measures each cell once.
fn launch(
    start: &WorkerStart,
    gates: &Gates,
    medians: &mut Medians,
    waiting: Waiting<'_>,
) -> Result<Greeting, WorkerFault> {
    let (mut worker, greeting) = WorkerProcess::open(start, &waiting)?;
    if let Some(core) = allowed_cores().first().filter(|_| greeting.adapter.software) {
        worker.pin(*core);
    }
    for configuration in &gates.configurations {
        let request = WorkerRequest::Prepare { configuration: configuration.clone() };
        match worker.ask(&request, &waiting)? {
            Reply::Prepared { .. } => {}
            other => return Err(worker.unexpected(&other)),
        }
        for cell in configuration.cells() {
            worker.sample(&cell, FRAMES, &waiting)?;
            let (ns, _) = worker.sample(&cell, FRAMES, &waiting)?;
            medians.entry(cell).or_default().push(median(&ns));
        }
    }
    worker.quit();
    Ok(greeting)
}

fn record(
    experiment: &str,
    configuration: &GateConfiguration,
    cell: CellId,
    medians: &Medians,
) -> Record {
    // By what clock a worker times is not known, so the times are those of frames that hold the stage alone.
    let untimed_samples_ns = medians.get(&cell).cloned().unwrap_or_default();
    let untimed = estimate(&untimed_samples_ns);
    let frame = FrameRecord { untimed_samples_ns, untimed, ..FrameRecord::default() };
    Record::Cell(Box::new(Cell {
        experiment: experiment.to_owned(),
        cell: cell.to_string(),
        axes: serde_json::Map::new(),
        pipeline: configuration.pipeline.clone(),
        scene: configuration.scene.clone(),
        stand_ins: Vec::new(),
        params: serde_json::Value::Object(configuration.params.clone()).into(),
        outcome: Outcome::Measured(Box::new(Measured { frame, ..Measured::default() })),
    }))
}
