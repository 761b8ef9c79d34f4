//! `fathom export public`: a copy of a folder of records that may be published. It holds no name of the machine, no folders'
//! names, no command line and no values of the environment. `fathom report` reads it.

use std::collections::{HashMap, HashSet};
use std::path::Path;

use anyhow::ensure;

use crate::embedded::{EXPERIMENTS, SCENES};
use crate::exporters;
use crate::harness::merge::{Staging, put_pictures, put_records};
use crate::record::output::OutputFolder;
use crate::record::public::PublicCopy;
use crate::record::{Cell, Damaged, Note, NoteKind, Reading, Record};

/// Name of the format on the command line.
pub const NAME: &str = "public";
/// What `fathom list exporters` says of it.
pub const ABOUT: &str = "a copy without machine, paths and own experiments, to publish";

/// What a copy keeps that it leaves out otherwise.
#[derive(Clone, Copy, Debug)]
pub struct Keep {
    /// Raw samples of a run.
    pub samples: bool,
    /// Experiments and scenes that are not fathom's.
    pub own: bool,
}

/// Writes the copy with its reports into a folder that is not there, or empty. Gives what there is to say of it.
pub fn copy(from: &Path, records: &[Record], to: &Path, keep: Keep) -> anyhow::Result<Vec<String>> {
    let staging = Staging::begin(to)?;
    let (records, own) = reduced(records, keep)?;
    let output = OutputFolder { folder: staging.folder().to_owned() };
    let mut notes = put_pictures(&output, [(from, records.as_slice())])?;
    put_records(&output, &records)?;
    exporters::write(staging.folder(), Reading { records, damaged: Damaged::default() })?;
    staging.publish()?;
    if own > 0 {
        notes.push(format!("{}; --own keeps them", left_out(own)));
    }
    Ok(notes)
}

/// The records of the copy, and how many cells are left out.
fn reduced(records: &[Record], keep: Keep) -> anyhow::Result<(Vec<Record>, usize)> {
    let own = if keep.own { HashSet::new() } else { own_experiments(records) };
    let scenes: HashSet<String> = SCENES.texts(".toml").into_iter().map(|(name, _)| name).collect();
    let is_public = |cell: &Cell| {
        keep.own || !own.contains(cell.experiment.as_str()) && scenes.contains(&cell.scene)
    };
    let mut copy = PublicCopy::new(keep.samples);
    let mut kept = Vec::new();
    let mut cells = 0;
    let latest = latest(records);
    for (place, record) in records.iter().enumerate() {
        match record {
            Record::Cell(cell) if latest[&name(cell)] != place => {}
            Record::Cell(cell) if !is_public(cell) => cells += 1,
            Record::Experiment(definition) if own.contains(definition.id.as_str()) => {}
            _ => kept.push(copy.of(record)?),
        }
    }
    let has_cells = kept.iter().any(|record| matches!(record, Record::Cell(_)));
    ensure!(
        cells == 0 || has_cells,
        "{}, and nothing else is there; --own keeps them",
        left_out(cells)
    );
    let samples = "raw samples are left out: times and claims about them are not judged";
    let texts = [(cells > 0).then(|| left_out(cells)), (!keep.samples).then(|| samples.to_owned())];
    if let Some(Record::Run(run)) = kept.iter_mut().find(|r| matches!(r, Record::Run(_))) {
        run.notes
            .extend(texts.into_iter().flatten().map(|text| Note::new(NoteKind::Reduced, text)));
    }
    Ok((kept, cells))
}

fn name(cell: &Cell) -> [&str; 2] {
    [&cell.experiment, &cell.cell]
}

/// The place of each cell's last record: a resumed run records a cell again.
fn latest(records: &[Record]) -> HashMap<[&str; 2], usize> {
    let cells = records.iter().enumerate();
    cells.filter_map(|(place, record)| Some((name(record.try_as_cell_ref()?), place))).collect()
}

fn left_out(cells: usize) -> String {
    format!(
        "{cells} cells are left out, whose experiment or scene this version of fathom does not have"
    )
}

/// Ids of experiments whose text is not that of fathom's own, or not known.
fn own_experiments(records: &[Record]) -> HashSet<&str> {
    let builtin: HashSet<String> = EXPERIMENTS.texts(".toml").into_iter().map(|(_, t)| t).collect();
    let mut own: HashSet<&str> =
        records.iter().filter_map(Record::try_as_cell_ref).map(|c| c.experiment.as_str()).collect();
    let definitions = records.iter().filter_map(Record::try_as_experiment_ref);
    for definition in definitions {
        if builtin.contains(&definition.toml) {
            own.remove(definition.id.as_str());
        } else {
            own.insert(&definition.id);
        }
    }
    own
}
