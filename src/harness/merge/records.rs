//! The records of a merged run.

use std::collections::{HashMap, HashSet};

use anyhow::Result;
use indexmap::{IndexMap, IndexSet};
use itertools::Itertools;

use super::super::journal;
use super::super::outcome::Counts;
use super::super::plan::{self, Request};
use super::{Merged, OfAdapter, Source};
use fathom_experiments::Experiment;
use fathom_record::command::parted;
use fathom_record::output::OutputFolder;
use fathom_record::{
    Cell, Definition, End, Note, NoteKind, Outcome, Part, Profile, Record, Run, Selection,
};

/// Options of a shard's command line that the whole run would not have; whether a value follows.
const OF_SHARD: [(&str, bool); 3] = [("--shard", true), ("--out", true), ("--resume", false)];

/// An experiment and its cell.
pub type CellId = (String, String);

/// Cells that were measured under one header.
struct Sitting {
    header: Run,
    cells: Vec<Cell>,
    end: Option<End>,
}

impl OfAdapter {
    /// The records in their order, and what there is to say of them.
    pub fn merge(mut self) -> Result<(Vec<Record>, Merged)> {
        let definitions = self.definitions();
        let (kept, duplicates) = kept(&self.sources);
        let notes = self.notes(duplicates);
        let mut sittings: Vec<Sitting> = Vec::new();
        for (place, source) in self.sources.iter_mut().enumerate() {
            let is_kept = |line| kept.contains(&(place, line));
            add(std::mem::take(&mut source.records), is_kept, &mut sittings);
        }
        for sitting in &mut sittings {
            sitting.cells.sort_by_key(|cell| definitions.get_index_of(&cell.experiment));
        }
        let merged = Merged {
            counts: Counts::of(sittings.iter().flat_map(|sitting| &sitting.cells)),
            missing: self.missing(&definitions, &sittings)?,
            absent: self.absent(),
            notes,
            adapter: self.adapter,
        };
        if let (Some(note), Some(last)) = (incomplete(&merged), sittings.last_mut()) {
            last.header.notes.push(note);
        }
        Ok((lines(definitions, sittings), merged))
    }

    /// Of each experiment, in the order of the plan.
    fn definitions(&self) -> IndexMap<String, Definition> {
        let records = self.sources.iter().flat_map(|source| &source.records);
        let definitions = records.filter_map(Record::try_as_experiment_ref);
        definitions.map(|known| (known.id.clone(), known.clone())).collect()
    }

    fn missing(
        &self,
        definitions: &IndexMap<String, Definition>,
        sittings: &[Sitting],
    ) -> Result<Vec<CellId>> {
        let Some(Source { shard, header, .. }) = self.sources.first() else {
            return Ok(Vec::new());
        };
        let planned = planned(definitions, &shard.selection, header.profile)?;
        let cells = sittings.iter().flat_map(|sitting| &sitting.cells);
        let there: HashSet<CellId> =
            cells.map(|cell| (cell.experiment.clone(), cell.cell.clone())).collect();
        Ok(planned.into_iter().filter(|cell| !there.contains(cell)).collect())
    }

    fn absent(&self) -> Vec<Part> {
        let of = self.sources.first().map_or(0, |source| source.shard.part.of);
        let is_there = |number: &u32| self.sources.iter().any(|s| s.shard.part.number == *number);
        let numbers = (1..=of).filter(|number| !is_there(number));
        numbers.map(|number| Part { number, of }).collect()
    }

    fn notes(&self, duplicates: usize) -> Vec<String> {
        let mut notes = Vec::new();
        for source in &self.sources {
            let output = OutputFolder { folder: source.folder.clone() };
            notes.extend(source.damaged.notices(&output.records()));
            let unfinished = journal::unfinished(&output.samples(), &source.records);
            let unfinished = unfinished.unwrap_or_default().len();
            if unfinished > 0 {
                let folder = source.folder.display();
                notes.push(format!(
                    "{folder}: {unfinished} cells have samples but no record yet; continue with `fathom run --resume`"
                ));
            }
        }
        if duplicates > 0 {
            notes.push(format!(
                "{duplicates} records of cells that were measured again are skipped"
            ));
        }
        notes
    }
}

