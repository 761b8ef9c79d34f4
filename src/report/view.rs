//! Records in the order in which a report tells them: the run, then each experiment with its cells, once each.

use std::cmp::Ordering;

use serde_json::Value;

use crate::experiments::{self, Experiment, Ruling, label_text};
use crate::record::{Cell, End, Measured, Record, Run};

pub struct View<'a> {
    pub runs: Vec<&'a Run>,
    pub ends: Vec<&'a End>,
    pub sections: Vec<Section<'a>>,
    pub pictures: &'a [String],
}

/// A cell and the run that it belongs to.
#[derive(Clone, Copy)]
pub struct Entry<'a> {
    pub cell: &'a Cell,
    pub run: Option<&'a Run>,
}

/// An experiment and its cells in the order of its plan; of a cell that was measured again, the latest.
pub struct Section<'a> {
    pub id: &'a str,
    /// As defined in the records, else the built-in one.
    pub experiment: Option<Experiment>,
    /// Why there is none.
    pub problem: Option<String>,
    pub entries: Vec<Entry<'a>>,
}

impl<'a> View<'a> {
    pub fn new(records: &'a [Record], pictures: &'a [String]) -> View<'a> {
        let mut view = View {
            runs: Vec::new(),
            ends: Vec::new(),
            sections: Vec::new(),
            pictures,
        };
        for record in records {
            match record {
                Record::Run(run) => view.runs.push(run),
                Record::End(end) => view.ends.push(end),
                Record::Experiment(definition) => {
                    let parsed = Experiment::parse(&definition.id, &definition.toml);
                    view.section(&definition.id).define(parsed);
                }
                Record::Cell(cell) => {
                    let run = view.runs.last().copied();
                    view.section(&cell.experiment).add(Entry { cell, run });
                }
            }
        }
        let profile = view.run().map_or("", |run| run.profile.as_str()).to_owned();
        for section in &mut view.sections {
            section.finish(&profile);
        }
        view
    }

    /// The latest run.
    pub fn run(&self) -> Option<&'a Run> {
        self.runs.last().copied()
    }

    /// Every measured cell.
    pub fn measured(&self) -> impl Iterator<Item = (&'a Cell, &'a Measured)> {
        self.sections.iter().flat_map(Section::measured)
    }

    fn section(&mut self, id: &'a str) -> &mut Section<'a> {
        let found = self.sections.iter().position(|section| section.id == id);
        let index = found.unwrap_or_else(|| {
            self.sections.push(Section {
                id,
                experiment: None,
                problem: None,
                entries: Vec::new(),
            });
            self.sections.len() - 1
        });
        &mut self.sections[index]
    }
}

impl<'a> Section<'a> {
    fn define(&mut self, parsed: Result<Experiment, experiments::ExperimentError>) {
        match parsed {
            Ok(experiment) => {
                self.experiment = Some(experiment);
                self.problem = None;
            }
            Err(error) => self.problem = Some(error.to_string()),
        }
    }

    fn add(&mut self, entry: Entry<'a>) {
        let known = self
            .entries
            .iter_mut()
            .find(|known| known.cell.cell == entry.cell.cell);
        match known {
            Some(known) => *known = entry,
            None => self.entries.push(entry),
        }
    }

    fn finish(&mut self, profile: &str) {
        if self.experiment.is_none() && self.problem.is_none() {
            if Experiment::builtin_text(self.id).is_some() {
                self.define(Experiment::load(self.id));
            } else {
                self.problem = Some("its definition is not among the records".to_owned());
            }
        }
        let planned: Vec<String> = self
            .experiment
            .as_ref()
            .and_then(|experiment| experiment.cells(profile, &[], &[]).ok())
            .map(|cells| cells.into_iter().map(|plan| plan.cell).collect())
            .unwrap_or_default();
        let rank = |cell: &Cell| {
            let place = planned.iter().position(|planned| *planned == cell.cell);
            place.unwrap_or(planned.len())
        };
        self.entries.sort_by(|a, b| {
            let by_plan = rank(a.cell).cmp(&rank(b.cell));
            by_plan.then_with(|| compare_axes(a.cell, b.cell))
        });
    }

    pub fn cells(&self) -> Vec<&'a Cell> {
        self.entries.iter().map(|entry| entry.cell).collect()
    }

    pub fn measured(&self) -> impl Iterator<Item = (&'a Cell, &'a Measured)> + use<'a, '_> {
        self.entries
            .iter()
            .filter_map(|entry| Some((entry.cell, experiments::measured(entry.cell)?)))
    }

    /// Some of its cells were measured on a software driver.
    pub fn software(&self) -> bool {
        self.entries
            .iter()
            .any(|entry| entry.run.is_none_or(|run| run.adapter.software))
    }

    pub fn rulings(&self) -> Vec<Ruling> {
        match &self.experiment {
            Some(experiment) => experiment.rulings(&self.cells(), self.software()),
            None => Vec::new(),
        }
    }

    pub fn title(&self) -> &str {
        self.experiment
            .as_ref()
            .map_or(self.id, |experiment| experiment.title.as_str())
    }
}

/// Axis by axis: numbers by size, everything else by its text.
fn compare_axes(a: &Cell, b: &Cell) -> Ordering {
    let names = a.axes.keys().cmp(b.axes.keys());
    a.axes
        .values()
        .zip(b.axes.values())
        .fold(names, |order, (a, b)| order.then_with(|| compare(a, b)))
}

fn compare(a: &Value, b: &Value) -> Ordering {
    match (a.as_f64(), b.as_f64()) {
        (Some(a), Some(b)) => a.total_cmp(&b),
        _ => label_text(a).cmp(&label_text(b)),
    }
}