/// What the reports say of missing cells.
fn incomplete(merged: &Merged) -> Option<Note> {
    let Merged { missing, absent, .. } = merged;
    if missing.is_empty() {
        return None;
    }
    let shards = match absent.as_slice() {
        [] => String::new(),
        absent => format!("; not there: shard {}", absent.iter().join(", ")),
    };
    let text = format!("merged with {} cells missing{shards}", missing.len());
    Some(Note::new(NoteKind::Incomplete, text))
}

/// Every cell that the whole run was to have.
fn planned(
    definitions: &IndexMap<String, Definition>,
    selection: &Selection,
    profile: Profile,
) -> Result<Vec<CellId>> {
    let Selection { axes, sets, cells } = selection.clone();
    let request = Request { axes, sets, cells, ..Request::default() };
    let parse = |definition: &Definition| Experiment::parse(&definition.id, &definition.toml);
    let experiments: Vec<Experiment> = definitions.values().map(parse).collect::<Result<_, _>>()?;
    let expanded = plan::expand(&experiments, &request, profile)?;
    Ok(expanded.into_iter().flatten().map(|plan| (plan.experiment, plan.cell)).collect())
}

/// Source and line of those records of cells that count; and how many do not.
fn kept(sources: &[Source]) -> (HashSet<(usize, usize)>, usize) {
    let mut best = HashMap::<(&str, &str), (u8, usize, usize)>::new();
    let mut cells = 0;
    for (place, source) in sources.iter().enumerate() {
        for (line, record) in source.records.iter().enumerate() {
            if let Record::Cell(cell) = record {
                cells += 1;
                let worth = (worth(&cell.outcome), place, line);
                let known = best.entry((&cell.experiment, &cell.cell)).or_insert(worth);
                *known = worth.max(*known);
            }
        }
    }
    let duplicates = cells - best.len();
    (best.into_values().map(|(_, place, line)| (place, line)).collect(), duplicates)
}

fn worth(outcome: &Outcome) -> u8 {
    match outcome {
        Outcome::Measured(_) => 3,
        Outcome::Skipped { .. } => 2,
        Outcome::Failed { .. } => 1,
        Outcome::OverBudget => 0,
    }
}

/// Adds a shard's cells to the sittings. One whose header says what that of an earlier sitting says goes on with that.
fn add(records: Vec<Record>, is_kept: impl Fn(usize) -> bool, sittings: &mut Vec<Sitting>) {
    let mut current = None;
    for (line, record) in records.into_iter().enumerate() {
        match (record, current) {
            (Record::Run(run), _) => current = Some(sitting(of_whole(*run), sittings)),
            (Record::Cell(cell), Some(at)) if is_kept(line) => sittings[at].cells.push(*cell),
            (Record::End(end), Some(at)) => {
                let sitting: &mut Sitting = &mut sittings[at];
                sitting.end = Some(sitting.end.take().map_or(end.clone(), |e| e.and(&end)));
            }
            _ => {}
        }
    }
}

/// Where the sitting with this header is.
fn sitting(header: Run, sittings: &mut Vec<Sitting>) -> usize {
    let bare = |run: &Run| Run { started_at: String::new(), command: Vec::new(), ..run.clone() };
    let same = |sitting: &Sitting| bare(&sitting.header) == bare(&header);
    if let Some(at) = sittings.iter().position(same) {
        let begun = &mut sittings[at].header.started_at;
        if header.started_at < *begun {
            *begun = header.started_at;
        }
        return at;
    }
    sittings.push(Sitting { header, cells: Vec::new(), end: None });
    sittings.len() - 1
}

/// A shard's header as the whole run's.
fn of_whole(run: Run) -> Run {
    let (_, command) = parted(&run.command, &OF_SHARD);
    Run { shard: None, command, ..run }
}

/// The definitions after the first header, each with a cell at least.
fn lines(definitions: IndexMap<String, Definition>, sittings: Vec<Sitting>) -> Vec<Record> {
    let cells = sittings.iter().flat_map(|sitting| &sitting.cells);
    let used: IndexSet<String> = cells.map(|cell| cell.experiment.clone()).collect();
    let definitions = definitions.into_values().filter(|known| used.contains(&known.id));
    let mut definitions: Vec<Record> = definitions.map(Record::Experiment).collect();
    let mut lines = Vec::new();
    for Sitting { header, cells, end } in sittings {
        lines.push(Record::Run(Box::new(header)));
        lines.append(&mut definitions);
        lines.extend(cells.into_iter().map(|cell| Record::Cell(Box::new(cell))));
        lines.extend(end.map(Record::End));
    }
    lines
}
